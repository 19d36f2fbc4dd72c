"""Each part of the scene as one primitive: what it is exactly, or the best of the kinds, refined by nlopt."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.objective import Targets, error, penalties, set_distances
from fit.recognize import Piece, box_around, closed_forms, normal_frame, recognize
from fit.refine import refine
from fit.shapes import Shapes, distances_to_one, join, no_shapes
from fit.spaces import Air
from fit.split import Parts

_INSIDE_STEPS = 14

MOST_PARTS = 128
"""Parts fitted on their own, those of the largest projected area; the others are left to the growing."""

MOST_TARGETS = 400
"""Of each sort, surface and air, in the fit of one part."""

MOST_AIR_INSIDE = 0.05
"""Share of a candidate's volume that may be free air: a floor around a court is no slab across it."""

_PROMISING = 0.5
"""Share of a part's error that a closed form must explain before nlopt is worth its time."""


@dataclass(frozen=True)
class PartFits:
    """One candidate shape of each fitted part, and the part (n,) that each stands for."""

    shapes: Shapes
    part: NDArray[np.int64]


def fit_parts(
    air: Air, parts: Parts, wanted: NDArray[np.int64], targets: Targets, triangle: NDArray[np.int64]
) -> PartFits:
    """Candidates of the parts `wanted`, largest first; `triangle` (samples,): the wall of each sample."""
    walls = air.walls
    order = np.argsort(parts.of_triangle, kind="stable")
    limits = np.searchsorted(parts.of_triangle[order], np.arange(len(parts) + 1))
    part_of_target = np.full(len(targets), -1)
    on_surface = np.flatnonzero(targets.is_surface)
    part_of_target[on_surface] = parts.of_triangle[triangle[targets.sample[on_surface]]]
    shapes, owners = [], []
    for part in wanted[:MOST_PARTS]:
        rows = order[limits[part] : limits[part + 1]]
        piece = Piece(walls.vertices[rows], walls.normals[rows], walls.areas[rows])
        found = recognize(piece)
        if len(found) and air_inside(found, air) > MOST_AIR_INSIDE:
            found = no_shapes()  # a room, or a hollow shell
        if len(found) == 0:
            own = np.flatnonzero(part_of_target == part)
            found = _best_kind(piece, _part_targets(targets, own, piece), air)
        shapes.append(found)
        owners += [int(part)] * len(found)
    return PartFits(join(shapes), np.array(owners, np.int64))


def _part_targets(targets: Targets, own: NDArray[np.int64], piece: Piece) -> Targets:
    """The part's own surface, and the air around it, which may be nearer to other parts but not inside."""
    lower, upper = piece.vertices.min(axis=0), piece.vertices.max(axis=0)
    around = np.all(
        (targets.points > lower - targets.reach) & (targets.points < upper + targets.reach), axis=1
    )
    air = np.flatnonzero(around & ~targets.is_surface)
    rows = np.concatenate([_thinned(own, MOST_TARGETS), _thinned(air, MOST_TARGETS)])
    chosen = targets.select(rows)
    caps = np.where(chosen.is_surface, chosen.caps, chosen.distances)
    weights = chosen.weights.copy()
    for mask in (chosen.is_surface, ~chosen.is_surface):
        weights[mask] /= max(float(weights[mask].sum()), np.finfo(float).tiny)
    return replace(chosen, caps=caps, weights=weights)


def _thinned(rows: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    return rows if len(rows) <= most else rows[np.linspace(0, len(rows) - 1, most).astype(np.int64)]


def _best_kind(piece: Piece, targets: Targets, air: Air) -> Shapes:
    """The closed forms, each refined by nlopt where it is promising; the one of least error."""
    nothing = float(penalties(targets, set_distances(no_shapes(), targets)).sum())
    candidates = closed_forms(piece)
    errors = np.array([error(candidates.select(np.array([i])), targets) for i in range(len(candidates))])
    best, lowest = no_shapes(), nothing
    for i in np.argsort(errors, kind="stable")[:3]:
        if errors[i] > (1 - _PROMISING) * nothing or errors[i] > 2 * errors.min():
            continue
        step = 0.25 * float(candidates.halves[i].max())
        refined = refine(candidates.select(np.array([i])), targets, max_step=step, evaluations=40, passes=1)
        reached = error(refined, targets)
        if reached < lowest and air_inside(refined, air) <= MOST_AIR_INSIDE:
            best, lowest = refined, reached
    return best


def air_inside(shape: Shapes, air: Air) -> float:
    """Share of one shape's volume that is free air, by points on a regular grid of its local box."""
    steps = (np.arange(_INSIDE_STEPS) + 0.5) / _INSIDE_STEPS * 2 - 1
    local = (
        np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3) * shape.halves[0]
    )
    points = shape.centers[0] + local @ shape.frames[0].T
    points = points[distances_to_one(shape, 0, points) <= 0]
    cells = air.grid.cells_of(points)
    is_free = air.free.reshape(-1)[air.grid.flat(cells)] & air.grid.holds(cells)
    return float(is_free.mean()) if len(points) else 0.0


def bounding_fit(piece: Piece) -> Shapes:
    """The tight box of a part in the frame of its own faces: what an emissive panel is kept as."""
    return box_around(piece.vertices, normal_frame(piece))
