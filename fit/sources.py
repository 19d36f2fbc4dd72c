"""Where the shapes of a set come from: parts, grown boxes, slabs along regions, a body's own fit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fit.bodies import fit_body
from fit.build import Sources
from fit.fit_parts import PartFits
from fit.grow import make_lattice, propose_boxes
from fit.objective import Targets
from fit.orient import find_frames
from fit.regions import find_regions, propose_slabs
from fit.settings import FitSettings
from fit.shapes import KINDS, Shapes, no_shapes
from fit.solid import Solid, find_solid
from fit.spaces import Air
from fit.targets import Seen

PART_BONUS, EXACT_BONUS = 1.1, 1.5
"""Factors on the gain of candidates that stand for a whole part, and of those that are it exactly."""


LEAST_BODY = 0.95
"""Of the seen surface, that a solid must bound to compete as a complete set made from its volume."""

ON_BODY_CELLS = 0.3
"""How far off the seen surface a solid's boundary may lie: the wrap of a body with holes keeps 0.18."""


BODY_ALONE = 64
"""Shapes up to which a closed body's own fit is the set: growing beside it takes three times as long, and
fills the body no better (Spot at 24: IoU 0.943 in 40 s grown, 0.948 in 14 s alone)."""

BODY_BY_DEFAULT = 32
"""Shapes that a closed body gets at most when no budget is given."""


def whole_solid(air: Air, seen: Seen) -> Solid | None:
    """The solid that the seen surface bounds, where it is closed."""
    solid = find_solid(air)
    if solid is None:
        return None
    bounds = solid.tree.nearest(seen.samples.points)[0] < ON_BODY_CELLS * air.cell
    return solid if seen.weights @ bounds >= LEAST_BODY * seen.weights.sum() else None


def find_sources(
    air: Air,
    seen: Seen,
    targets: Targets,
    parts: PartFits,
    solid: Solid | None,
    settings: FitSettings,
    fixed: Shapes,
) -> Sources:
    """Where the set's shapes come from; beside `fixed` ones no body stands alone."""
    alone = 0 if solid is None or len(fixed) else _size_alone(settings)
    if solid and alone:
        return Sources(no_shapes(), np.zeros(0), {}, _body(solid, air, settings), alone)
    frames = find_frames(seen.normals, seen.weights)
    lattices = [make_lattice(air, frame, air.cell, *air.walls.bounds) for frame in frames]
    regions = find_regions(air, targets, seed=settings.seed)
    proposers = {
        "growing": lambda distances, rng: propose_boxes(lattices, targets, distances, rng),
        "regions": lambda distances, rng: propose_slabs(regions, targets, distances),
    }
    bonus = np.where(parts.shapes.exact, EXACT_BONUS, PART_BONUS)
    return Sources(parts.shapes, bonus, proposers, _body(solid, air, settings) if solid else None)


def _body(solid: Solid, air: Air, settings: FitSettings) -> Callable[[int], Shapes]:
    return lambda size: fit_body(solid, air, size, seed=settings.seed)


def _size_alone(settings: FitSettings) -> int:
    """At which size a closed body's own fit is the set; 0 where the growth has its say."""
    if settings.max_error is not None or set(settings.kinds) != set(KINDS) or "bodies" not in settings.steps:
        return 0
    if not settings.has_budget:
        return min(settings.limit(), BODY_BY_DEFAULT)
    return settings.limit() if settings.limit() <= BODY_ALONE else 0


def exact_whole(parts: PartFits, settings: FitSettings) -> Shapes:
    """The exact primitives that the scene is made of, where the settings admit them all; else none."""
    kinds = {KINDS[kind] for kind in parts.whole.kinds}
    admitted = len(parts.whole) <= settings.limit() and kinds <= set(settings.kinds)
    return parts.whole if admitted else no_shapes()
