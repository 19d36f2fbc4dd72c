"""A grid of cubic cells around a surface, and which of them the surface fills."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.bvh import boxes_around, cut_long_triangles
from fit.scene import Float64
from fit.triangle import plane_frames, squared_distances

Bool = NDArray[np.bool_]
Int64 = NDArray[np.int64]

PADDING_CELLS = 5
"""Cells of free space around the bounds, so that an object has an outside."""

MAX_CELLS = 12_000_000

_PIECES_PER_CHUNK = 1 << 16
_PAIRS_PER_CHUNK = 1 << 18


@dataclass(frozen=True)
class Grid:
    """`shape` cubes of edge `cell`; `origin` (3,) is the lower corner of the first."""

    origin: Float64
    cell: float
    shape: tuple[int, int, int]

    @classmethod
    def around(cls, lower: Float64, upper: Float64, resolution: float) -> Grid:
        """The grid whose cell is the box's diagonal over `resolution`, larger to stay under MAX_CELLS."""
        diagonal = float(np.linalg.norm(upper - lower))
        if not np.isfinite(diagonal) or diagonal <= 0:
            raise ValueError(f"no grid fits bounds of diagonal {diagonal}: the surface has no extent")
        while True:
            cell = diagonal / resolution
            counts = np.ceil((upper - lower) / cell).astype(np.int64) + 2 * PADDING_CELLS
            if np.prod(counts.astype(float)) <= MAX_CELLS:
                break
            resolution *= 0.95
        origin = (lower + upper) / 2 - counts * cell / 2
        return cls(origin, cell, (int(counts[0]), int(counts[1]), int(counts[2])))

    def cells_of(self, points: Float64) -> Int64:
        """Integer coordinates (p, 3) of the cells that hold the points; they may lie outside the grid."""
        return np.floor((points - self.origin) / self.cell).astype(np.int64)

    def centers(self, cells: Int64) -> Float64:
        """Centres (p, 3) of cells (p, 3)."""
        return self.origin + (cells + 0.5) * self.cell

    def holds(self, cells: Int64) -> Bool:
        """Which of the cells (p, 3) lie in the grid."""
        return np.all((cells >= 0) & (cells < self.shape), axis=1)

    def flat(self, cells: Int64) -> Int64:
        """Indices (p,) of cells (p, 3) into the raveled grid, clipped to it."""
        clipped = np.clip(cells, 0, np.array(self.shape) - 1)
        return np.ravel_multi_index(tuple(clipped.T), self.shape)


def solid_cells(grid: Grid, vertices: Float64) -> Bool:
    """Cells (nx, ny, nz) whose centre lies within half a cell of the triangles (t, 3, 3).

    A step between the centres of two cells that share a face is one cell long. Where it crosses a triangle,
    one of its ends lies within half a cell of the crossing: so no step between free cells crosses any.
    """
    solid = np.zeros(grid.shape, bool)
    lower, upper = boxes_around(vertices)
    spans = (upper - lower).max(axis=1) / grid.cell
    pieces = np.cumsum(1 + spans + 0.5 * spans**2)
    chunks = np.searchsorted(pieces, np.arange(_PIECES_PER_CHUNK, pieces[-1], _PIECES_PER_CHUNK))
    for part in np.split(np.arange(len(vertices)), np.unique(chunks)):
        corners = (vertices[part] - grid.origin) / grid.cell
        _mark_at_corners(corners, solid)
        _mark(corners, solid)
    return solid


def _mark_at_corners(corners: Float64, solid: Bool) -> None:
    """Marks cells that have a corner near their centre: of a fine mesh nearly all are done with that."""
    points = corners[:, 0]
    cells = np.floor(points)
    offset = points - cells - 0.5
    near = np.einsum("ij,ij->i", offset, offset) <= 0.25
    solid[tuple(cells[near].astype(np.int64).T)] = True


def _mark(corners: Float64, solid: Bool) -> None:
    """Marks the cells near triangles given in units of cells from the grid's corner."""
    pieces, owner = cut_long_triangles(corners, longest=2.0)
    # Centres lie at half-integers; those within half a cell of a piece lie in its box grown by as much.
    lower, upper = boxes_around(pieces)
    low: Int64 = np.ceil(lower - 1.0 - 1e-9).astype(np.int64)
    count = np.floor(upper + 1e-9).astype(np.int64) - low + 1
    np.maximum(count, 0, out=count)
    pairs = count[:, 0] * count[:, 1] * count[:, 2]
    for part in np.array_split(np.arange(len(pairs)), int(pairs.sum()) // _PAIRS_PER_CHUNK + 1):
        member, cells = _cells_of_boxes(low[part], count[part], pairs[part])
        free = ~solid[tuple(cells.T)]
        cells, triangle = cells[free], owner[part][member[free]]
        squared = squared_distances((cells + 0.5).astype(np.float64), plane_frames(corners[triangle]))
        solid[tuple(cells[squared <= 0.25 * (1 + 1e-9)].T)] = True


def _cells_of_boxes(low: Int64, count: Int64, pairs: Int64) -> tuple[Int64, Int64]:
    """All cells of boxes of `count` (b, 3) cells from `low` (b, 3): the box of each, and the cell (n, 3)."""
    member = np.repeat(np.arange(len(pairs)), pairs)
    place = np.arange(len(member)) - np.repeat(np.cumsum(pairs) - pairs, pairs)
    depth, height = count[member, 2], count[member, 1]
    offset = np.stack([place // (depth * height), place // depth % height, place % depth], axis=1)
    return member, low[member] + offset
