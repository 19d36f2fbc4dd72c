"""Vertex normals: computed where the file has none, mended where they point nowhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

UP = (0.0, 1.0, 0.0)
"""The normal of what has no direction of its own, such as a triangle without area."""

Float64 = NDArray[np.float64]


def face_normals(positions: Float64, triangles: NDArray[np.integer]) -> tuple[Float64, Float64]:
    """Unit normals (m, 3) by winding, and areas (m,). A triangle without area gets a zero normal."""
    a, b, c = (positions[triangles[:, corner]] for corner in range(3))
    cross = np.cross(b - a, c - a)
    # Scaled first: squares of lengths around 1e-170 or 1e170 leave float64.
    scale = np.abs(cross).max(axis=1, initial=0.0)
    safe = np.where(scale > 0, scale, 1.0)
    length = np.sqrt(np.square(cross / safe[:, None]).sum(axis=1)) * safe
    unit = np.divide(cross, length[:, None], out=np.zeros_like(cross), where=length[:, None] > 0)
    return unit, length / 2


def smooth_normals(positions: Float64, triangles: NDArray[np.integer]) -> Float64:
    """Area-weighted mean normals (n, 3) of the triangles round each vertex, `UP` where they cancel."""
    unit, areas = face_normals(positions, triangles)
    total = np.zeros_like(positions)
    weighted = unit * areas[:, None]
    for corner in range(3):
        for axis in range(3):
            total[:, axis] += np.bincount(triangles[:, corner], weighted[:, axis], len(positions))
    return unit_or_up(total)[0]


def unit_or_up(vectors: Float64) -> tuple[Float64, NDArray[np.bool_]]:
    """Vectors (n, 3) made unit length, and which of them (n,) had none and became `UP`."""
    finite = np.all(np.isfinite(vectors), axis=1)
    scale = np.abs(np.where(finite[:, None], vectors, 0.0)).max(axis=1, initial=0.0)
    bad = ~finite | (scale <= 0)
    scaled = np.where(bad[:, None], UP, vectors) / np.where(bad, 1.0, scale)[:, None]
    return scaled / np.sqrt(np.square(scaled).sum(axis=1, keepdims=True)), bad


def repair_normals(
    normals: Float64, positions: Float64, triangles: NDArray[np.integer]
) -> tuple[Float64, int]:
    """Unit normals (n, 3), those without direction taken from the triangles; and how many were mended."""
    unit, bad = unit_or_up(normals)
    mended = int(np.count_nonzero(bad))
    if mended:
        unit[bad] = smooth_normals(positions, triangles)[bad]
    return unit, mended
