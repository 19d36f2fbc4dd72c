"""Oriented slabs along a region: rectangles that cover its surface and no opening, as thick as nobody sees.

On a raster in the region's plane, cells with surface count for a rectangle and cells where air passes count
against it. The rectangle of largest sum is found exactly (Bentley 1984); what it covers stops counting, and
the next one is sought: an L-shaped wall gets two, a wall with a door three, and arches stay open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.partition import Samples
from fit.primitives import Kind
from fit.scene import Float64
from fit.shapes import Shapes, join, make_shapes, no_shapes, right_handed
from fit.spaces import Air

FACING = 0.8
"""Cosine to the region's normal from which surface counts as its own."""

OFF_PLANE = 0.6
"""Cells from the plane within which surface counts, or twice the region's own spread where that is more."""

MARGIN = 2.0
"""Cells around the region's own samples that a rectangle may reach: it meets the walls across."""

MOST_CELLS = 40
"""Of the raster, along one side."""

DEPTHS = (0.0, 1.0, 2.0, 3.0, 4.5, 6.0)
"""Cells behind the plane where air is looked for."""

THICKNESSES = (0, 1, 3, 5)
"""How many of the depths beyond the first a slab reaches: thin sheets, walls and blocks."""

AIR_COST = 2.0
"""Of a raster cell of air against one of surface."""

UNSEEN_COST = 0.05
"""Of a raster cell with neither: a rectangle is no larger than it must."""

MOST_RECTANGLES = 3
LEAST_SCORE = 0.2
"""Of the first rectangle's score, for another one of the same region."""

SHEET = 0.1
"""Cells of thickness of a slab with air on both sides."""

_ANGLES = 24


@dataclass(frozen=True)
class _Raster:
    """A region seen along its normal: frame (3, 3) columns u, v, normal (cells of the air's grid);
    origin (3,) of the raster in it, its step; air (k, nu, nv): air at each depth; surface (nu, nv)."""

    frame: Float64
    origin: Float64
    step: float
    air: NDArray[np.bool_]
    surface: Float64


def slabs(samples: Samples, members: NDArray[np.int64], air: Air) -> Shapes:
    """Candidate boxes of one region (rows of its samples, in cells of the air's grid about its origin)."""
    points, weights = samples.points[members], samples.weights[members]
    normal = (samples.normals[members] * weights[:, None]).sum(axis=0)
    length = float(np.linalg.norm(normal))
    if len(members) < 3 or length < 1e-9 * weights.sum():
        return no_shapes()
    frame = _tightest_frame(points, normal / length)
    own = points @ frame
    height = float(np.average(own[:, 2], weights=weights))
    spread = float(np.sqrt(np.average((own[:, 2] - height) ** 2, weights=weights)))
    local = samples.points @ frame
    lower, upper = own.min(axis=0) - MARGIN, own.max(axis=0) + MARGIN
    near = np.all((local[:, :2] > lower[:2]) & (local[:, :2] < upper[:2]), axis=1)
    near &= np.abs(local[:, 2] - height) < max(OFF_PLANE, 2 * spread)
    facing = samples.normals @ frame[:, 2]
    front = np.flatnonzero(near & (facing > FACING))
    raster = _rasterized(air, frame, np.array([*lower[:2], height]), upper[:2])
    return join(
        [
            _slab(samples, local, facing, front, raster, thickness, rectangle, air)
            for thickness in THICKNESSES
            for rectangle in _rectangles(raster, local[front], samples.weights[front], thickness)
        ]
    )


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


def _rasterized(air: Air, frame: Float64, origin: Float64, upper: Float64) -> _Raster:
    extent = upper - origin[:2]
    step = max(1.0, float(extent.max()) / MOST_CELLS)
    count = np.ceil(extent / step).astype(np.int64)
    u, v = (origin[k] + step * (np.arange(count[k]) + 0.5) for k in range(2))
    grid = np.stack(
        np.meshgrid(-np.array(DEPTHS), u, v, indexing="ij"), axis=-1
    )[..., [1, 2, 0]] + np.array([0.0, 0.0, origin[2]])  # fmt: skip
    cells = np.floor(grid.reshape(-1, 3) @ frame.T).astype(np.int64)
    flat = air.grid.flat(cells)
    shape = (len(DEPTHS), *count)
    is_air = (air.free.reshape(-1)[flat] | ~air.grid.holds(cells)).reshape(shape)
    solid = (air.label.reshape(-1)[flat] == 0).reshape(shape)
    return _Raster(frame, origin, step, is_air, solid[0].astype(np.float64))


Rectangle = tuple[int, int, int, int]


def _rectangles(raster: _Raster, local: Float64, weights: Float64, thickness: int) -> list[Rectangle]:
    """Rows and columns u0, u1, v0, v1 of the rectangles worth a slab, the best first."""
    count = raster.surface.shape
    at = np.clip(((local[:, :2] - raster.origin[:2]) / raster.step).astype(np.int64), 0, np.array(count) - 1)
    sampled = np.zeros(count)
    np.add.at(sampled, (at[:, 0], at[:, 1]), weights)
    if not sampled.any():
        return []
    air = raster.air[: thickness + 1].mean(axis=0)
    surface = raster.surface * (air < 1)
    gain = 0.5 * sampled * max(surface.sum(), 1.0) / sampled.sum() + 0.5 * surface
    cost = AIR_COST * air + UNSEEN_COST
    found: list[Rectangle] = []
    first = 0.0
    for _ in range(MOST_RECTANGLES):
        score, (u0, u1, v0, v1) = _best_rectangle(gain - cost)
        first = first or score
        if score <= max(LEAST_SCORE * first, 0.0):
            break
        found.append((u0, u1, v0, v1))
        gain[u0:u1, v0:v1] = 0.0
    return found


def _best_rectangle(values: Float64) -> tuple[float, Rectangle]:
    """The sub-rectangle of largest sum: all pairs of rows, and along the columns Kadane's scan for each."""
    if values.shape[0] > values.shape[1]:
        score, (v0, v1, u0, u1) = _best_rectangle(values.T)
        return score, (u0, u1, v0, v1)
    rows = np.zeros((values.shape[0] + 1, values.shape[1]))
    np.cumsum(values, axis=0, out=rows[1:])
    top, bottom = np.triu_indices(len(rows), 1)
    sums = np.zeros((len(top), values.shape[1] + 1))
    np.cumsum(rows[bottom] - rows[top], axis=1, out=sums[:, 1:])
    lowest = np.minimum.accumulate(sums[:, :-1], axis=1)
    best = np.unravel_index(int(np.argmax(sums[:, 1:] - lowest)), lowest.shape)
    pair, last = int(best[0]), int(best[1])
    first = int(np.argmin(sums[pair, : last + 1]))
    score = float(sums[pair, last + 1] - sums[pair, first])
    return score, (int(top[pair]), int(bottom[pair]), first, last + 1)


def _slab(
    samples: Samples,
    local: Float64,
    facing: Float64,
    front: NDArray[np.int64],
    raster: _Raster,
    thickness: int,
    rectangle: Rectangle,
    air: Air,
) -> Shapes:
    """The box behind a rectangle: front face at the weighted median of its surface, back at the far side."""
    u0, u1, v0, v1 = rectangle
    low = raster.origin[:2] + raster.step * np.array([u0, v0])
    high = raster.origin[:2] + raster.step * np.array([u1, v1])
    inside = np.all((local[:, :2] >= low) & (local[:, :2] <= high), axis=1)
    own = front[inside[front]]
    top = _median(local[own, 2], samples.weights[own]) if len(own) else raster.origin[2]
    depth = DEPTHS[thickness] if thickness else 0.5
    behind = np.flatnonzero(inside & (facing < -FACING))
    below = top - local[behind, 2]
    behind = behind[(below > -0.25) & (below < depth + 1)]
    if len(behind):
        depth = max(top - _median(local[behind, 2], samples.weights[behind]), SHEET)
    middle = np.array([*(low + high) / 2, top - depth / 2])
    halves = np.array([*(high - low) / 2, depth / 2])
    center = air.origin + air.cell * (raster.frame @ middle)
    return make_shapes(Kind.BOX, center[None], raster.frame, air.cell * halves)


def _median(values: Float64, weights: Float64) -> float:
    order = np.argsort(values, kind="stable")
    cumulative = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(cumulative, 0.5 * cumulative[-1])])
