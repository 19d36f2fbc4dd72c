"""Regions merged pair by pair, the cheapest first: proxies at every scale, from facets to whole walls.

Hierarchical fitting of primitives (Attene, Falcidieno and Spagnuolo 2006): all that a closed-form plane,
sphere or cylinder needs to know of a region are sums over its samples, so a merge is an addition. Coplanar
regions may merge however far they lie apart.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from fit.partition import NORMAL_WEIGHT, Samples
from fit.round_regions import LEAST_TURN
from fit.scene import Float64

Int64 = NDArray[np.int64]

ROUND_WEIGHT = 0.25
"""Of the squared distance to a round proxy: facets lie along a circle, not around it, which is no fault."""

COPLANAR, SAME_OFFSET = 0.985, 0.5
"""Cosine, and cells between the planes, of regions that are tried together though they do not touch."""

GAP_COST = 0.02
"""Squared cells that each cell between two such regions costs the lighter one: nearer ones merge first."""


@dataclass(frozen=True)
class Moments:
    """Of r regions, sums over samples (position x, normal n, weight w): w (r,); w x, w n (r, 3);
    w x x, w n n, w x n (r, 3, 3); lower, upper (r, 3): their bounds."""

    weight: Float64
    x: Float64
    n: Float64
    xx: Float64
    nn: Float64
    xn: Float64
    lower: Float64
    upper: Float64

    def at(self, rows: NDArray[np.integer]) -> Moments:
        return Moments(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})

    def with_one(self, other: Moments) -> Moments:
        """Sums of each of these regions and of one other."""
        sums = {f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)}
        return Moments(
            **sums
            | {
                "lower": np.minimum(self.lower, other.lower),
                "upper": np.maximum(self.upper, other.upper),
            }
        )


def moments(samples: Samples, label: Int64) -> Moments:
    count = int(label.max()) + 1

    def total(values: Float64) -> Float64:
        flat = (values * samples.weights.reshape(-1, *[1] * (values.ndim - 1))).reshape(len(values), -1)
        sums = np.stack([_sums(label, column, count) for column in flat.T], axis=1)
        return sums.reshape(count, *values.shape[1:])

    x, n = samples.points, samples.normals
    lower, upper = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(lower, label, x)
    np.maximum.at(upper, label, x)
    return Moments(
        _sums(label, samples.weights, count),
        total(x), total(n),
        total(x[:, :, None] * x[:, None, :]), total(n[:, :, None] * n[:, None, :]),
        total(x[:, :, None] * n[:, None, :]),
        lower, upper,
    )  # fmt: skip


def _sums(label: Int64, values: Float64, count: int) -> Float64:
    return np.bincount(label, values, count).astype(np.float64)


def proxy_costs(m: Moments) -> Float64:
    """Mean squared error (r,), in squared cells, of the best plane, convex sphere or convex cylinder."""
    weight = np.maximum(m.weight, 1e-300)
    x, n = m.x / weight[:, None], m.n / weight[:, None]
    cov_xx = m.xx / weight[:, None, None] - x[:, :, None] * x[:, None, :]
    cov_xn = m.xn / weight[:, None, None] - x[:, :, None] * n[:, None, :]
    mean_nn = m.nn / weight[:, None, None]
    cov_nn = mean_nn - n[:, :, None] * n[:, None, :]
    length = np.linalg.norm(n, axis=1)
    normal = n / np.maximum(length, 1e-12)[:, None]
    plane = _along(cov_xx, normal) + NORMAL_WEIGHT * 2 * (1 - length)
    axis_share, axes = np.linalg.eigh(mean_nn)
    axis = axes[:, :, 0]
    sphere = _round_cost(_trace(cov_xx), _trace(cov_xn), _trace(cov_nn))
    cylinder = _round_cost(
        _trace(cov_xx) - _along(cov_xx, axis),
        _trace(cov_xn) - _along(cov_xn, axis),
        _trace(cov_nn) - _along(cov_nn, axis),
    )
    return np.minimum(plane, np.minimum(sphere, cylinder + NORMAL_WEIGHT * axis_share[:, 0]))


def _round_cost(xx: Float64, xn: Float64, nn: Float64) -> Float64:
    """Least squares of x - c - r n over c and r > 0; inf where the region is concave or too flat to tell."""
    radius = xn / np.maximum(nn, LEAST_TURN)
    return np.where((nn >= LEAST_TURN) & (radius > 0), ROUND_WEIGHT * (xx - radius * xn), np.inf)


def _trace(matrices: Float64) -> Float64:
    return np.einsum("rii->r", matrices)


def _along(matrices: Float64, axis: Float64) -> Float64:
    return np.einsum("ri,rij,rj->r", axis, matrices, axis)


def hierarchy(samples: Samples, label: Int64) -> tuple[list[tuple[int, ...]], Float64]:
    """The regions that make up each node (the regions first, then merges), and its proxy's cost."""
    own = moments(samples, label)
    count = len(own.weight)
    nodes: list[tuple[int, ...]] = [(i,) for i in range(count)]
    costs = list(proxy_costs(own))
    sums = _stacked(own, 2 * count)
    linked = [set[int]() for _ in range(count)]
    for i, j in _pairs(samples, label, own):
        linked[i].add(j)
        linked[j].add(i)
    alive = [True] * count
    queue: list[tuple[float, int, int]] = []

    def offer(i: int, others: list[int]) -> None:
        if others:
            rows = np.array(others)
            for rise, j in zip(_rises(sums, costs, i, rows), others, strict=True):
                queue.append((float(rise), min(i, j), max(i, j)))

    for i in range(count):
        offer(i, sorted(j for j in linked[i] if j > i))
    heapq.heapify(queue)
    while queue:
        _, i, j = heapq.heappop(queue)
        if not (alive[i] and alive[j]):
            continue
        new = len(nodes)
        joined = sums.at(np.array([i])).with_one(sums.at(np.array([j])))
        for f in fields(sums):
            getattr(sums, f.name)[new] = getattr(joined, f.name)[0]
        nodes.append((*nodes[i], *nodes[j]))
        costs.append(float(proxy_costs(joined)[0]))
        alive[i] = alive[j] = False
        alive.append(True)
        others = sorted(k for k in linked[i] | linked[j] if alive[k] and k not in (i, j))
        linked.append(set(others))
        for k in others:
            linked[k].add(new)
        before = len(queue)
        offer(new, others)
        fresh = queue[before:]
        del queue[before:]
        for entry in fresh:
            heapq.heappush(queue, entry)
    return nodes, np.array(costs)


def _stacked(own: Moments, size: int) -> Moments:
    """Room for `size` regions, the first ones filled."""
    rows = {}
    for f in fields(own):
        values = getattr(own, f.name)
        rows[f.name] = np.zeros((size, *values.shape[1:]))
        rows[f.name][: len(values)] = values
    return Moments(**rows)


def _rises(sums: Moments, costs: list[float], i: int, others: Int64) -> Float64:
    """What the total error rises by when region i merges with each of `others`, gaps included."""
    one, rest = sums.at(np.array([i])), sums.at(others)
    joined = rest.with_one(one)
    apart = np.maximum(0.0, np.maximum(rest.lower - one.upper, one.lower - rest.upper))
    gap = np.maximum(np.linalg.norm(apart, axis=1) - 2.0, 0.0)
    before = one.weight * costs[i] + rest.weight * np.array([costs[j] for j in others])
    return joined.weight * proxy_costs(joined) - before + GAP_COST * gap * np.minimum(one.weight, rest.weight)


def _pairs(samples: Samples, label: Int64, own: Moments) -> list[tuple[int, int]]:
    """Regions that touch, and coplanar ones anywhere."""
    a, b = np.repeat(label, samples.neighbours.shape[1]), label[samples.neighbours].ravel()
    touching = np.stack([np.minimum(a, b), np.maximum(a, b)], axis=1)[a != b]
    weight = np.maximum(own.weight, 1e-300)[:, None]
    centers, normals = own.x / weight, own.n / np.maximum(np.linalg.norm(own.n, axis=1), 1e-300)[:, None]
    off = np.einsum("ijk,ik->ij", centers[None] - centers[:, None], normals)
    alike = (normals @ normals.T > COPLANAR) & (np.abs(off) < SAME_OFFSET) & (np.abs(off.T) < SAME_OFFSET)
    coplanar = np.argwhere(np.triu(alike, 1))
    pairs = np.unique(np.concatenate([touching.reshape(-1, 2), coplanar]), axis=0)
    return [(int(i), int(j)) for i, j in pairs]
