"""What the processes of `bench fit` do: make a scene ready, fit it or run a peer on it, judge the set.

Every set of a scene is judged at the same points, which no fit has seen: they have a seed of their own.
"""

from __future__ import annotations

import pickle
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fit import gltf, solve
from fit.canonical import TurnedAir, world_air
from fit.measure import Probes, measure, measure_each, place_probes
from fit.objective import Targets, error
from fit.polish import BLOCKED_PRICE, LEAK_PRICE
from fit.primitives import Kind, PrimitiveSet
from fit.rays import RayCaster
from fit.scene import Scene
from fit.shapes import Shapes, no_shapes, to_primitives
from fit.surface import Surface, from_scene
from fit.targets import count_rays, make_targets, see_surface
from pipelines.bench_fit_peers import VARIANTS, Peer, hulls, to_shapes
from pipelines.convert import describe_primitives
from pipelines.worker import Progress

FRESH_SEED = 1_000_003
"""Added to the fit's seed where sets are judged, so that the points are new to every fit."""


@dataclass(frozen=True)
class Trial:
    """One fit: the most primitives, the kinds that may stand in the set, and the optional steps taken."""

    budget: int
    kinds: tuple[str, ...]
    steps: tuple[str, ...]


@dataclass(frozen=True)
class Prepared:
    """What all runs of a scene share; `targets` and `probes` are the points at which sets are judged."""

    scene: Scene
    surface: Surface
    air: TurnedAir
    targets: Targets
    probes: Probes


def prepare(
    file: Path, scale: float, seeds: Sequence[str], seed: int, store: Path, progress: Progress
) -> dict[str, Any]:
    """Loads a scene, finds its air, places the points of judgement; keeps all that in the file `store`."""
    progress("load", 0.0)
    clock = _Clock()
    scene = gltf.load(file, scale=scale)
    load = clock.lap()
    progress("air", 0.3)
    air = solve.find_scene_air(scene, solve.FitSettings(air=tuple(seeds)))
    surface = from_scene(scene)
    found = clock.lap()
    progress("points", 0.8)
    fresh = seed + FRESH_SEED
    seen = see_surface(air, solve.SURFACE_SAMPLES, fresh)
    points = make_targets(seen, air, seen.weights, solve.AIR_SAMPLES, fresh)
    targets = count_rays(points, air, fresh, LEAK_PRICE, BLOCKED_PRICE)
    _write(store, Prepared(scene, surface, air, targets, place_probes(surface, air, fresh)))
    return {
        "triangles": len(surface),
        "diagonal_m": surface.diagonal,
        "air": [asdict(space) for space in air.spaces],
        "stages": {"load": load["cpu_seconds"], "air": found["cpu_seconds"]},
        "cpu_seconds": load["cpu_seconds"] + found["cpu_seconds"],
        "wall_seconds": load["wall_seconds"] + found["wall_seconds"],
    }


def fit_once(store: Path, trial: Trial, seed: int, progress: Progress) -> dict[str, Any]:
    """One trial's set, judged."""
    prepared = _read(store)
    settings = solve.FitSettings(max_primitives=trial.budget, kinds=trial.kinds, steps=trial.steps, seed=seed)
    clock = _Clock()
    result = solve.fit(prepared.scene, settings, progress, air=prepared.air)
    took = clock.lap()
    progress("judge", 0.0)
    stages = {stage: seconds for stage, seconds in result.seconds.items() if stage != "air"}
    return judge(result.primitives, prepared, seed) | took | {"stages": stages, "notes": list(result.notes)}


def run_peer(
    store: Path, peer: Peer, budget: int, seed: int, progress: Progress
) -> dict[str, dict[str, Any]]:
    """A peer's hulls as sets of each variant, judged; the seconds of the hulls count for each."""
    prepared = _read(store)
    progress("hulls", 0.0)
    clock = _Clock()
    pieces = hulls(peer, prepared.air.walls, budget, seed)
    cutting = clock.lap()
    rows: dict[str, dict[str, Any]] = {}
    for variant in VARIANTS:
        progress(variant, 0.5)
        clock.lap()
        primitives = to_primitives(to_shapes(pieces, variant))
        fitting = clock.lap()
        took = {key: cutting[key] + fitting[key] for key in cutting}
        stages = {"hulls": cutting["cpu_seconds"], variant: fitting["cpu_seconds"]}
        rows[variant] = judge(primitives, prepared, seed) | took | {"stages": stages, "notes": []}
    return rows


def judge(primitives: PrimitiveSet, prepared: Prepared, seed: int) -> dict[str, Any]:
    """A row's keys that follow from a set: what is in it, and how well it stands in for the scene.

    `error` is the method's own error J at fresh points and rays, as a share of the empty set's.
    """
    metrics = measure(
        primitives, prepared.surface, prepared.air, seed=seed + FRESH_SEED, probes=prepared.probes
    )
    return describe_primitives(primitives) | {
        "error": relative_error(primitives, prepared.targets),
        "metrics": asdict(metrics),
        "by_kind": _by_kind(primitives, prepared.probes),
    }


def relative_error(primitives: PrimitiveSet, targets: Targets) -> float:
    """J of the set over J of no set at all: 0 is perfect, 1 is worth nothing. Both in the same axes."""
    nothing = error(no_shapes(), targets)
    return error(from_primitives(primitives), targets) / nothing if nothing > 0 else 0.0


def from_primitives(primitives: PrimitiveSet) -> Shapes:
    """The solids of a set without half-spaces; planes are the thin boxes that they were."""
    kinds = np.where(primitives.kinds == Kind.PLANE, Kind.BOX, primitives.kinds).astype(np.uint8)
    return Shapes(
        kinds=kinds,
        centers=primitives.positions,
        frames=primitives.rotation_matrices(),
        halves=primitives.sizes / 2,
        exact=np.zeros(len(primitives), bool),
    )


def _by_kind(primitives: PrimitiveSet, probes: Probes) -> dict[str, dict[str, float]]:
    """Of each kind: the share of the seen surface that is nearest to it, and the mean distance there."""
    errors = measure_each(primitives, probes) if len(primitives) else ()
    found = {}
    for kind in (kind.name.lower() for kind in Kind):
        own = [each for each in errors if each.kind == kind]
        share = sum(each.surface_share for each in own)
        moment = sum(each.surface_share * each.surface_to_set_mean_m for each in own)
        found[kind] = {"surface_share": share, "surface_to_set_mean_m": moment / share if share else 0.0}
    return found


class _Clock:
    """CPU seconds of this process, all threads, and of the wall, between laps."""

    def __init__(self) -> None:
        self.cpu, self.wall = time.process_time(), time.perf_counter()

    def lap(self) -> dict[str, float]:
        cpu, wall = time.process_time(), time.perf_counter()
        took = {"cpu_seconds": cpu - self.cpu, "wall_seconds": wall - self.wall}
        self.cpu, self.wall = cpu, wall
        return took


def _write(store: Path, prepared: Prepared) -> None:
    """Pickles all but the ray caster, which holds native memory and is quick to build."""
    bare: Any = replace(prepared.air.inner, rays=None)  # type: ignore[arg-type]
    with store.open("wb") as stream:
        pickle.dump((replace(prepared, air=bare), prepared.air.pose), stream, pickle.HIGHEST_PROTOCOL)


def _read(store: Path) -> Prepared:
    with store.open("rb") as stream:
        prepared, pose = pickle.load(stream)
    inner = prepared.air
    inner = replace(inner, rays=RayCaster(inner.walls.vertices, inner.tree))
    return replace(prepared, air=world_air(inner, pose))
