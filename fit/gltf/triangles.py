"""Primitive topologies -> triangle lists (glTF 2.0, section 3.7.2.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

POINTS, LINES, LINE_LOOP, LINE_STRIP, TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN = range(7)
MODE_NAMES = ("POINTS", "LINES", "LINE_LOOP", "LINE_STRIP", "TRIANGLES", "TRIANGLE_STRIP", "TRIANGLE_FAN")


def to_triangles(mode: int, indices: NDArray[np.integer]) -> NDArray[np.uint32]:
    """Triangles (m, 3) of a list, strip or fan over `indices` (k,); corners left over are not drawn.

    Every second triangle of a strip is turned round, so that all face the same way.
    """
    corners = np.asarray(indices, np.uint32)
    if mode == TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    if len(corners) < 3:
        return np.zeros((0, 3), np.uint32)
    if mode == TRIANGLE_STRIP:
        triangles = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
        triangles[1::2, 1:] = triangles[1::2, :0:-1]
        return triangles
    hub = np.broadcast_to(corners[0], len(corners) - 2)
    return np.stack([corners[1:-1], corners[2:], hub], axis=1)


def leftover_corners(mode: int, count: int) -> int:
    """Corners at the end that form no whole triangle."""
    if mode == TRIANGLES:
        return count % 3
    return count if count < 3 else 0
