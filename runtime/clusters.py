"""Clusters of near primitives (SDFDDGI, section 3.1): K-means on their centres, each frame on the CPU, and a
ball around each cluster.

A query passes a cluster by whose ball is farther than the nearest primitive found so far. Primitives of a
cluster lie side by side on the GPU, so a cluster is a ball and a range.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.structs import GpuStruct, u32, vec4f

Float64 = NDArray[np.float64]
Index = NDArray[np.intp]

MOST_CLUSTERS = 256
"""More are not worth their balls: docs/gi.md has the figures."""

FIRST_ROUNDS, NEXT_ROUNDS = 12, 2
"""Rounds of K-means from nothing, and from the means of the frame before."""

ROUNDING = 1e-6
"""Of a ball's radius and its place: what float32 may lose of them."""


class Cluster(GpuStruct):
    ball: vec4f  # centre, radius
    first: u32
    count: u32


@dataclass(frozen=True)
class Clustering:
    """n primitives in k clusters. means (k, 3) of K-means, from which the next frame's begins; labels (n,).

    Clusters may be empty.
    """

    means: Float64
    labels: Index

    @property
    def order(self) -> Index:
        """The primitives (n,), cluster by cluster, in their own order within each."""
        return np.argsort(self.labels, kind="stable")


def cluster_count(primitives: int) -> int:
    """How many clusters ask the fewest primitives and balls together: docs/gi.md has the figures."""
    return max(1, min(round(4 * primitives**0.5), primitives, MOST_CLUSTERS))


def find_clusters(
    centres: Float64, count: int, seed: int = 0, before: Clustering | None = None
) -> Clustering:
    """At most `count` clusters of points (n, 3), n > 0; those of the frame `before` are taken on.

    The same points, seed and past give the same clusters.
    """
    count = min(count, MOST_CLUSTERS, len(np.unique(centres, axis=0)))
    if before is not None and len(before.means) == count:
        means, rounds = before.means, NEXT_ROUNDS
    else:
        means, rounds = _spread_means(centres, count, np.random.default_rng(seed)), FIRST_ROUNDS
    for _ in range(rounds):
        labels = _nearest(centres, means)
        means = _means(centres, labels, means)
    return Clustering(means, _nearest(centres, means))


def _spread_means(centres: Float64, count: int, rng: np.random.Generator) -> Float64:
    """First means (count, 3), drawn by their squared distance to those there are (Arthur and Vassilvitskii
    2007). At least `count` points differ, so every draw finds a new one."""
    chosen = [int(rng.integers(len(centres)))]
    squared = np.sum((centres - centres[chosen[0]]) ** 2, axis=1)
    for _ in range(count - 1):
        chosen.append(int(rng.choice(len(centres), p=squared / squared.sum())))
        squared = np.minimum(squared, np.sum((centres - centres[chosen[-1]]) ** 2, axis=1))
    return centres[chosen]


def _nearest(centres: Float64, means: Float64) -> Index:
    """The mean (n,) nearest to each point: |c|^2 - 2 c.m + |m|^2 without the first term."""
    return np.argmin(np.sum(means**2, axis=1) - 2 * centres @ means.T, axis=1)


def _means(centres: Float64, labels: Index, before: Float64) -> Float64:
    """Of the points of each label; a label without any keeps its mean."""
    counts = np.bincount(labels, minlength=len(before))[:, None]
    sums = np.stack([np.bincount(labels, axis, len(before)) for axis in centres.T], axis=1)
    return np.where(counts > 0, sums / np.maximum(counts, 1), before)


def pack_clusters(clustering: Clustering, centres: Float64, radii: Float64) -> NDArray:
    """Records of `Cluster`, without those that are empty, for primitives in balls (n, 3), (n,)."""
    balls, counts = [], []
    for label in np.unique(clustering.labels):
        inside = clustering.labels == label
        balls.append(_ball_around(centres[inside], radii[inside]))
        counts.append(np.count_nonzero(inside))
    first = np.cumsum(counts) - counts
    return Cluster.pack_array(len(balls), ball=np.array(balls), first=first, count=np.array(counts))


def _ball_around(centres: Float64, radii: Float64) -> Float64:
    """A ball (4,) that holds these: about the middle of their box, or about their mean, as is smaller."""
    lower, upper = (centres - radii[:, None]).min(axis=0), (centres + radii[:, None]).max(axis=0)
    trials = ((lower + upper) / 2, centres.mean(axis=0))
    sizes = [(np.linalg.norm(centres - middle, axis=1) + radii).max() for middle in trials]
    middle, radius = trials[int(np.argmin(sizes))], min(sizes)
    return np.array([*middle, radius + ROUNDING * (radius + np.abs(middle).max())])
