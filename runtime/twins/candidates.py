"""Twin of shaders/lib/candidates.wgsl and shaders/world/build_candidates.wgsl, over a whole set at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fit import sdf
from fit.primitives import PrimitiveSet

Float64 = NDArray[np.float64]
Index = NDArray[np.intp]

CANDIDATES_REACH = 0.8660254 * 1.1


def cell_centres(lower: ArrayLike, cell: float, size: ArrayLike) -> Float64:
    """Centres (n, 3) of `size` (3,) cells of edge `cell` from `lower` (3,), x fastest."""
    z, y, x = np.meshgrid(*(np.arange(count) for count in reversed(list(np.asarray(size)))), indexing="ij")
    return np.asarray(lower) + cell * (np.stack([x, y, z], axis=-1).reshape(-1, 3) + 0.5)


def candidate_surplus(primitives: PrimitiveSet, lower: ArrayLike, cell: float, size: ArrayLike) -> Float64:
    """By how much (cells, n) each finite primitive is too far for a cell's list: it is listed up to 0."""
    distances = sdf.distance(primitives, cell_centres(lower, cell, size))
    surplus: Float64 = distances - distances.min(axis=1, keepdims=True) - 2 * CANDIDATES_REACH * cell
    return surplus


def nearest_in_clusters(
    primitives: PrimitiveSet, balls: Float64, labels: Index, position: Float64, bound: Float64
) -> tuple[Float64, Index, Index]:
    """Distance (n,) from positions (n, 3) to the nearest finite primitive, its index, and how many it asked.

    balls (k, 4) of the clusters, in the order in which they are asked; labels: each primitive's cluster.
    Where none is nearer than the bound (n,), the answer is the bound and the index -1.
    """
    nearest, index = np.array(bound, np.float64), np.full(len(position), -1, np.intp)
    asked = np.zeros(len(position), np.intp)
    for label, ball in enumerate(balls):
        members = np.flatnonzero(labels == label)
        near = np.flatnonzero(np.linalg.norm(position - ball[:3], axis=1) - ball[3] < nearest)
        distances = sdf.distance(primitives.select(members), position[near])
        asked[near] += len(members)
        best = distances.argmin(axis=1)
        smallest = distances[np.arange(len(near)), best]
        closer = smallest < nearest[near]
        nearest[near[closer]], index[near[closer]] = smallest[closer], members[best[closer]]
    return nearest, index, asked
