"""Boxes grown on a grid through the space that is not air, many seeds at once by integral volumes.

A box may take everything that no air is in: surfaces, the inside of solids, and the space behind walls that
nobody sees. It stops where its next layer of cells holds more than a tolerated share of air. What it gains is
the surface inside; afterwards its faces snap to the surface that they stand for.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from fit.objective import Targets, penalties
from fit.primitives import Kind
from fit.scene import Float64
from fit.shapes import Shapes, join, make_shapes
from fit.spaces import Air

Int64 = NDArray[np.int64]

SEEDS = 400
"""Points, drawn by the error there, that boxes are grown from at a time."""

TOLERATED_AIR = (0.0, 0.01, 0.03)
"""Shares of air that a layer may hold: 0 for clean walls; more bridges mouldings, foliage and arches."""

STRIDES = (16, 4, 1)
"""Cells that a face tries to advance by: long strides first."""

ACROSS = 3.0
"""Cells of the grid that a face may snap over: the surface lies within half a cell, tolerance adds layers."""

FACING = 0.7
"""Cosine between a face and the surface that it may snap to."""


@dataclass(frozen=True)
class Lattice:
    """Cells aligned with `frame` (columns: axes in the world); counts are integral volumes, zero-bordered.

    origin (3,) in the frame, cell in metres, shape (3,) cells; air and occupied (mesh inside the cell).
    """

    frame: Float64
    origin: Float64
    cell: float
    shape: Int64
    is_air: NDArray[np.bool_]
    air: Float64
    occupied: Float64

    def cells_of(self, points: Float64) -> Int64:
        """Cells (p, 3) of world points, clipped to the lattice."""
        cells = np.floor((points @ self.frame - self.origin) / self.cell).astype(np.int64)
        return np.clip(cells, 0, self.shape - 1)


def make_lattice(air: Air, frame: Float64, cell: float, lower: Float64, upper: Float64) -> Lattice:
    """The air seen on a grid aligned with `frame`, around a world box and three cells more."""
    corners = np.array([[(lower, upper)[b >> k & 1][k] for k in range(3)] for b in range(8)]) @ frame
    origin = corners.min(axis=0) - 3 * cell
    shape = np.ceil((corners.max(axis=0) - origin) / cell).astype(np.int64) + 3
    axes = [origin[k] + cell * (np.arange(shape[k]) + 0.5) for k in range(3)]
    is_air, occupied = np.empty(shape, bool), np.empty(shape, bool)
    limit = np.array(air.grid.shape) - 1
    for i, x in enumerate(axes[0]):  # slice by slice: a rotated grid of a large scene is millions of points
        y, z = np.meshgrid(axes[1], axes[2], indexing="ij")
        world = np.stack([np.full(y.size, x), y.ravel(), z.ravel()], axis=1) @ frame.T
        cells = np.clip(np.floor((world - air.origin) / air.cell).astype(np.int64), 0, limit)
        at = (cells[:, 0], cells[:, 1], cells[:, 2])
        is_air[i] = air.free[at].reshape(y.shape)
        occupied[i] = (air.label[at] == 0).reshape(y.shape)
    return Lattice(frame, origin, cell, shape, is_air, _integral(is_air), _integral(occupied))


def _integral(values: NDArray[np.generic]) -> Float64:
    total = np.zeros(np.array(values.shape) + 1)
    total[1:, 1:, 1:] = np.cumsum(np.cumsum(np.cumsum(values, 0, dtype=np.float64), 1), 2)
    return total


def _inside(total: Float64, lower: Int64, upper: Int64) -> Float64:
    """Sum over the cells of boxes lower..upper (n, 3), the upper corner left out (Crow 1984, in 3D)."""
    (x0, y0, z0), (x1, y1, z1) = lower.T, upper.T
    return (
        total[x1, y1, z1] - total[x0, y1, z1] - total[x1, y0, z1] - total[x1, y1, z0]
        + total[x0, y0, z1] + total[x0, y1, z0] + total[x1, y0, z0] - total[x0, y0, z0]
    )  # fmt: skip


def propose_boxes(
    lattices: list[Lattice], targets: Targets, distances: Float64, rng: np.random.Generator
) -> Shapes:
    """Boxes grown from points drawn in proportion to their error in a set at `distances` (p,)."""
    seeds = _worst(targets, distances, rng)
    shares = np.array_split(rng.permutation(seeds), len(lattices)) if len(lattices) > 1 else [seeds]
    return join(
        [grow_boxes(lattice, targets, np.sort(own)) for lattice, own in zip(lattices, shares, strict=True)]
    )


def _worst(targets: Targets, distances: Float64, rng: np.random.Generator) -> Int64:
    chance = np.where(targets.is_surface | targets.is_ray, penalties(targets, distances), 0.0)
    total = float(chance.sum())
    if not total > 0:
        return np.zeros(0, np.int64)
    count = min(SEEDS, int(np.count_nonzero(chance)))
    return np.sort(rng.choice(len(chance), size=count, replace=False, p=chance / total)).astype(np.int64)


def grow_boxes(lattice: Lattice, targets: Targets, seeds: Int64, *, keep_per_seed: int = 2) -> Shapes:
    """Boxes from surface targets `seeds` (rows), snapped to the surface; the best few ways to grow each seed.

    Every order of the axes is tried: thickness first gives blocks, thickness last gives walls.
    """
    inward = targets.points[seeds] - 0.5 * lattice.cell * targets.normals[seeds]
    cells = lattice.cells_of(inward)
    usable = np.flatnonzero(~lattice.is_air[tuple(cells.T)])
    cells = cells[usable]
    if len(cells) == 0:
        return join([])
    surface = _surface_weights(lattice, targets)
    ways = [(order, share) for share in TOLERATED_AIR for order in permutations(range(3))]
    grown = [_trimmed(lattice, *_grown(lattice, cells, order, share)) for order, share in ways]
    scores = np.stack([_score(lattice, surface, lo, hi) for lo, hi in grown], axis=1)
    kept = np.argsort(-scores, axis=1, kind="stable")[:, :keep_per_seed]
    lower, upper = np.stack([g[0] for g in grown], axis=1), np.stack([g[1] for g in grown], axis=1)
    rows = np.arange(len(cells))[:, None]
    boxes = np.concatenate([lower[rows, kept], upper[rows, kept]], axis=2).reshape(-1, 6)
    boxes = np.unique(boxes[scores[rows, kept].ravel() > 0], axis=0)
    return _snapped(lattice, targets, boxes[:, :3], boxes[:, 3:])


def _surface_weights(lattice: Lattice, targets: Targets) -> Float64:
    rows = np.flatnonzero(targets.is_surface)
    cells = lattice.cells_of(targets.points[rows] - 0.25 * lattice.cell * targets.normals[rows])
    weights = np.zeros(lattice.shape)
    np.add.at(weights, tuple(cells.T), targets.weights[rows])
    return _integral(weights)


def _score(lattice: Lattice, surface: Float64, lower: Int64, upper: Int64) -> Float64:
    """Surface weight inside, less the air inside, a cell of air counting like two of surface."""
    mean = surface[-1, -1, -1] / max(lattice.occupied[-1, -1, -1], 1.0)
    return _inside(surface, lower, upper) - 2 * mean * _inside(lattice.air, lower, upper)


def _grown(lattice: Lattice, cells: Int64, order: tuple[int, ...], share: float) -> tuple[Int64, Int64]:
    lower, upper = cells.copy(), cells + 1
    for axis in order:
        for stride in STRIDES:
            active = np.ones((len(cells), 2), bool)
            while active.any():
                for side in (0, 1):
                    rows = np.flatnonzero(active[:, side])
                    active[rows, side] = _advance(lattice, lower, upper, rows, axis, side, stride, share)
    return lower, upper


def _advance(
    lattice: Lattice, lower: Int64, upper: Int64, rows: Int64, axis: int, side: int, stride: int, share: float
) -> NDArray[np.bool_]:
    """Moves one face of boxes `rows` outward where the new layer is free of air; True where it moved."""
    layer_lower, layer_upper = lower[rows], upper[rows]
    if side == 0:
        layer_upper[:, axis] = layer_lower[:, axis]
        layer_lower[:, axis] -= stride
    else:
        layer_lower[:, axis] = layer_upper[:, axis]
        layer_upper[:, axis] += stride
    fits = (layer_lower[:, axis] >= 0) & (layer_upper[:, axis] <= lattice.shape[axis])
    rows, layer_lower, layer_upper = rows[fits], layer_lower[fits], layer_upper[fits]
    air = _inside(lattice.air, layer_lower, layer_upper)
    moves = air <= share * np.prod(layer_upper - layer_lower, axis=1)
    if side == 0:
        lower[rows[moves], axis] = layer_lower[moves, axis]
    else:
        upper[rows[moves], axis] = layer_upper[moves, axis]
    fits[fits] = moves
    return fits


def _trimmed(lattice: Lattice, lower: Int64, upper: Int64) -> tuple[Int64, Int64]:
    """Boxes without the outer layers in which there is no mesh, but for one: no wall fills all the unseen."""
    inner_lower, inner_upper = lower.copy(), upper.copy()
    for axis in range(3):
        for side in (0, 1):
            for stride in STRIDES:
                active = np.arange(len(lower))
                while len(active):
                    lo, hi = inner_lower[active], inner_upper[active]
                    wide = hi[:, axis] - lo[:, axis] > stride
                    active, lo, hi = active[wide], lo[wide], hi[wide]
                    if side == 0:
                        hi[:, axis] = lo[:, axis] + stride
                    else:
                        lo[:, axis] = hi[:, axis] - stride
                    active = active[_inside(lattice.occupied, lo, hi) == 0]
                    if side == 0:
                        inner_lower[active, axis] += stride
                    else:
                        inner_upper[active, axis] -= stride
    return np.maximum(lower, inner_lower - 1), np.minimum(upper, inner_upper + 1)


# ------------------------------------------------------------------------------------------------- snap


def _snapped(lattice: Lattice, targets: Targets, lower: Int64, upper: Int64) -> Shapes:
    """Boxes in metres, each face at the median of the surface that faces along it nearby."""
    rows = np.flatnonzero(targets.is_surface)
    points = (targets.points[rows] @ lattice.frame - lattice.origin) / lattice.cell
    normals, weights = targets.normals[rows] @ lattice.frame, targets.weights[rows]
    low, high = lower.astype(np.float64), upper.astype(np.float64)
    groups = {
        (axis, sign): np.flatnonzero(sign * normals[:, axis] > FACING)
        for axis in range(3)
        for sign in (-1, 1)
    }
    result_low, result_high = low.copy(), high.copy()
    for (axis, sign), members in groups.items():
        others = [k for k in range(3) if k != axis]
        p, w = points[members], weights[members]
        order = np.argsort(p[:, axis], kind="stable")
        p, w = p[order], w[order]
        faces = low[:, axis] if sign < 0 else high[:, axis]
        first, last = (np.searchsorted(p[:, axis], faces + d) for d in (-ACROSS, ACROSS))
        for i in range(len(low)):
            near = p[first[i] : last[i]]
            inside = np.all((near[:, others] > low[i, others]) & (near[:, others] < high[i, others]), axis=1)
            if inside.any():
                face = _weighted_median(near[inside, axis], w[first[i] : last[i]][inside])
                (result_low if sign < 0 else result_high)[i, axis] = face
    thin = result_high - result_low < 0.05  # both faces of a sheet snap to the same plane
    middle = (result_low + result_high) / 2
    result_low, result_high = (
        np.where(thin, middle - 0.025, result_low),
        np.where(thin, middle + 0.025, result_high),
    )
    centers = (lattice.origin + lattice.cell * (result_low + result_high) / 2) @ lattice.frame.T
    return make_shapes(Kind.BOX, centers, lattice.frame, lattice.cell * (result_high - result_low) / 2)


def _weighted_median(sorted_values: Float64, weights: Float64) -> float:
    cumulative = np.cumsum(weights)
    return float(sorted_values[np.searchsorted(cumulative, 0.5 * cumulative[-1])])
