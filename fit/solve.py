"""The fit of a whole scene: from a glTF's triangles to the primitives that stand for it when light is traced.

`fit` is the method from top to bottom; each step is a module named by its verb, and docs/method.md tells why.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np

from fit.air import LostSeed, find_air, parse_seed
from fit.apart import Body, budgets, find_bodies, settings_of
from fit.backdrop import backdrop_notes
from fit.build import STEPS, Enough, Scope, build
from fit.canonical import (
    Pose,
    TurnedAir,
    in_axes_of,
    to_canonical,
    world_air,
    world_lengths,
    world_primitives,
    world_surface,
)
from fit.close import close_leaks
from fit.color import color
from fit.fit_parts import fit_parts
from fit.glow import find_glow
from fit.keep import skip_small_parts
from fit.lamps import emissive_parts, uncover
from fit.measure import Metrics, PrimitiveError, measure, measure_each, place_probes
from fit.notes import notes_on_result
from fit.objective import Targets, error, set_distances
from fit.paint import paint
from fit.palette import find_palette
from fit.polish import polish_until
from fit.primitives import PrimitiveSet
from fit.scene import Scene
from fit.settings import COARSE, DEFAULT, FINE, GAIN_BY_DEFAULT, GAIN_WITH_BUDGET, FitSettings
from fit.shapes import Shapes, no_shapes, to_primitives
from fit.solid import inside_targets, missing_repair
from fit.sources import exact_whole, find_sources, whole_solid
from fit.spaces import Air
from fit.split import split
from fit.surface import Surface, from_scene
from fit.targets import along_a_curve, make_targets, see_surface
from fit.volume import Volumes, compare_volumes

__all__ = ["COARSE", "FINE", "STEPS", "Fit", "FitSettings", "Progress", "find_scene_air", "fit"]

SURFACE_SAMPLES, AIR_SAMPLES, INSIDE_SAMPLES = 12_000, 16_000, 8_000

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Fit:
    """The set, what it was fitted to, how well, volumes, errors of each primitive; skipped_parts: name and
    shares; seconds of CPU by stage."""

    primitives: PrimitiveSet
    surface: Surface
    air: Air
    metrics: Metrics
    volumes: Volumes
    errors: tuple[PrimitiveError, ...]
    skipped_parts: list[dict[str, object]]
    seconds: dict[str, float]
    notes: tuple[str, ...]


def fit(
    scene: Scene,
    settings: FitSettings = DEFAULT,
    progress: Progress | None = None,
    *,
    air: Air | None = None,
) -> Fit:
    """Fits a set of primitives to a scene; `air`: the scene's, where it was found before.

    What an animation moves is fitted apart from what stands, and its primitives know their node.

    Raises:
        ValueError: no face of the scene stops light, or a seed of the air lies in no space.
    """
    bodies = find_bodies(scene, instancing=settings.instancing)
    if not bodies:
        return _fit_whole(scene, settings, progress, air)
    fits = []
    for number, (body, limit) in enumerate(zip(bodies, budgets(bodies, settings), strict=True)):
        report = _part_of(progress, number, len(bodies))
        is_left_out = limit == 0
        fits.append(
            None if is_left_out else _fit_whole(body.scene, settings_of(body, limit, settings), report)
        )
    return _join(scene, settings, bodies, fits, air)


def _fit_whole(
    scene: Scene,
    settings: FitSettings,
    progress: Progress | None = None,
    air: Air | None = None,
) -> Fit:
    """`fit` of a scene in which nothing moves.

    Raises:
        ValueError: no face of the scene stops light, or a seed of the air lies in no space.
    """
    stages = _Stages(progress)
    with stages("air"):
        # A given air that was found in the world's axes keeps them.
        pose, scene, surface = to_canonical(scene) if air is None else in_axes_of(air, scene)
        air = _canonical_air(air, pose, scene, surface, settings)
    with stages("samples"):
        seen = see_surface(air, SURFACE_SAMPLES, settings.seed)
        parts = split(scene, air.walls)
        wanted, weights, skipped = skip_small_parts(parts, air.walls, seen, settings.least_share())
        targets = make_targets(seen, air, weights, AIR_SAMPLES, settings.seed)
        solid = whole_solid(air, seen) if "bodies" in settings.steps else None
        if solid:
            targets = along_a_curve(inside_targets(targets, air, solid, INSIDE_SAMPLES, settings.seed))
        unmended = missing_repair(air) if solid is None and "bodies" in settings.steps else ""
        glow = find_glow(scene, air, settings.seed)
    with stages("parts"):
        parts_fits = fit_parts(air, parts, wanted, targets, seen.samples.triangle)
        fixed = emissive_parts(glow, air, parts, min(MOST_LAMPS, settings.limit() // LAMPS_SHARE))
    with stages("build"):
        whole = no_shapes() if len(fixed) else exact_whole(parts_fits, settings)
        sources = None if len(whole) else find_sources(
            air, seen, targets, parts_fits, solid, settings, fixed
        )  # fmt: skip
        enough = _enough(targets, settings, pose.unit)
        shapes = whole if sources is None else build(
            targets, sources, fixed, limit=settings.limit(), enough=enough, max_step=STEP_CELLS * air.cell,
            scope=Scope(settings.kinds, settings.steps), seed=settings.seed, progress=stages.fraction,
        )  # fmt: skip
    with stages("close"):
        # Of a body its fill counts, unless leaks are asked for: its silhouette would grow.
        judge = None
        if "closing" in settings.steps and sources and not (sources.alone and settings.max_leaks == 1.0):
            polished, judge = polish_until(
                shapes, targets, air, sources, Scope(settings.kinds, settings.steps),
                most_leaks=settings.max_leaks, kept=len(fixed), seed=settings.seed, progress=stages.fraction,
                # No more shapes where these are good enough, or worth while without a budget.
                limit=len(shapes) if enough.good(shapes) or not settings.has_budget else settings.limit(),
            )  # fmt: skip
            shapes = enough.best(polished, shapes)
    with stages("color"):
        nothing = error(no_shapes(), targets)
        palette = find_palette(scene, air, seen, nothing)
        shapes = paint(
            shapes, targets if judge is None else judge, palette,
            limit=settings.limit(), least_gain=GAIN_BY_DEFAULT * nothing, kept=len(fixed),
        )  # fmt: skip
        if judge:
            free = np.arange(len(shapes)) >= len(fixed)
            shapes = enough.best(
                close_leaks(shapes, judge, cell=air.cell, free=free, steps=LAST_STEPS, kinds=settings.kinds),
                shapes,
            )
        shapes = uncover(shapes, len(fixed), glow, air)
        uncolored = to_primitives(shapes, planes="plane" in settings.kinds)
        primitives = color(uncolored, scene, air, seen, glow, lamps=fixed, seed=settings.seed)
    with stages("measure"):
        probes = place_probes(surface, air, settings.seed)
        volumes = compare_volumes(primitives, air.walls, air)
        metrics = measure(
            primitives, surface, air, seed=settings.seed, probes=probes, metre=1 / pose.unit, volumes=volumes
        )
        errors = measure_each(primitives, probes)
    outer = world_air(air, pose)
    # Where every face is a wall, both are one: millions of triangles are not turned twice.
    turned = outer.walls if air.walls is surface else world_surface(surface, pose)
    placed, lengths = world_primitives(primitives, pose), world_lengths(metrics, pose)
    reached = pose.unit * _surface_p95(shapes, targets.select(np.flatnonzero(targets.is_surface)))
    return Fit(
        placed, turned, outer, lengths, volumes.in_units(pose.unit),
        tuple(world_lengths(one, pose) for one in errors), _in_metres(skipped, pose.unit), stages.seconds,
        (
            *filter(None, [unmended]), *backdrop_notes(scene),
            *notes_on_result(placed, lengths, settings, reached), *outer.notes(),
        ),
    )  # fmt: skip


def _part_of(progress: Progress | None, number: int, count: int) -> Progress | None:
    """Progress of one body among several."""
    if progress is None:
        return None
    return lambda stage, done: progress(f"body {number + 1} of {count}: {stage}", done)


def _join(
    scene: Scene, settings: FitSettings, bodies: Sequence[Body], fits: Sequence[Fit | None], air: Air | None
) -> Fit:
    """The fits of bodies, placed, as the fit of their scene at rest."""
    done = [(body, one) for body, one in zip(bodies, fits, strict=True) if one is not None]
    primitives = PrimitiveSet.concatenate([body.place(one.primitives) for body, one in done])
    if not any(body.moves for body in bodies):
        primitives = replace(primitives, nodes=())
    stages = _Stages(None)
    with stages("measure"):
        air, surface = air or find_scene_air(scene, settings), from_scene(scene)
        probes = place_probes(surface, air, settings.seed)
        metrics = measure(primitives, surface, air, seed=settings.seed, probes=probes)
        volumes = compare_volumes(primitives, air.walls, air)
        errors = measure_each(primitives, probes)
    seconds: dict[str, float] = {}
    for spent in (*(one.seconds for _, one in done), stages.seconds):
        for stage, value in spent.items():
            seconds[stage] = seconds.get(stage, 0.0) + value
    skipped = [
        part | {"instance": body.instances[cast(int, part["instance"])]}
        for body, one in done
        for part in one.skipped_parts
    ]
    dropped = [body for body, one in zip(bodies, fits, strict=True) if one is None]
    notes = [f"{body.name}: no primitive, the budget has no room for so many bodies" for body in dropped]
    notes += notes_on_result(primitives, metrics, settings, metrics.surface_to_set_p95_m)
    return Fit(primitives, surface, air, metrics, volumes, errors, skipped, seconds, (*notes, *air.notes()))


def find_scene_air(scene: Scene, settings: FitSettings = DEFAULT) -> TurnedAir:
    """The air that `fit` finds, to be given to several fits of one scene."""
    pose, scene, surface = to_canonical(scene)
    return world_air(_canonical_air(None, pose, scene, surface, settings), pose)


def _in_metres(skipped: list[dict[str, object]], unit: float) -> list[dict[str, object]]:
    return [part | {"area_m2": cast(float, part["area_m2"]) * unit**2} for part in skipped]


def _canonical_air(air: Air | None, pose: Pose, scene: Scene, surface: Surface, settings: FitSettings) -> Air:
    if air is not None:
        return air.inner if isinstance(air, TurnedAir) else air
    given = [parse_seed(seed) if isinstance(seed, str) else seed for seed in settings.air]
    seeds = [seed if isinstance(seed, str) else pose.triple_inwards(seed) for seed in given]
    try:
        return find_air(surface, scene, resolution=settings.resolution, seeds=seeds)
    except LostSeed as lost:
        seed, nearest = pose.triple_outwards(lost.seed), pose.triple_outwards(lost.nearest)
        raise LostSeed(seed, nearest, lost.room * pose.unit) from None


MOST_LAMPS, LAMPS_SHARE = 16, 3
"""Parts that emit light and keep a primitive of their own, the strongest first: at most so many, and one of
so many primitives."""

LAST_STEPS = (0.5, 0.25, 0.12)
"""Cells that faces move by once colours have cut and moved some of them."""

STEP_CELLS = 1.5
"""Farthest that a face may move in one pass of the refinement."""


def _enough(targets: Targets, settings: FitSettings, unit: float) -> Enough:
    """When growth stops before the budget; `unit` metres are one of the targets' lengths."""
    surface = targets.select(np.flatnonzero(targets.is_surface))
    most = settings.max_error
    return Enough(
        settings.least_gain(), GAIN_WITH_BUDGET, settings.max_leaks,
        lambda shapes: most is not None and unit * _surface_p95(shapes, surface) <= most,
    )  # fmt: skip


def _surface_p95(shapes: Shapes, surface: Targets) -> float:
    return float(np.percentile(np.abs(set_distances(shapes, surface)), 95)) if len(surface) else 0.0


@dataclass
class _Stages:
    """Seconds of CPU by stage, and the progress callback."""

    progress: Progress | None
    seconds: dict[str, float] = field(default_factory=dict)
    name: str = ""
    started: float = 0.0

    def __call__(self, name: str) -> _Stages:
        self.name = name
        return self

    def __enter__(self) -> None:
        self.started = time.process_time()
        self.fraction(0.0)

    def __exit__(self, *_: object) -> None:
        self.seconds[self.name] = time.process_time() - self.started
        self.fraction(1.0)

    def fraction(self, done: float) -> None:
        if self.progress:
            self.progress(self.name, done)
