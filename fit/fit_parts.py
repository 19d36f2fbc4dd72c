"""Each part of the scene as one primitive: what it is exactly, or the best of the kinds, refined by nlopt."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.explain import explain
from fit.objective import Targets, error, penalties, set_distances
from fit.recognize import Piece, box_around, closed_forms, normal_frame, recognize
from fit.refine import refine
from fit.scene import Float64
from fit.shapes import Shapes, distances_to_one, join, no_shapes
from fit.spaces import Air
from fit.split import Parts
from fit.surface import Surface

_INSIDE_STEPS = 14

MOST_PARTS = 128
"""Parts fitted on their own, those of the largest projected area; the others are left to the growing."""

MOST_TRIANGLES = 200_000
"""Of a part that closed forms are fitted to: 10 million took 130 s, for the same shapes."""

MOST_TARGETS = 400
"""Of each sort, surface and air, in the fit of one part."""

MOST_AIR_INSIDE = 0.05
"""Share of a candidate's volume that may be free air: a floor around a court is no slab across it."""

_PROMISING = 0.5
"""Share of a part's error that a closed form must explain before nlopt is worth its time."""


EXPLAINED = 0.99
"""Share of the seen surface that exact primitives must lie on to be the set, with nothing left to grow."""

LEAST_EXPLAINED = 1e-3
"""Share of the seen surface of an instance that is worth the time to find exact primitives in it."""

LEAST_SEEN = 1e-4
"""Of the seen surface: an exact primitive that shows less is inside others."""


@dataclass(frozen=True)
class PartFits:
    """Candidate shapes of the fitted parts, and the part (n,) that each stands for.

    whole: the exact primitives that make up the scene, the most seen first; none when anything else does.
    """

    shapes: Shapes
    part: NDArray[np.int64]
    whole: Shapes


def fit_parts(
    air: Air, parts: Parts, wanted: NDArray[np.int64], targets: Targets, triangle: NDArray[np.int64]
) -> PartFits:
    """Candidates of the parts `wanted`, largest first; `triangle` (samples,): the wall of each sample."""
    walls = air.walls
    on_surface = np.flatnonzero(targets.is_surface)
    seen_triangle = triangle[targets.sample[on_surface]]
    weights = targets.weights[on_surface]
    seen = np.bincount(walls.instance[seen_triangle], weights, int(walls.instance.max(initial=0)) + 1)
    exact, of_triangle = explain_walls(air, seen >= LEAST_EXPLAINED * weights.sum())
    order = np.argsort(parts.of_triangle, kind="stable")
    limits = np.searchsorted(parts.of_triangle[order], np.arange(len(parts) + 1))
    part_of_target = np.full(len(targets), -1)
    part_of_target[on_surface] = parts.of_triangle[seen_triangle]
    shapes, owners = [], []
    for part in wanted[:MOST_PARTS]:
        rows = order[limits[part] : limits[part + 1]]
        piece = _piece(walls, rows)
        own = np.unique(of_triangle[rows])
        if own[0] >= 0:
            found = exact.select(own)
        else:
            found = recognize(piece)
            if len(found) and air_inside(found, air) > MOST_AIR_INSIDE:
                found = no_shapes()  # a room, or a hollow shell
            if len(found):
                of_triangle[rows] = len(exact)
                exact = join([exact, found])
            else:
                found = _best_kind(
                    piece, _part_targets(targets, np.flatnonzero(part_of_target == part), piece), air
                )
        shapes.append(found)
        owners += [int(part)] * len(found)
    share = np.bincount(of_triangle[seen_triangle] + 1, weights, len(exact) + 1)
    return PartFits(join(shapes), np.array(owners, np.int64), _whole(exact, share.astype(np.float64)))


def _piece(walls: Surface, rows: NDArray[np.int64]) -> Piece:
    """Triangles `rows` of the walls; of millions enough, evenly spread, that stand for the area of all."""
    kept = _thinned(rows, MOST_TRIANGLES)
    areas = walls.areas[kept] * (walls.areas[rows].sum() / max(walls.areas[kept].sum(), np.finfo(float).tiny))
    return Piece(walls.vertices[kept], walls.normals[kept], areas)


def explain_walls(air: Air, wanted: NDArray[np.bool_]) -> tuple[Shapes, NDArray[np.int64]]:
    """Exact primitives of the closed shells, and the one that each wall triangle lies on, else -1.

    Instances that are open alone are one mesh together. wanted: by instance, those that are looked at.
    """
    walls = air.walls
    of_triangle = np.full(len(walls), -1)
    order = np.argsort(walls.instance, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(walls.instance[order])) + 1)
    shut = [_may_be_closed(walls, rows) for rows in groups]
    together = [rows for rows, closed in zip(groups, shut, strict=True) if not closed]
    groups = [r for r, closed in zip(groups, shut, strict=True) if closed and wanted[walls.instance[r[0]]]]
    if len(together) > 1 and _may_be_closed(walls, np.concatenate(together)):
        groups.append(np.concatenate(together))
    found: list[Shapes] = []
    count = 0
    for rows in groups:
        explanation = explain(walls.vertices[rows])
        number = explanation.of_triangle
        kept = np.zeros(len(explanation.shapes) + 1, bool)
        for i in range(len(explanation.shapes)):
            shape = explanation.shapes.select(np.array([i]))
            kept[i] = air_inside(shape, air) <= MOST_AIR_INSIDE
        new = np.cumsum(kept) - 1 + count
        of_triangle[rows] = np.where(kept[number], new[number], -1)
        found.append(explanation.shapes.select(kept[:-1]))
        count += int(kept.sum())
    return join(found), of_triangle


def _may_be_closed(walls: Surface, rows: NDArray[np.int64]) -> bool:
    """The area vectors of a closed mesh sum to zero: most open ones are told by that alone."""
    areas = walls.areas[rows]
    return bool(np.abs(areas @ walls.normals[rows]).max() <= 1e-4 * areas.sum())


def _whole(exact: Shapes, weight: Float64) -> Shapes:
    """The exact shapes (n,) that show, if nothing else does; weight (1 + n,) of no shape and of each."""
    total = max(float(weight.sum()), np.finfo(float).tiny)
    share = weight[1:] / total
    if weight[0] > (1 - EXPLAINED) * total:
        return no_shapes()
    falling = np.argsort(-share, kind="stable")
    return exact.select(falling[share[falling] >= LEAST_SEEN])


def _part_targets(targets: Targets, own: NDArray[np.int64], piece: Piece) -> Targets:
    """The part's own surface, and the air around it, which may be nearer to other parts but not inside."""
    lower, upper = piece.vertices.min(axis=0), piece.vertices.max(axis=0)
    around = np.all(
        (targets.points > lower - targets.reach) & (targets.points < upper + targets.reach), axis=1
    )
    air = np.flatnonzero(around & (targets.distances > 0))
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
