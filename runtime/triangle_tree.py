"""The tree of boxes over triangles that rays go down, by the surface area heuristic (Wald 2007)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fit.scene import Float64

Int64 = NDArray[np.int64]

TRIANGLES_A_LEAF = 4

BINS = 16
"""Places where a node may be cut, along the longest side of its centres' box."""

DEEPEST = 32
"""Levels at most: the room on the shader's stack. Where a tree would be deeper, it is cut in halves."""


def build_tree(corners: Float64) -> tuple[Int64, NDArray[np.float32]]:
    """A binary tree over triangles (t, 3, 3), level by level from the root.

    Their order in its leaves (t,), and its nodes (n, 2, 4): the corners of each box, with two unsigned words
    in w, the first triangle of a leaf or the first of two children, and the triangles of a leaf or 0.
    """
    low, high = corners.min(axis=1), corners.max(axis=1)
    order = np.arange(len(corners))
    starts, counts = np.zeros(1, np.int64), np.array([len(corners)])
    levels: list[NDArray[np.float32]] = []
    known = 0
    while len(starts):
        rows = order[_places(starts, counts)]
        begins = np.cumsum(counts) - counts
        lower, upper = np.minimum.reduceat(low[rows], begins), np.maximum.reduceat(high[rows], begins)
        known += len(starts)
        is_leaf = counts <= TRIANGLES_A_LEAF
        child = known + 2 * (np.cumsum(~is_leaf) - 1)
        levels.append(_nodes(lower, upper, np.where(is_leaf, starts, child), np.where(is_leaf, counts, 0)))
        starts, counts = starts[~is_leaf], counts[~is_leaf]
        split = _cut(order, low, high, starts, counts, DEEPEST - len(levels))
        starts = np.stack([starts, starts + split], axis=1).reshape(-1)
        counts = np.stack([split, counts - split], axis=1).reshape(-1)
    return order, _widened(np.concatenate(levels), corners)


def _places(starts: Int64, counts: Int64) -> Int64:
    """All places of the ranges, one after the other."""
    begins = np.cumsum(counts) - counts
    return np.arange(counts.sum()) + np.repeat(starts - begins, counts)


def _cut(order: Int64, low: Float64, high: Float64, starts: Int64, counts: Int64, levels_left: int) -> Int64:
    """Sorts each range of `order` along its longest axis and tells how many of its triangles go left."""
    if len(starts) == 0:
        return counts
    places = _places(starts, counts)
    node = np.repeat(np.arange(len(starts)), counts)
    begins = np.cumsum(counts) - counts
    centers = ((low + high) / 2)[order[places]]
    lower, upper = np.minimum.reduceat(centers, begins), np.maximum.reduceat(centers, begins)
    axis = (upper - lower).argmax(axis=1)
    along = centers[np.arange(len(centers)), axis[node]]
    rank = np.lexsort((along, node))
    order[places] = order[places][rank]
    rows = np.arange(len(starts))
    extent = np.maximum((upper - lower)[rows, axis], 1e-300)
    share = (along[rank] - lower[rows, axis][node]) / extent[node]
    bins = np.minimum((share * BINS).astype(np.int64), BINS - 1)
    left = _cheapest_cut(low[order[places]], high[order[places]], node * BINS + bins, len(starts))
    # Half of the triangles where no bin parts them, and where a lopsided tree would outgrow the stack.
    must_halve = np.ceil(np.log2(counts / TRIANGLES_A_LEAF)) + 1 >= levels_left
    return np.where(must_halve | (left == 0), counts // 2, left)


def _cheapest_cut(low: Float64, high: Float64, cells: Int64, nodes: int) -> Int64:
    """Of each node, how many triangles lie left of the cut with the least expected cost: the area of each
    side's box times its triangles. cells: node * BINS + bin of each triangle, ascending. 0: there is none."""
    number = np.bincount(cells, minlength=nodes * BINS)
    is_used = number > 0
    begins = (np.cumsum(number) - number)[is_used]
    lower, upper = np.full((nodes, BINS, 3), np.inf), np.full((nodes, BINS, 3), -np.inf)
    is_used = is_used.reshape(nodes, BINS)
    lower[is_used], upper[is_used] = np.minimum.reduceat(low, begins), np.maximum.reduceat(high, begins)
    left = np.cumsum(number.reshape(nodes, BINS), axis=1)[:, :-1]
    right = number.reshape(nodes, BINS).sum(axis=1, keepdims=True) - left
    cost = left * _area(_swept(np.minimum, lower), _swept(np.maximum, upper))
    cost += right * _area(_swept(np.minimum, lower[:, ::-1]), _swept(np.maximum, upper[:, ::-1]))[:, ::-1]
    cost[(left == 0) | (right == 0)] = np.inf
    best = cost.argmin(axis=1)
    rows = np.arange(nodes)
    return np.where(np.isfinite(cost[rows, best]), left[rows, best], 0)


def _swept(function: np.ufunc, values: Float64) -> Float64:
    """Of the first bins, the first two, and so on to all but the last."""
    swept: Float64 = function.accumulate(values[:, :-1], axis=1)
    return swept


def _area(lower: Float64, upper: Float64) -> Float64:
    """Half the surface of boxes (..., 3); 0 for a box of nothing."""
    x, y, z = np.moveaxis(np.maximum(np.where(lower > upper, 0.0, upper - lower), 0.0), -1, 0)
    area: Float64 = x * y + y * z + z * x
    return area


def _nodes(lower: Float64, upper: Float64, first: Int64, count: Int64) -> NDArray[np.float32]:
    nodes = np.zeros((len(lower), 2, 4), np.float32)
    nodes[:, 0, :3], nodes[:, 1, :3] = lower, upper
    nodes[:, 0, 3] = first.astype(np.uint32).view(np.float32)
    nodes[:, 1, 3] = count.astype(np.uint32).view(np.float32)
    return nodes


def _widened(nodes: NDArray[np.float32], corners: Float64) -> NDArray[np.float32]:
    """Outward by a rounding of float32."""
    pad = 1e-6 * float(np.abs(corners).max() + 1e-30)
    nodes[:, 0, :3] -= pad
    nodes[:, 1, :3] += pad
    return nodes
