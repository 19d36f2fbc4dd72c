"""The surface cut into regions that a plane explains each, by iterations like Lloyd's over its samples.

Variational shape approximation (Cohen-Steiner, Alliez and Desbrun 2004) on points in place of triangles: a
soup has no adjacency of its own, and points near each other that look the same way are neighbours whichever
mesh they came from. So regions run across components.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fit.scene import Float64

Int64 = NDArray[np.int64]

NEIGHBOURS = 10
"""Samples that a label may come from in one step of the assignment."""

NORMAL_SPACINGS = 4.0
"""Spacings of the samples that a unit change of the normal is worth when neighbours are sought."""

NORMAL_WEIGHT = 0.25
"""Squared cells that a squared unit change of the normal costs (the weight of L2,1 beside L2): 30 degrees off
are as bad as a quarter of a cell."""

ITERATIONS = 25


@dataclass(frozen=True)
class Samples:
    """p points (p, 3) in cells, unit normals (p, 3) toward the air, weights (p,); neighbours (p, k)."""

    points: Float64
    normals: Float64
    weights: Float64
    neighbours: Int64

    def __len__(self) -> int:
        return len(self.points)


def link(points: Float64, normals: Float64, weights: Float64) -> Samples:
    """Samples with their nearest ones in place and direction: the two sides of a sheet are far apart."""
    count = min(NEIGHBOURS + 1, len(points))
    spacing = float(np.median(cKDTree(points).query(points, k=2)[0][:, -1])) if len(points) > 1 else 1.0
    features = np.concatenate([points, NORMAL_SPACINGS * spacing * normals], axis=1)
    neighbours = cKDTree(features).query(features, k=count)[1].reshape(len(points), count)
    return Samples(points, normals, weights, neighbours.astype(np.int64))


def partition(samples: Samples, count: int, rng: np.random.Generator) -> Int64:
    """The region (p,) of each sample, at most `count` of them, numbered from 0.

    Seeds are drawn at random by weight, and samples join the nearest. Then samples take the best proxy of
    their neighbours', and proxies are refitted, in turn: a label only reaches a sample through adjacent ones.

    The assignment lowers L2 + `NORMAL_WEIGHT` L2,1, the refit takes the mean normal, which is the optimum of
    L2,1 alone. So unlike Lloyd's, an iteration need not lower the sum: after `ITERATIONS` the last one holds.
    """
    label = _nearest_seed(samples, count, rng)
    for _ in range(ITERATIONS):
        normals, centers = _proxies(samples, label)
        options = label[samples.neighbours]
        cost = np.stack([_cost(samples, normals, centers, own) for own in options.T], axis=1)
        best = options[np.arange(len(samples)), cost.argmin(axis=1)]
        if np.array_equal(best, label):
            break
        label = best
    return np.unique(label, return_inverse=True)[1].astype(np.int64)


def _nearest_seed(samples: Samples, count: int, rng: np.random.Generator) -> Int64:
    chance = samples.weights / samples.weights.sum()
    drawn = rng.choice(len(samples), size=min(count, int(np.count_nonzero(chance))), replace=False, p=chance)
    scale = float(np.sqrt(np.ptp(samples.points, axis=0).max() + 1.0))
    features = np.concatenate([samples.points, 4 * scale * samples.normals], axis=1)
    return cKDTree(features[np.sort(drawn)]).query(features)[1].astype(np.int64)


def _proxies(samples: Samples, label: Int64) -> tuple[Float64, Float64]:
    """Unit normal (r, 3) and centre (r, 3) of each region: the optimum of L2,1 (section 3.3.2)."""
    count = int(label.max()) + 1
    weight = np.maximum(np.bincount(label, weights=samples.weights, minlength=count), 1e-300)
    normals, centers = (
        np.stack([np.bincount(label, samples.weights * v[:, k], count) for k in range(3)], axis=1)
        for v in (samples.normals, samples.points)
    )
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.maximum(length, 1e-300), centers / weight[:, None]


def _cost(samples: Samples, normals: Float64, centers: Float64, label: Int64) -> Float64:
    """L2 of the distance to the proxy's plane and L2,1 of the normal, for each sample and its label (p,)."""
    off = np.einsum("pk,pk->p", samples.points - centers[label], normals[label])
    turn = samples.normals - normals[label]
    return off * off + NORMAL_WEIGHT * np.einsum("pk,pk->p", turn, turn)
