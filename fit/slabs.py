"""Oriented slabs along a region: rectangles that cover its surface and no opening, as thick as nobody sees.

On a raster in the region's plane, cells with surface count for a rectangle and cells where air passes count
against it. The rectangle of largest sum is found exactly (Bentley 1984); what it covers stops counting, and
the next one is sought: an L-shaped wall gets two, a wall with a door three, and arches stay open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fit.partition import Samples
from fit.primitives import Kind
from fit.scene import Float64
from fit.shapes import Shapes, join, make_shapes, right_handed
from fit.spaces import Air

Int64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

FACING = 0.8
"""Cosine to the region's normal from which surface counts as its own."""

OFF_PLANE = 0.6
"""Cells from the plane within which surface counts, or twice the region's own spread where that is more."""

MARGIN = 2.0
"""Cells around the region's own samples that a rectangle may reach: it meets the walls across."""

LEAST_STEP, MOST_STEPS = 0.5, 32
"""Cells of the air's grid to one of the raster, and cells of the raster along a side."""

DEPTHS = (0.0, 1.0, 2.0, 3.0, 4.5, 6.0)
"""Cells behind the plane where air is looked for."""

THICKNESSES = (0, 2, 5)
"""Which of the depths a slab reaches: thin sheets, walls and blocks."""

THIN = 0.5
"""Cells of thickness of the slab that reaches no depth."""

SHEET = 0.1
"""Cells of thickness of a slab whose two sides are one surface."""

AIR_COST = 4.0
"""Of a raster cell of air against one of surface: a door of a fifth of its wall stays open."""

UNSEEN_COST = 0.05
"""Of any raster cell: a rectangle is no larger than it must be."""

MOST_RECTANGLES = 3

LEAST_SCORE = 0.2
"""Of the first rectangle's score, for another one of the same region."""

_ANGLES = 24
_ABOVE = 1.0
"""Cells above the highest surface looked for, where its rays start."""

_LONE = 4.0
"""Cells from the next sample beyond which a surface is not the region's."""


@dataclass(frozen=True)
class Patch:
    """A region seen along its normal, lengths in cells of the air's grid.

    members (m,): its samples; frame (3, 3): columns u, v, normal; origin (2,), step: of the raster (nu, nv);
    air (k, nu, nv): openings, then air at each further of `DEPTHS`; surface (nu, nv): there is some, at
    `height`; nearest (nu, nv): the member next to it; behind (b, 3): samples that face the other way, in
    the frame.
    """

    members: Int64
    frame: Float64
    origin: Float64
    step: float
    plane: float
    air: Bool
    surface: Bool
    height: Float64
    nearest: Int64
    behind: Float64


def make_patch(samples: Samples, members: Int64, air: Air) -> Patch | None:
    """The patch of a region; None where its normals cancel out."""
    points, weights = samples.points[members], samples.weights[members]
    normal = (samples.normals[members] * weights[:, None]).sum(axis=0)
    length = float(np.linalg.norm(normal))
    if len(members) < 3 or length < 0.1 * weights.sum():
        return None
    frame = _tightest_frame(points, normal / length)
    own = points @ frame
    plane = float(np.average(own[:, 2], weights=weights))
    spread = float(np.sqrt(np.average((own[:, 2] - plane) ** 2, weights=weights)))
    lower, upper = own[:, :2].min(axis=0) - MARGIN, own[:, :2].max(axis=0) + MARGIN
    step = max(LEAST_STEP, float((upper - lower).max()) / MOST_STEPS)
    count = np.ceil((upper - lower) / step).astype(np.int64)
    u, v = (lower[k] + step * (np.arange(count[k]) + 0.5) for k in range(2))
    raster = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    gap, nearest = cKDTree(own[:, :2]).query(raster)
    surface, height, is_open = _looked_at(air, frame, raster, plane, max(OFF_PLANE, 2 * spread))
    surface &= gap < max(_LONE, 2 * step)
    is_air = _air_behind(air, frame, raster, plane)
    is_air[0] = (is_air[0] | is_open) & ~surface
    return Patch(
        members, frame, lower, step, plane, is_air.reshape(len(DEPTHS), *count),
        surface.reshape(count), height.reshape(count), nearest.reshape(count),
        _behind(samples, frame, lower, upper, plane),
    )  # fmt: skip


def _tightest_frame(points: Float64, normal: Float64) -> Float64:
    """Frame with the normal last, turned so that the rectangle around the points is smallest."""
    helper = np.eye(3)[np.argmin(np.abs(normal))]
    frame = right_handed(np.stack([normal, helper - normal * (helper @ normal)], axis=1))
    first, second = frame[:, 1], frame[:, 2]
    angles = np.arange(_ANGLES) * (np.pi / 2 / _ANGLES)
    u = np.outer(np.cos(angles), first) + np.outer(np.sin(angles), second)
    v = np.cross(normal, u)
    sides = np.ptp(points @ u.T, axis=0) * np.ptp(points @ v.T, axis=0)
    best = int(np.argmin(sides))
    return np.stack([u[best], v[best], normal], axis=1)


def _looked_at(
    air: Air, frame: Float64, raster: Float64, plane: float, off: float
) -> tuple[Bool, Float64, Bool]:
    """Where a ray down the normal meets surface along the plane within `off`, its height, and where a ray
    that starts in air meets nothing so far: an opening, however narrow."""
    start = np.column_stack([raster, np.full(len(raster), plane + off + _ABOVE)]) @ frame.T
    down = np.broadcast_to(-frame[:, 2], start.shape)
    distance, triangle = air.rays.first_hit(air.origin + air.cell * start, down)
    height = plane + off + _ABOVE - np.minimum(distance / air.cell, 2 * off + _ABOVE)
    met = (triangle >= 0) & (np.abs(height - plane) < off)
    met[met] = np.abs(air.walls.normals[triangle[met]] @ frame[:, 2]) > FACING
    return met, height, _is_free(air, start) & (height <= plane - off)


def _is_free(air: Air, points: Float64) -> Bool:
    """Whether the cell of each point (p, 3) is air; beyond the grid is what its border is."""
    cells = np.floor(points).astype(np.int64)
    return np.asarray(air.free.reshape(-1)[air.grid.flat(cells)])


def _air_behind(air: Air, frame: Float64, raster: Float64, plane: float) -> Bool:
    """Whether air is at each of the depths (k, r) behind the raster's cells."""
    points = raster @ frame[:, :2].T + plane * frame[:, 2]
    return np.stack([_is_free(air, points - depth * frame[:, 2]) for depth in DEPTHS])


def _behind(samples: Samples, frame: Float64, lower: Float64, upper: Float64, plane: float) -> Float64:
    """Samples in reach that face the other way, in the frame: the far sides of sheets and walls."""
    away = np.flatnonzero(samples.normals @ frame[:, 2] < -FACING)
    local = samples.points[away] @ frame
    below = plane - local[:, 2]
    kept = (
        np.all((local[:, :2] > lower) & (local[:, :2] < upper), axis=1) & (below > -1) & (below < DEPTHS[-1])
    )
    return local[kept]


# ----------------------------------------------------------------------------------------------- slabs


def slabs(patch: Patch, need: Float64, air: Air) -> Shapes:
    """Candidate boxes of a patch; need (p,): how far each sample is from having a shape, 0 to 1."""
    found, seen = [], set[tuple[int, ...]]()
    for thickness in THICKNESSES:
        for rectangle in _rectangles(patch, need, thickness):
            depth = _depth(patch, rectangle, thickness)
            key = (*rectangle, round(10 * depth))
            if key not in seen:
                seen.add(key)
                found.append(_slab(patch, rectangle, depth, air))
    return join(found)


Rectangle = tuple[int, int, int, int]


def _rectangles(patch: Patch, need: Float64, thickness: int) -> list[Rectangle]:
    """Rows and columns u0, u1, v0, v1 of the rectangles worth a slab, the best first."""
    gain = np.where(patch.surface, need[patch.members][patch.nearest], 0.0)
    behind = patch.air[1 : thickness + 1]
    cost = AIR_COST * (patch.air[0] + (behind.mean(axis=0) if len(behind) else 0.0)) + UNSEEN_COST
    found: list[Rectangle] = []
    first = 0.0
    for _ in range(MOST_RECTANGLES):
        score, rectangle = best_rectangle(gain - cost)
        first = first or score
        if score <= max(LEAST_SCORE * first, 0.0):
            break
        found.append(rectangle)
        u0, u1, v0, v1 = rectangle
        gain[u0:u1, v0:v1] = 0.0
    return found


def best_rectangle(values: Float64) -> tuple[float, Rectangle]:
    """The sub-rectangle of largest sum: all pairs of rows, and along the columns Kadane's scan for each."""
    if values.shape[0] > values.shape[1]:
        score, (v0, v1, u0, u1) = best_rectangle(values.T)
        return score, (u0, u1, v0, v1)
    rows = np.zeros((values.shape[0] + 1, values.shape[1]))
    np.cumsum(values, axis=0, out=rows[1:])
    top, bottom = np.triu_indices(len(rows), 1)
    sums = np.zeros((len(top), values.shape[1] + 1))
    np.cumsum(rows[bottom] - rows[top], axis=1, out=sums[:, 1:])
    lowest = np.minimum.accumulate(sums[:, :-1], axis=1)
    pair, last = divmod(int(np.argmax(sums[:, 1:] - lowest)), values.shape[1])
    first = int(np.argmin(sums[pair, : last + 1]))
    score = float(sums[pair, last + 1] - sums[pair, first])
    return score, (int(top[pair]), int(bottom[pair]), first, last + 1)


def _bounds(patch: Patch, rectangle: Rectangle) -> tuple[Float64, Float64]:
    u0, u1, v0, v1 = rectangle
    return patch.origin + patch.step * np.array([u0, v0]), patch.origin + patch.step * np.array([u1, v1])


def _top(patch: Patch, rectangle: Rectangle) -> float:
    """Height of the front face: the median of the surface in the rectangle."""
    u0, u1, v0, v1 = rectangle
    own = patch.height[u0:u1, v0:v1][patch.surface[u0:u1, v0:v1]]
    return float(np.median(own)) if len(own) else patch.plane


def _depth(patch: Patch, rectangle: Rectangle, thickness: int) -> float:
    """Thickness in cells: to the far side where it is seen, else as far as asked for."""
    low, high = _bounds(patch, rectangle)
    depth = DEPTHS[thickness] if thickness else THIN
    inside = np.all((patch.behind[:, :2] >= low) & (patch.behind[:, :2] <= high), axis=1)
    below = _top(patch, rectangle) - patch.behind[inside, 2]
    below = below[(below > -0.25) & (below < depth + 1)]
    return max(float(np.median(below)), SHEET) if len(below) else depth


def _slab(patch: Patch, rectangle: Rectangle, depth: float, air: Air) -> Shapes:
    low, high = _bounds(patch, rectangle)
    middle = np.array([*(low + high) / 2, _top(patch, rectangle) - depth / 2])
    center = air.origin + air.cell * (patch.frame @ middle)
    halves = np.array([*(high - low) / 2, depth / 2])
    return make_shapes(Kind.BOX, center[None], patch.frame, air.cell * halves)
