"""Exact nearest points and first hits on triangles: a bounding volume hierarchy walked level by level.

All queries of a batch descend together, so each level is a handful of NumPy calls on (query, node) pairs.
The leaves lie along a Morton curve; a k-d tree over a few of them gives the first upper bound of a distance.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fit.scene import Float64

Int64 = NDArray[np.int64]

BRANCHES = 4
"""Children of a node: measured fastest of 2, 4 and 8."""

_PIECES_PER_DIAGONAL = 64
"""Triangles longer than this share of the diagonal enter the tree in pieces, so that boxes stay tight."""

_TINY = float(np.finfo(float).tiny)
"""Keeps the triangles that rounding has flattened from dividing by zero: they count as segments or points."""

_MAX_EXTRA_PIECES = 300_000

_MOST_GUESSES = 1 << 17
"""Leaves in the k-d tree of first guesses: of millions, all would take longer to search than the boxes."""

_PAIRS_PER_CHUNK = 1 << 18


class TriangleTree:
    """A search tree over t triangles (t, 3, 3), t > 0, which it keeps without a copy."""

    def __init__(self, vertices: Float64) -> None:
        if len(vertices) == 0:
            raise ValueError("a triangle tree needs at least one triangle; the surface is empty")
        lower, upper = boxes_around(vertices)
        low, high = column_extremes(lower)[0], column_extremes(upper)[1]
        self.center = (low + high) / 2
        self.diagonal = float(np.linalg.norm(high - low))
        self._vertices = vertices
        boxes, owner = self._leaf_boxes(np.concatenate([lower, upper], axis=1))
        del lower, upper
        order = morton_order(boxes[:, :3] + boxes[:, 3:])
        self._leaf_triangles, boxes = owner[order], boxes[order]
        stride = -(-len(boxes) // _MOST_GUESSES)
        self._guesses = cKDTree((boxes[::stride, :3] + boxes[::stride, 3:]) / 2)
        self._guessed_triangles = self._leaf_triangles[::stride]
        self._levels = _box_levels(boxes)

    def _leaf_boxes(self, boxes: Float64) -> tuple[Float64, Int64]:
        """Boxes (n, 6) about the tree's centre, of triangles or, of long ones, pieces; their owners."""
        longest = self.diagonal / _PIECES_PER_DIAGONAL
        is_long = _length(boxes[:, 3:] - boxes[:, :3]) > longest
        boxes -= np.tile(self.center, 2)
        if not is_long.any():
            return boxes, np.arange(len(boxes))
        long, short = np.flatnonzero(is_long), np.flatnonzero(~is_long)
        pieces, owner = cut_long_triangles(self._vertices[long] - self.center, longest, _MAX_EXTRA_PIECES)
        cut = np.concatenate(boxes_around(pieces), axis=1)
        return np.concatenate([boxes[short], cut]), np.concatenate([short, long[owner]])

    def _frames(self, triangles: Int64) -> Float64:
        return plane_frames(self._vertices[triangles] - self.center)

    def nearest(self, points: Float64) -> tuple[Float64, Int64]:
        """Unsigned distance (p,) from points (p, 3) to the triangles, and the nearest triangle (p,)."""
        points = points - self.center
        distance, triangle = np.empty(len(points)), np.empty(len(points), np.int64)
        chunk = _PAIRS_PER_CHUNK // 32
        for start in range(0, len(points), chunk):
            part = slice(start, start + chunk)
            distance[part], triangle[part] = self._nearest_chunk(points[part])
        return distance, triangle

    def _nearest_chunk(self, points: Float64) -> tuple[Float64, Int64]:
        triangle = self._guessed_triangles[self._guesses.query(points)[1]]
        bound = squared_distances(points, self._frames(triangle))
        query, node = np.arange(len(points)), np.zeros(len(points), np.int64)
        for boxes in self._levels:
            near = _squared_distances_to_boxes(points[query], boxes[node]) < bound[query, None]
            row, child = np.nonzero(near)
            query, node = query[row], node[row] * BRANCHES + child
        candidates = self._leaf_triangles[node]
        squared = squared_distances(points[query], self._frames(candidates))
        # Stable order by query, then distance, then triangle: the first of each run is the nearest.
        order = np.lexsort((candidates, squared, query))
        query, squared, candidates = query[order], squared[order], candidates[order]
        leader = np.flatnonzero(np.diff(query, prepend=-1))
        better = squared[leader] < bound[query[leader]]
        winners = leader[better]
        bound[query[winners]], triangle[query[winners]] = squared[winners], candidates[winners]
        return np.sqrt(bound), triangle

    def first_hit(self, origins: Float64, directions: Float64) -> tuple[Float64, Int64]:
        """Distance (p,) along unit directions (p, 3) to the first triangle, and its row; inf and -1: none."""
        origins = origins - self.center
        distance, triangle = np.empty(len(origins)), np.empty(len(origins), np.int64)
        chunk = _PAIRS_PER_CHUNK // 64
        for start in range(0, len(origins), chunk):
            part = slice(start, start + chunk)
            distance[part], triangle[part] = self._first_hit_chunk(origins[part], directions[part])
        return distance, triangle

    def _first_hit_chunk(self, origins: Float64, directions: Float64) -> tuple[Float64, Int64]:
        with np.errstate(divide="ignore"):
            inverse = 1.0 / np.where(directions == 0, 1e-300, directions)
        distance, triangle = np.full(len(origins), np.inf), np.full(len(origins), -1, np.int64)
        query, node = np.arange(len(origins)), np.zeros(len(origins), np.int64)
        for boxes in self._levels:
            row, child = np.nonzero(_rays_meet_boxes(origins[query], inverse[query], boxes[node]))
            query, node = query[row], node[row] * BRANCHES + child
        candidates = self._leaf_triangles[node]
        along = _ray_distances(origins[query], directions[query], self._frames(candidates))
        order = np.lexsort((candidates, along, query))
        order = order[np.diff(query[order], prepend=-1) != 0]
        order = order[np.isfinite(along[order])]
        distance[query[order]], triangle[query[order]] = along[order], candidates[order]
        return distance, triangle


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
        edges = np.stack([_length(corners[:, (k + 1) % 3] - corners[:, k]) for k in range(3)])
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


def _length(vectors: Float64) -> Float64:
    return np.sqrt(_dot(vectors, vectors))


def _dot(a: Float64, b: Float64) -> Float64:
    return np.einsum("ij,ij->i", a, b)


def column_extremes(points: Float64) -> tuple[Float64, Float64]:
    """Lowest and highest values (3,), (3,) of points (p, 3)."""
    columns = [points[:, k] for k in range(3)]  # NumPy reduces rows of three five times slower
    return np.array([c.min() for c in columns]), np.array([c.max() for c in columns])


def morton_order(points: Float64) -> Int64:
    """Order (p,) of points (p, 3) along a Z-shaped curve: its neighbours are near in space (Morton 1966)."""
    lower, upper = column_extremes(points)
    scale = ((1 << 21) - 1) / max(float((upper - lower).max()), _TINY)
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


# ------------------------------------------------------------------------------- one point, one triangle


def plane_frames(corners: Float64) -> Float64:
    """Triangles in their own plane, (t, 12): corner a, unit x axis along ab, unit y axis, |ab|, c.x, c.y."""
    a = corners[:, 0]
    ab, ac = corners[:, 1] - a, corners[:, 2] - a
    length = _length(ab)
    x = ab / np.maximum(length, _TINY)[:, None]
    cx = _dot(ac, x)
    y = ac
    for _ in range(2):  # twice: one pass leaves the axes of a sliver askew
        y = y - _dot(y, x)[:, None] * x
        y /= np.maximum(_length(y), _TINY)[:, None]
    cy = _dot(ac, y)
    return np.concatenate([a, x, y, length[:, None], cx[:, None], cy[:, None]], axis=1)


def squared_distances(points: Float64, frame: Float64) -> Float64:
    """Squared distance (k,) of points (k, 3) to the triangles of `plane_frames` (k, 12), exact."""
    dx, dy, dz = (points[:, k] - frame[:, k] for k in range(3))
    x = dx * frame[:, 3] + dy * frame[:, 4] + dz * frame[:, 5]
    y = dx * frame[:, 6] + dy * frame[:, 7] + dz * frame[:, 8]
    height = np.maximum(dx * dx + dy * dy + dz * dz - x * x - y * y, 0)
    width, cx, cy = frame[:, 9], frame[:, 10], frame[:, 11]
    inside = (y >= 0) & (x * cy >= y * cx) & ((x - width) * cy <= y * (cx - width))
    in_plane = _squared_to_segment(x, y, width, 0.0)
    np.minimum(in_plane, _squared_to_segment(x, y, cx, cy), out=in_plane)
    np.minimum(in_plane, _squared_to_segment(x - width, y, cx - width, cy), out=in_plane)
    in_plane[inside] = 0
    return in_plane + height


def _squared_to_segment(x: Float64, y: Float64, ex: Float64, ey: Float64 | float) -> Float64:
    """Squared distance of (x, y) to the segment from the origin to (ex, ey)."""
    t = np.clip((x * ex + y * ey) / np.maximum(ex * ex + ey * ey, _TINY), 0, 1)
    return (x - t * ex) ** 2 + (y - t * ey) ** 2


def _ray_distances(origins: Float64, directions: Float64, frame: Float64) -> Float64:
    """Distance (k,) along each ray to its triangle, inf where it misses; both sides count."""
    ex, ey = frame[:, 3:6], frame[:, 6:9]
    normal = np.cross(ex, ey)
    slope = _dot(directions, normal)
    offset = origins - frame[:, :3]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -_dot(offset, normal) / slope
        at = offset + t[:, None] * directions
        x, y = _dot(at, ex), _dot(at, ey)
        width, cx, cy = frame[:, 9], frame[:, 10], frame[:, 11]
        # A hair of tolerance closes the seam between two triangles.
        hair = 1e-12 * width * cy
        inside = (
            (y * width >= -hair) & (x * cy - y * cx >= -hair) & ((x - width) * cy - y * (cx - width) <= hair)
        )
        return np.where(inside & (t > 0) & np.isfinite(t), t, np.inf)
