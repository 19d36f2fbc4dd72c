"""Passages that the grid has closed: too narrow for a free cell, yet light goes through them.

A cell within half a cell of a surface is solid, so an opening under two cells may hold no free cell. Rays
across the solid cells between two free ones find it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

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

LEAST_AREA = 2.0
"""Square cells: smaller openings than this are the seams of the model."""

MOST_REPORTED = 8

_MOST_RAYS = 120_000
_RAYS_FOR_WIDTH = 24
_STEPS_ALONG = 5
_CHORDS = 12
_STEPS = np.eye(3, dtype=np.int64)


@dataclass(frozen=True)
class Passage:
    """A point (3,) in it, its width in m, its area in m2, and the numbers of the spaces on its two sides."""

    point: tuple[float, float, float]
    width: float
    area: float
    joins: tuple[int, int]


def find_passages(grid: Grid, label: Int32, air_labels: tuple[int, ...], rays: RayCaster) -> list[Passage]:
    """Closed passages with air on one side at least, the largest first; `label` (nx, ny, nz) as in `Air`.

    Rays go from a random place of one free cell to one of the other: no regular crack lies between them all.
    """
    rng = np.random.default_rng(0)
    start, end = _pairs(label, air_labels)
    sampled = min(1.0, _MOST_RAYS / max(len(start), 1))
    if sampled < 1:
        chosen = np.sort(rng.choice(len(start), _MOST_RAYS, replace=False))
        start, end = start[chosen], end[chosen]
    from_point, to_point = (grid.centers(c) + grid.cell * _in_ball(len(c), rng) for c in (start, end))
    open_ = np.flatnonzero(rays.visible(from_point, to_point))
    open_ = open_[~_meet_nearby(label, start[open_], end[open_])]
    if len(open_) == 0:
        return []
    cluster = _clusters(grid, start[open_], end[open_])
    found = []
    for number in range(int(cluster.max()) + 1):
        rows = open_[cluster == number]
        area = len(rows) / sampled * grid.cell**2
        if area < LEAST_AREA * grid.cell**2:
            continue
        rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), _RAYS_FOR_WIDTH)).astype(np.int64)]
        width, point = _narrowest(rays, from_point[rows], to_point[rows], 3 * grid.cell)
        sides = sorted({int(label[tuple(c[rows[0]])]) for c in (start, end)})
        found.append(Passage(point, width, area, (sides[0], sides[-1])))
    return sorted(found, key=lambda p: -p.area)[:MOST_REPORTED]


def _pairs(label: Int32, air_labels: tuple[int, ...]) -> tuple[Int64, Int64]:
    """Free cells (n, 3), (n, 3) in line along an axis with 1 to DEEPEST solid ones between, one in air."""
    is_free, is_air = label > 0, np.isin(label, air_labels)
    starts, ends = [], []
    for axis in range(3):
        size = label.shape[axis]
        between = np.ones(label.shape, bool)
        for gap in range(1, min(DEEPEST, size - 2) + 1):
            first, last = (_part(axis, a, size - gap - 1 + a) for a in (0, gap + 1))
            between = between[_part(axis, 0, size - gap - 1)] & ~is_free[_part(axis, gap, size - 1)]
            pair = between & is_free[first] & is_free[last] & (is_air[first] | is_air[last])
            cells = np.argwhere(pair)
            starts.append(cells)
            ends.append(cells + (gap + 1) * _STEPS[axis])
    return np.concatenate(starts), np.concatenate(ends)


def _part(axis: int, start: int, stop: int) -> tuple[slice, ...]:
    return tuple(slice(start, stop) if k == axis else slice(None) for k in range(3))


def _in_ball(count: int, rng: np.random.Generator) -> Float64:
    """Points (count, 3) uniform in a ball of nearly half a cell: around a free centre that much is empty."""
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    return 0.49 * np.cbrt(rng.random(count))[:, None] * direction


def _meet_nearby(label: Int32, start: Int64, end: Int64) -> Bool:
    """Whether start and end (n, 3) also meet through free cells around the solid ones between them."""
    met = np.zeros(len(start), bool)
    step = np.sign(end - start)
    length = np.abs(end - start).max(axis=1)
    limit = np.array(label.shape) - 1
    for turn in (1, 2):
        aside = np.roll(step, turn, axis=1)
        for side in (-1, 1):
            reach = np.ones(len(start), bool)  # free cells all the way aside, at both ends
            for offset in range(1, DETOUR + 1):
                corner = start + side * offset * aside
                inside = np.all((corner >= 0) & (corner <= limit), axis=1)
                line = np.ones(len(start), bool)
                for k in range(DEEPEST + 2):
                    cell = np.clip(corner + np.minimum(k, length)[:, None] * step, 0, limit)
                    is_free = label[tuple(cell.T)] > 0
                    line &= is_free
                    if k == 0:
                        reach &= is_free & inside
                last = np.clip(end + side * offset * aside, 0, limit)
                reach &= label[tuple(last.T)] > 0
                met |= reach & line
    return met


def _clusters(grid: Grid, start: Int64, end: Int64) -> Int64:
    """Number (n,) of the connected group of solid cells that each pair (n, 3), (n, 3) crosses."""
    marked = np.zeros(grid.shape, bool)
    middle = (start + end) // 2
    marked[tuple(middle.T)] = True
    groups = ndimage.label(ndimage.binary_dilation(marked, iterations=2))[0]
    return groups[tuple(middle.T)].astype(np.int64) - 1


def _narrowest(
    rays: RayCaster, start: Float64, end: Float64, widest: float
) -> tuple[float, tuple[float, float, float]]:
    """Median over segments (n, 3), (n, 3) of the shortest chord across each, and the middle of that chord."""
    along = end - start
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along /= length
    helper = np.eye(3)[np.abs(along).argmin(axis=1)]
    u = np.cross(along, helper)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(along, u)
    width, point = np.full(len(start), np.inf), (start + end) / 2
    for share in (np.arange(_STEPS_ALONG) + 0.5) / _STEPS_ALONG:
        at = start + share * (end - start)
        for angle in np.arange(_CHORDS) * np.pi / _CHORDS:
            direction = np.cos(angle) * u + np.sin(angle) * v
            ahead, behind = (
                np.minimum(rays.first_hit(at, sign * direction)[0], widest) for sign in (1.0, -1.0)
            )
            shorter = ahead + behind < width
            width[shorter] = (ahead + behind)[shorter]
            point[shorter] = (at + ((ahead - behind) / 2)[:, None] * direction)[shorter]
    middle = int(np.argsort(width, kind="stable")[len(width) // 2])
    x, y, z = point[middle].tolist()
    return float(width[middle]), (x, y, z)
