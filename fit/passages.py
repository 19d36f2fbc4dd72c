"""Passages that the grid has closed: too narrow for a free cell, yet light goes through them.

A cell within half a cell of a surface is solid, so an opening under two cells may hold no free cell. Rays
across the solid cells between two free ones find it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fit.bvh import TriangleTree
from fit.grid import Grid
from fit.rays import RayCaster
from fit.scene import Float64

Bool = NDArray[np.bool_]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]

DEEPEST = 4
"""Solid cells that a ray crosses at most: walls of up to about three cells."""

DETOUR = 3
"""Cells around a solid one through which two free ones may meet: an edge or a rod is no passage."""

LEAST_AREA = 0.3
"""Square cells: smaller openings than this are the seams of the model. A deep slit that lies askew to all
directions lets few rays through and counts as smaller than it is."""

MOST_REPORTED = 8

_DIRECTIONS = np.array([d for d in np.ndindex(3, 3, 3) if d > (1, 1, 1)]) - 1
"""To a cell's neighbours, opposites aside: some run along a deep slit, however it is turned."""

_CROSSINGS = 9.0
"""Lines along these from the centres of all cells, that cross a square cell of any plane: 8.7 to 9."""

_BORDER = DEEPEST + DETOUR + 2
_MOST_STARTS = 40_000
_SEGMENTS_FOR_WIDTH = 32
_STEPS_ALONG = 10


@dataclass(frozen=True)
class Passage:
    """A point (3,) in it, its width in m, its area in m2, and the numbers of the spaces on its two sides."""

    point: tuple[float, float, float]
    width: float
    area: float
    joins: tuple[int, int]


def find_passages(
    grid: Grid, label: Int32, air_labels: tuple[int, ...], tree: TriangleTree, rays: RayCaster
) -> list[Passage]:
    """Closed passages with air on one side at least, the largest first; `label` (nx, ny, nz) as in `Air`.

    Rays go from a random place of one free cell to one of the other: no regular crack lies between them all.
    """
    rng = np.random.default_rng(0)
    padded = np.pad(label, _BORDER)
    start, end, sampled = _pairs(padded, air_labels, rng)
    start_point, end_point = (
        grid.centers(cells - _BORDER) + grid.cell * _in_ball(len(cells), rng) for cells in (start, end)
    )
    open_ = np.flatnonzero(rays.visible(start_point, end_point))
    open_ = open_[~_meet_nearby(padded, start[open_], end[open_])]
    if len(open_) == 0:
        return []
    cluster = _clusters(padded.shape, start[open_], end[open_])
    area = np.bincount(cluster) / sampled / _CROSSINGS
    found = []
    for number in np.argsort(-area, kind="stable")[:MOST_REPORTED]:
        if area[number] < LEAST_AREA:
            break
        rows = open_[cluster == number]
        sides = sorted(int(padded[tuple(cells[rows[0]])]) for cells in (start, end))
        rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), _SEGMENTS_FOR_WIDTH)).astype(np.int64)]
        width, point = _width(tree, start_point[rows], end_point[rows])
        found.append(Passage(point, width, float(area[number]) * grid.cell**2, (sides[0], sides[1])))
    return found


def _pairs(label: Int32, air_labels: tuple[int, ...], rng: np.random.Generator) -> tuple[Int64, Int64, float]:
    """Free cells (n, 3), (n, 3) in line with 1 to DEEPEST solid ones between, one of them in air.

    Their lines start at a share of the free cells beside solid ones, which is returned too.
    """
    free, is_air = label > 0, np.isin(label, air_labels)
    beside = np.argwhere(free & ndimage.binary_dilation(~free, np.ones((3, 3, 3), bool)))
    sampled = min(1.0, _MOST_STARTS / max(len(beside), 1))
    inside = np.all((beside >= _BORDER) & (beside < np.array(label.shape) - _BORDER), axis=1)
    beside = beside[inside]
    if sampled < 1:
        beside = beside[np.sort(rng.choice(len(beside), int(sampled * len(beside)), replace=False))]
    starts, ends = [beside[:0]], [beside[:0]]
    for direction in _DIRECTIONS:
        start = beside[~free[tuple((beside + direction).T)]]
        for gap in range(1, DEEPEST + 1):
            end = start + (gap + 1) * direction
            reached = free[tuple(end.T)]
            seen = reached & (is_air[tuple(start.T)] | is_air[tuple(end.T)])
            starts.append(start[seen])
            ends.append(end[seen])
            start = start[~reached]
    return np.concatenate(starts), np.concatenate(ends), sampled


def _in_ball(count: int, rng: np.random.Generator) -> Float64:
    """Points (count, 3) uniform in a ball of nearly half a cell: around a free centre that much is empty."""
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    return 0.49 * np.cbrt(rng.random(count))[:, None] * direction


def _meet_nearby(label: Int32, start: Int64, end: Int64) -> Bool:
    """Whether start and end (n, 3) also meet through free cells along a line beside theirs."""
    met = np.zeros(len(start), bool)
    length = np.abs(end - start).max(axis=1)
    step = np.sign(end - start)
    for aside in np.concatenate([np.eye(3, dtype=np.int64), -np.eye(3, dtype=np.int64)]):
        reach = np.ones(len(start), bool)  # free cells all the way aside, at both ends
        for offset in range(1, DETOUR + 1):
            corner = start + offset * aside
            reach &= (label[tuple(corner.T)] > 0) & (label[tuple((end + offset * aside).T)] > 0)
            line = reach.copy()
            for k in range(1, DEEPEST + 1):
                line &= label[tuple((corner + np.minimum(k, length)[:, None] * step).T)] > 0
            met |= line
    return met


def _clusters(shape: tuple[int, ...], start: Int64, end: Int64) -> Int64:
    """Number (n,) of the connected group of cells about the middle of each pair (n, 3), (n, 3)."""
    marked = np.zeros(shape, bool)
    middle = tuple(((start + end) // 2).T)
    marked[middle] = True
    return ndimage.label(ndimage.binary_dilation(marked, iterations=2))[0][middle].astype(np.int64) - 1


def _width(tree: TriangleTree, start: Float64, end: Float64) -> tuple[float, tuple[float, float, float]]:
    """Twice the most room that any segment (n, 3), (n, 3) has where it is closest to a surface; and there."""
    low, high = np.zeros(len(start)), np.ones(len(start))
    rows = np.arange(len(start))
    for _ in range(3):  # ever closer around each segment's narrowest place
        share = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, _STEPS_ALONG)
        points = start[:, None] + share[:, :, None] * (end - start)[:, None]
        room = tree.nearest(points.reshape(-1, 3))[0].reshape(share.shape)
        narrowest = room.argmin(axis=1)
        low = share[rows, np.maximum(narrowest - 1, 0)]
        high = share[rows, np.minimum(narrowest + 1, _STEPS_ALONG - 1)]
    widest = int(room.min(axis=1).argmax())
    x, y, z = points[widest, narrowest[widest]].tolist()
    return 2 * float(room[widest, narrowest[widest]]), (x, y, z)
