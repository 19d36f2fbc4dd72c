"""The fit of a whole scene: from a glTF's triangles to the primitives that stand for it when light is traced.

`fit` is the method from top to bottom; each step is a module named by its verb, and docs/method.md tells why.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import cast

import numpy as np

from fit.air import LostSeed, find_air, parse_seed
from fit.bodies import fit_body
from fit.build import STEPS, Scope, Sources, build
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
from fit.color import color
from fit.fit_parts import PartFits, fit_parts
from fit.glow import find_glow
from fit.grow import make_lattice, propose_boxes
from fit.keep import emissive_parts, skip_small_parts
from fit.measure import Metrics, PrimitiveError, measure, measure_each, place_probes
from fit.objective import Targets, error, set_distances
from fit.orient import find_frames
from fit.paint import paint
from fit.palette import find_palette
from fit.primitives import PrimitiveSet
from fit.regions import find_regions, propose_slabs
from fit.scene import Scene
from fit.shapes import KINDS, Shapes, no_shapes, to_primitives
from fit.solid import Solid, find_solid, inside_targets
from fit.spaces import Air
from fit.split import split
from fit.surface import Surface
from fit.targets import Seen, along_a_curve, make_targets, see_surface

BYTES_PER_PRIMITIVE = 64
SURFACE_SAMPLES, AIR_SAMPLES, INSIDE_SAMPLES = 12_000, 16_000, 8_000

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class FitSettings:
    """What to fit. Without any budget the count follows the scene, up to 128.

    max_primitives, max_bytes (64 a primitive): hard caps; preset: 'coarse' or 'fine' sets `max_primitives`
    and `skip_below` where they are not given; max_error: metres that 95 % of the seen surface must lie within
    of the set; skip_below: share of the projected area under which a part gets no primitive; air: seeds,
    'outside' or 'x,y,z'; resolution: cells of the air's grid along the bounding diagonal; kinds: those that
    may stand in the set; steps: those of the method's optional steps, `STEPS`, that are taken.
    """

    max_primitives: int | None = None
    max_bytes: int | None = None
    max_error: float | None = None
    preset: str | None = None
    air: tuple[str | tuple[float, float, float], ...] = ()
    seed: int = 0
    resolution: float = 180
    skip_below: float | None = None
    kinds: tuple[str, ...] = KINDS
    steps: tuple[str, ...] = STEPS

    def __post_init__(self) -> None:
        if self.preset is not None and self.preset not in PRESETS:
            raise ValueError(f"preset {self.preset!r}: expected one of {', '.join(PRESETS)}")
        for name, known in (("kinds", KINDS), ("steps", STEPS)):
            unknown = [item for item in getattr(self, name) if item not in known]
            if unknown:
                raise ValueError(f"{name} {', '.join(unknown)}: expected some of {', '.join(known)}")
        for name, least in (("max_primitives", 1), ("max_bytes", BYTES_PER_PRIMITIVE), ("max_error", 0)):
            value = getattr(self, name)
            if value is not None and not value >= least:
                raise ValueError(f"{name} {value}: expected at least {least}")

    def limit(self) -> int:
        """Most primitives that any of the caps allows."""
        preset = PRESETS[self.preset][0] if self.preset else None
        free = MOST_FOR_ERROR if self.max_error is not None else MOST_BY_DEFAULT
        wanted = self.max_primitives or preset or free
        return min(wanted, self.max_bytes // BYTES_PER_PRIMITIVE) if self.max_bytes else wanted

    def least_share(self) -> float:
        """Projected area under which a part is skipped."""
        if self.skip_below is not None:
            return self.skip_below
        return PRESETS[self.preset][1] if self.preset else SKIP_BY_DEFAULT

    def least_gain(self) -> float:
        """Share of the empty set's error that one more primitive must take off."""
        budgeted = self.max_primitives or self.preset or self.max_error is not None
        return GAIN_WITH_BUDGET if budgeted else GAIN_BY_DEFAULT


PRESETS = {"coarse": (48, 0.005), "fine": (192, 0.0005)}
"""Primitives at most, and the projected area under which a part is skipped."""

MOST_BY_DEFAULT, MOST_FOR_ERROR = 128, 512
SKIP_BY_DEFAULT = 0.001
GAIN_BY_DEFAULT, GAIN_WITH_BUDGET = 2e-4, 2e-5

COARSE, FINE = FitSettings(preset="coarse"), FitSettings(preset="fine")


@dataclass(frozen=True)
class Fit:
    """The set, what it was fitted to and how well, errors of each primitive; skipped_parts: name and shares;
    seconds of CPU by stage."""

    primitives: PrimitiveSet
    surface: Surface
    air: Air
    metrics: Metrics
    errors: tuple[PrimitiveError, ...]
    skipped_parts: list[dict[str, object]]
    seconds: dict[str, float]
    notes: tuple[str, ...]


def fit(
    scene: Scene,
    settings: FitSettings = FitSettings(),
    progress: Progress | None = None,
    *,
    air: Air | None = None,
) -> Fit:
    """Fits a set of primitives to a scene; `air`: the scene's, where it was found before.

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
        solid = _whole_solid(air, seen) if "bodies" in settings.steps else None
        if solid:
            targets = along_a_curve(inside_targets(targets, air, solid, INSIDE_SAMPLES, settings.seed))
        glow = find_glow(scene, air, settings.seed)
    with stages("parts"):
        parts_fits = fit_parts(air, parts, wanted, targets, seen.samples.triangle)
        fixed = emissive_parts(glow, air, parts, MOST_LAMPS)
    with stages("build"):
        whole = no_shapes() if len(fixed) else _whole(parts_fits, settings)
        shapes = whole if len(whole) else build(
            targets, _sources(air, seen, targets, parts_fits, solid, settings), fixed,
            limit=settings.limit(), least_gain=settings.least_gain(), max_step=STEP_CELLS * air.cell,
            seed=settings.seed,
            scope=Scope(settings.kinds, settings.steps),
            good_enough=_within(targets, settings.max_error, pose.unit), progress=stages.fraction,
        )  # fmt: skip
    with stages("color"):
        palette = find_palette(scene, air, seen, targets.reach)
        worth_it = GAIN_BY_DEFAULT * error(no_shapes(), targets)
        shapes = paint(shapes, targets, palette, limit=settings.limit(), least_gain=worth_it, kept=len(fixed))
        uncolored = to_primitives(shapes, planes="plane" in settings.kinds)
        primitives = color(uncolored, scene, air, seen, glow, seed=settings.seed)
    with stages("measure"):
        probes = place_probes(surface, air, settings.seed)
        metrics = measure(primitives, surface, air, seed=settings.seed, probes=probes, metre=1 / pose.unit)
        errors = measure_each(primitives, probes)
    outer = world_air(air, pose)
    # Where every face is a wall, both are one: millions of triangles are not turned twice.
    turned = outer.walls if air.walls is surface else world_surface(surface, pose)
    return Fit(
        world_primitives(primitives, pose), turned, outer, world_lengths(metrics, pose),
        tuple(world_lengths(one, pose) for one in errors), _in_metres(skipped, pose.unit), stages.seconds,
        _notes(shapes, settings, targets, pose.unit) + outer.notes(),
    )  # fmt: skip


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


MOST_LAMPS = 16
"""Parts that emit light and keep a primitive of their own, the strongest first."""

STEP_CELLS = 1.5
"""Farthest that a face may move in one pass of the refinement."""

PART_BONUS, EXACT_BONUS = 1.1, 1.5
"""Factors on the gain of candidates that stand for a whole part, and of those that are it exactly."""


LEAST_BODY = 0.95
"""Of the seen surface, that a solid must bound to compete as a complete set made from its volume."""


def _whole_solid(air: Air, seen: Seen) -> Solid | None:
    """The solid that the seen surface bounds, where it is closed."""
    solid = find_solid(air)
    if solid is None:
        return None
    bounds = solid.tree.nearest(seen.samples.points)[0] < 1e-3 * air.cell
    return solid if seen.weights @ bounds >= LEAST_BODY * seen.weights.sum() else None


def _sources(
    air: Air, seen: Seen, targets: Targets, parts: PartFits, solid: Solid | None, settings: FitSettings
) -> Sources:
    """Where the set's shapes come from."""
    frames = find_frames(seen.normals, seen.weights)
    lattices = [make_lattice(air, frame, air.cell, *air.walls.bounds) for frame in frames]
    regions = find_regions(air, targets, seed=settings.seed)
    proposers = {
        "growing": lambda distances, rng: propose_boxes(lattices, targets, distances, rng),
        "regions": lambda distances, rng: propose_slabs(regions, targets, distances),
    }
    bonus = np.where(parts.shapes.exact, EXACT_BONUS, PART_BONUS)
    if solid is None:
        return Sources(parts.shapes, bonus, proposers)
    return Sources(
        parts.shapes, bonus, proposers, body=lambda size: fit_body(solid, air, size, seed=settings.seed)
    )


def _whole(parts: PartFits, settings: FitSettings) -> Shapes:
    """The exact primitives that the scene is made of, where the settings admit them all; else none."""
    kinds = {KINDS[kind] for kind in parts.whole.kinds}
    admitted = len(parts.whole) <= settings.limit() and kinds <= set(settings.kinds)
    return parts.whole if admitted else no_shapes()


def _within(targets: Targets, max_error: float | None, unit: float) -> Callable[[Shapes], bool] | None:
    if max_error is None:
        return None
    surface = targets.select(np.flatnonzero(targets.is_surface))
    return lambda shapes: unit * _surface_p95(shapes, surface) <= max_error


def _surface_p95(shapes: Shapes, surface: Targets) -> float:
    return float(np.percentile(np.abs(set_distances(shapes, surface)), 95)) if len(surface) else 0.0


def _notes(shapes: Shapes, settings: FitSettings, targets: Targets, unit: float) -> tuple[str, ...]:
    notes = []
    if len(shapes) == 0:
        notes.append("no primitive: no surface is seen from the air")
    if settings.max_error is not None:
        reached = unit * _surface_p95(shapes, targets.select(np.flatnonzero(targets.is_surface)))
        if reached > settings.max_error:
            notes.append(
                f"max_error {settings.max_error:g} m not reached: {reached:.3g} m, {len(shapes)} primitives"
            )
    return tuple(notes)


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
