"""Exact nearest points and first hits on triangles: a bounding volume hierarchy walked level by level.

All queries of a batch descend together, so each level is a handful of NumPy calls on (query, node) pairs.
The leaves lie along a Morton curve; a k-d tree over a few of them gives the first upper bound of a distance.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fit.scene import Float64
from fit.triangle import length, plane_frames, ray_distances, squared_distances

Int64 = NDArray[np.int64]

BRANCHES = 4
"""Children of a node: measured fastest of 2, 4 and 8."""

_PIECES_PER_DIAGONAL = 64
"""Triangles longer than this share of the diagonal enter the tree in pieces, so that boxes stay tight."""

_MAX_EXTRA_PIECES = 300_000

_MOST_GUESSES = 1 << 17
"""Leaves in the k-d tree of first guesses: of millions, all would take longer to search than the boxes."""

_MOST_FRAMES = 300_000
"""Triangles whose planes are all worked out beforehand: 30 MB; of more, only those that are asked for."""

_QUERIES_AT_ONCE, _PAIRS_AT_ONCE = 1 << 13, 1 << 15
"""Points, and pairs of a point or ray and a node, that are looked at together, lest they fill the memory."""

_ROUNDING = 1e-14
"""Of the squared diagonal: how far squared distances may be off."""


@dataclass(frozen=True)
class _Leaves:
    """Triangles (n,) of the leaves, boxes of each level, the tree of first guesses and their triangles."""

    triangles: Int64
    levels: list[Float64]
    guesses: cKDTree
    guessed: Int64


class TriangleTree:
    """A search tree over t triangles (t, 3, 3), t > 0, which it keeps without a copy."""

    def __init__(self, vertices: Float64) -> None:
        if len(vertices) == 0:
            raise ValueError("a triangle tree needs at least one triangle; the surface is empty")
        low, high = column_extremes(vertices.reshape(-1, 3))
        self.center = (low + high) / 2
        self.diagonal = float(np.linalg.norm(high - low))
        self._vertices = vertices

    @cached_property
    def _leaves(self) -> _Leaves:
        """What is searched: made when first asked, since some ask for the extent alone."""
        boxes, owner = self._leaf_boxes(np.concatenate(boxes_around(self._vertices), axis=1))
        order = morton_order(boxes[:, :3] + boxes[:, 3:])
        owner, boxes = owner[order], boxes[order]
        stride = -(-len(boxes) // _MOST_GUESSES)
        guesses = cKDTree((boxes[::stride, :3] + boxes[::stride, 3:]) / 2)
        return _Leaves(owner, _box_levels(boxes), guesses, owner[::stride])

    def _leaf_boxes(self, boxes: Float64) -> tuple[Float64, Int64]:
        """Boxes (n, 6) about the tree's centre, of triangles or, of long ones, pieces; their owners."""
        longest = self.diagonal / _PIECES_PER_DIAGONAL
        is_long = length(boxes[:, 3:] - boxes[:, :3]) > longest
        boxes -= np.tile(self.center, 2)
        if not is_long.any():
            return boxes, np.arange(len(boxes))
        long, short = np.flatnonzero(is_long), np.flatnonzero(~is_long)
        pieces, owner = cut_long_triangles(self._vertices[long] - self.center, longest, _MAX_EXTRA_PIECES)
        cut = np.concatenate(boxes_around(pieces), axis=1)
        return np.concatenate([boxes[short], cut]), np.concatenate([short, long[owner]])

    def _frames(self, triangles: Int64) -> Float64:
        if len(self._vertices) <= _MOST_FRAMES:
            return self._all_frames[triangles]
        return plane_frames(self._vertices[triangles] - self.center)

    @cached_property
    def _all_frames(self) -> Float64:
        return plane_frames(self._vertices - self.center)

    def nearest(self, points: Float64, within: float = np.inf) -> tuple[Float64, Int64]:
        """Unsigned distance (p,) from points (p, 3) to the triangles, and the nearest triangle (p,).

        Beyond `within`, any triangle and its distance may stand for the nearest: that is told sooner.
        """
        points = points - self.center
        distance, triangle = np.empty(len(points)), np.empty(len(points), np.int64)
        for start in range(0, len(points), _QUERIES_AT_ONCE):
            part = slice(start, start + _QUERIES_AT_ONCE)
            distance[part], triangle[part] = self._nearest_chunk(points[part], within)
        return distance, triangle

    def _nearest_chunk(self, points: Float64, within: float) -> tuple[Float64, Int64]:
        guess = self._leaves.guessed[self._leaves.guesses.query(points)[1]]
        guessed = squared_distances(points, self._frames(guess))
        slack = _ROUNDING * (self.diagonal**2 + guessed)
        limit = np.minimum(np.nextafter(guessed, 0), within**2 + slack)
        if len(self._leaves.guessed) < len(self._leaves.triangles):
            limit = np.minimum(limit, self._descended(points) + slack)
        best = _Best(limit, slack)
        self._search(points, best, 0, np.arange(len(points)), np.zeros(len(points), np.int64))
        better = best.squared < guessed
        return np.sqrt(np.where(better, best.squared, guessed)), np.where(better, best.triangle, guess)

    def _descended(self, points: Float64) -> Float64:
        """Squared distance (p,) to the triangle of the leaf reached through the nearest box of each level."""
        node = np.zeros(len(points), np.int64)
        for boxes in self._leaves.levels:
            node = node * BRANCHES + _squared_distances_to_boxes(points, boxes[node]).argmin(axis=1)
        return squared_distances(points, self._frames(self._leaves.triangles[node]))

    def _search(self, points: Float64, best: _Best, level: int, query: Int64, node: Int64) -> None:
        """Lowers the best of each query by the triangles under its node of a level."""
        if len(query) > _PAIRS_AT_ONCE:
            for start in range(0, len(query), _PAIRS_AT_ONCE):
                part = slice(start, start + _PAIRS_AT_ONCE)
                self._search(points, best, level, query[part], node[part])
        elif level < len(self._leaves.levels):
            squared = _squared_distances_to_boxes(points[query], self._leaves.levels[level][node])
            row, child = np.nonzero(squared <= best.limit[query, None])
            self._search(points, best, level + 1, query[row], node[row] * BRANCHES + child)
        elif len(query):
            triangle = self._leaves.triangles[node]
            best.lower(query, squared_distances(points[query], self._frames(triangle)), triangle)

    def first_hit(self, origins: Float64, directions: Float64) -> tuple[Float64, Int64]:
        """Distance (p,) along unit directions (p, 3) to the first triangle, and its row; inf and -1: none."""
        origins = origins - self.center
        distance, triangle = np.empty(len(origins)), np.empty(len(origins), np.int64)
        chunk = _QUERIES_AT_ONCE // 2
        for start in range(0, len(origins), chunk):
            part = slice(start, start + chunk)
            distance[part], triangle[part] = self._first_hit_chunk(origins[part], directions[part])
        return distance, triangle

    def _first_hit_chunk(self, origins: Float64, directions: Float64) -> tuple[Float64, Int64]:
        with np.errstate(divide="ignore"):
            inverse = 1.0 / np.where(directions == 0, 1e-300, directions)
        distance, triangle = np.full(len(origins), np.inf), np.full(len(origins), -1, np.int64)
        query, node = np.arange(len(origins)), np.zeros(len(origins), np.int64)
        for boxes in self._leaves.levels:
            row, child = np.nonzero(_rays_meet_boxes(origins[query], inverse[query], boxes[node]))
            query, node = query[row], node[row] * BRANCHES + child
        candidates = self._leaves.triangles[node]
        along = ray_distances(origins[query], directions[query], self._frames(candidates))
        order = np.lexsort((candidates, along, query))
        order = order[np.diff(query[order], prepend=-1) != 0]
        order = order[np.isfinite(along[order])]
        distance[query[order]], triangle[query[order]] = along[order], candidates[order]
        return distance, triangle


class _Best:
    """The nearest triangle (p,) met by each of p queries, the first of equally near ones, its squared
    distance (p,), and the limit (p,) beyond which no box is opened. Rounding puts some farther than what is
    in them, by `slack` (p,) at most."""

    def __init__(self, limit: Float64, slack: Float64) -> None:
        self.limit, self._slack = limit, slack
        self.squared, self.triangle = np.full(len(limit), np.inf), np.zeros(len(limit), np.int64)

    def lower(self, query: Int64, squared: Float64, triangle: Int64) -> None:
        """Takes the nearest of pairs (k,) in order of their queries."""
        first = np.flatnonzero(np.diff(query, prepend=-1))
        lowest, query = np.minimum.reduceat(squared, first), query[first]
        is_lowest = squared == np.repeat(lowest, np.diff(first, append=len(squared)))
        triangle = np.minimum.reduceat(np.where(is_lowest, triangle, np.iinfo(np.int64).max), first)
        old = self.squared[query]
        better = (lowest < old) | ((lowest == old) & (triangle < self.triangle[query]))
        query, lowest = query[better], lowest[better]
        self.squared[query], self.triangle[query] = lowest, triangle[better]
        self.limit[query] = np.minimum(self.limit[query], lowest + self._slack[query])


def cut_long_triangles(
    corners: Float64, longest: float, max_extra: int | None = None
) -> tuple[Float64, Int64]:
    """Triangles (t, 3, 3), halved at their longest edge until none exceeds `longest`, or `max_extra` are new.

    Returns the pieces (n, 3, 3) and the row of the triangle that each is from.
    """
    lower, upper = boxes_around(corners)
    is_long = (upper - lower).max(axis=1) > longest / 2  # no edge of the others exceeds sqrt(3) / 2
    rest, owner = np.flatnonzero(~is_long), np.flatnonzero(is_long)
    if len(owner) == 0:
        return corners, rest
    done, done_owner = [corners[rest]], [rest]
    corners = corners[owner]
    extra = 0
    while len(corners):
        edges = np.stack([length(corners[:, (k + 1) % 3] - corners[:, k]) for k in range(3)])
        long = np.maximum(np.maximum(edges[0], edges[1]), edges[2]) > longest
        extra += int(long.sum())
        if max_extra is not None and extra > max_extra:
            long[:] = False
        done.append(corners[~long])
        done_owner.append(owner[~long])
        corners, owner, edge = corners[long], owner[long], edges[:, long].argmax(axis=0)
        row = np.arange(len(corners))
        a, b, c = (corners[row, (edge + k) % 3] for k in range(3))
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
        owner = np.concatenate([owner, owner])
    return np.concatenate(done), np.concatenate(done_owner)


def column_extremes(points: Float64) -> tuple[Float64, Float64]:
    """Lowest and highest values (3,), (3,) of points (p, 3)."""
    columns = [points[:, k] for k in range(3)]  # NumPy reduces rows of three five times slower
    return np.array([c.min() for c in columns]), np.array([c.max() for c in columns])


def morton_order(points: Float64) -> Int64:
    """Order (p,) of points (p, 3) along a Z-shaped curve: its neighbours are near in space (Morton 1966)."""
    lower, upper = column_extremes(points)
    scale = ((1 << 21) - 1) / max(float((upper - lower).max()), np.finfo(float).tiny)
    columns = (((points[:, axis] - lower[axis]) * scale).astype(np.uint64) for axis in range(3))
    return np.argsort(morton_code(columns), kind="stable")


def morton_code(columns: Iterable[NDArray[np.integer]]) -> NDArray[np.uint64]:
    """Place (p,) along the curve of cells given by their three columns (p,), of at most 21 bits each."""
    code = np.zeros(1, np.uint64)
    for axis, column in enumerate(columns):
        bits = column.astype(np.uint64)
        for shift, mask in _SPREAD:
            bits = (bits | bits << np.uint64(shift)) & np.uint64(mask)
        code = code | bits << np.uint64(axis)
    return code


_SPREAD = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)
"""Shifts and masks that put two empty bits between any two of 21."""


def boxes_around(pieces: Float64) -> tuple[Float64, Float64]:
    """Lower and upper corners (n, 3), (n, 3) of the boxes around triangles (n, 3, 3)."""
    a, b, c = (pieces[:, k] for k in range(3))  # NumPy reduces a short axis ten times slower
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def _box_levels(boxes: Float64) -> list[Float64]:
    """Boxes of each level, root's children first, as (parents, BRANCHES, 6): lower then upper corner.

    The last level's are the given ones (n, 6) themselves; empty places hold a box at infinity.
    """
    levels: list[Float64] = []
    while True:
        padding = np.repeat([[np.inf] * 3 + [-np.inf] * 3], -len(boxes) % BRANCHES, axis=0)
        grouped = np.concatenate([boxes, padding]).reshape(-1, BRANCHES, 6)
        levels.insert(0, grouped)
        if len(grouped) == 1:
            return levels
        boxes = grouped[:, 0].copy()
        for child in range(1, BRANCHES):
            np.minimum(boxes[:, :3], grouped[:, child, :3], out=boxes[:, :3])
            np.maximum(boxes[:, 3:], grouped[:, child, 3:], out=boxes[:, 3:])


def _squared_distances_to_boxes(points: Float64, boxes: Float64) -> Float64:
    """(k, 3) points to (k, BRANCHES, 6) boxes."""
    total = np.zeros(boxes.shape[:2])
    for axis in range(3):
        coordinate = points[:, None, axis]
        gap = np.maximum(boxes[..., axis] - coordinate, coordinate - boxes[..., axis + 3])
        np.maximum(gap, 0, out=gap)
        total += gap * gap
    return total


def _rays_meet_boxes(origins: Float64, inverse: Float64, boxes: Float64) -> NDArray[np.bool_]:
    near, far = np.zeros(boxes.shape[:2]), np.full(boxes.shape[:2], np.inf)
    for axis in range(3):
        start, step = origins[:, None, axis], inverse[:, None, axis]
        with np.errstate(over="ignore"):
            a, b = (boxes[..., axis] - start) * step, (boxes[..., axis + 3] - start) * step
        np.maximum(near, np.minimum(a, b), out=near)
        np.minimum(far, np.maximum(a, b), out=far)
    # Flat boxes meet in one number: the rounding of two products must not lose them.
    return (near <= far * (1 + 1e-12)) & np.isfinite(boxes[..., 0])
