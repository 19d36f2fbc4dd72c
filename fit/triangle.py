"""One point or ray against one triangle, row by row."""

from __future__ import annotations

import numpy as np

from fit.scene import Float64

_TINY = float(np.finfo(float).tiny)
"""Keeps the triangles that rounding has flattened from dividing by zero: they count as segments or points."""


def length(vectors: Float64) -> Float64:
    """Of each row (k, 3)."""
    return np.sqrt(dot(vectors, vectors))


def dot(a: Float64, b: Float64) -> Float64:
    """Of rows (k, 3) by rows (k, 3)."""
    return np.einsum("ij,ij->i", a, b)


def plane_frames(corners: Float64) -> Float64:
    """Triangles in their own plane, (t, 12): corner a, unit x axis along ab, unit y axis, |ab|, c.x, c.y."""
    a = corners[:, 0]
    ab, ac = corners[:, 1] - a, corners[:, 2] - a
    extent = length(ab)
    x = ab / np.maximum(extent, _TINY)[:, None]
    cx = dot(ac, x)
    y = ac
    for _ in range(2):  # twice: one pass leaves the axes of a sliver askew
        y = y - dot(y, x)[:, None] * x
        y /= np.maximum(length(y), _TINY)[:, None]
    cy = dot(ac, y)
    return np.concatenate([a, x, y, extent[:, None], cx[:, None], cy[:, None]], axis=1)


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


def ray_distances(origins: Float64, directions: Float64, frame: Float64) -> Float64:
    """Distance (k,) along each ray to its triangle, inf where it misses; both sides count."""
    ex, ey = frame[:, 3:6], frame[:, 6:9]
    normal = np.cross(ex, ey)
    slope = dot(directions, normal)
    offset = origins - frame[:, :3]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -dot(offset, normal) / slope
        at = offset + t[:, None] * directions
        x, y = dot(at, ex), dot(at, ey)
        width, cx, cy = frame[:, 9], frame[:, 10], frame[:, 11]
        # A hair of tolerance closes the seam between two triangles.
        hair = 1e-12 * width * cy
        inside = (
            (y * width >= -hair) & (x * cy - y * cx >= -hair) & ((x - width) * cy - y * (cx - width) <= hair)
        )
        return np.where(inside & (t > 0) & np.isfinite(t), t, np.inf)
