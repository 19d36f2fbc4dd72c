"""Fewer shapes for the same surface: two that continue each other become one, the least useful ones go."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fit.choose import worths
from fit.objective import Targets, distance_table, near_distances, penalties
from fit.primitives import Kind
from fit.scene import Float64
from fit.shapes import Shapes, join, make_shapes

MOST_EMPTY = 0.5
"""Share of a merged box that neither of the two fills: beyond it they do not continue each other."""

_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)


def thin_out(shapes: Shapes, targets: Targets, *, count: int, kept: int = 0, merging: bool = True) -> Shapes:
    """The set with `count` shapes less, by the removals and merges that raise E least.

    Costs are those in the whole set, and no shape takes part twice. The first `kept` shapes stay.
    """
    table = distance_table(shapes, targets)
    removals = [(float(cost), (i,), None) for i, cost in enumerate(worths(table, targets)) if i >= kept]
    merges = find_merges(shapes, table, targets, kept) if merging else []
    gone, added = np.zeros(len(shapes), bool), []
    left = count
    for _, members, merged in sorted(removals + merges, key=lambda step: step[0]):
        if left == 0:
            break
        if not gone[list(members)].any():
            gone[list(members)] = True
            added += [merged] if merged is not None else []
            left -= 1
    return join([shapes.select(~gone), *added])


Step = tuple[float, tuple[int, ...], Shapes | None]


def find_merges(shapes: Shapes, table: Float64, targets: Targets, kept: int) -> list[Step]:
    """What E rises by for each pair of boxes that one box can stand for, the pair, and that box."""
    nearest, distance = _nearest_three(table, targets.reach)
    standing = penalties(targets, distance[0])
    steps: list[Step] = []
    for i, j in _neighbours(shapes, kept):
        first, second = ((nearest[k] == i) | (nearest[k] == j) for k in (0, 1))
        rest = np.where(first, np.where(second, distance[2], distance[1]), distance[0])
        best: Step | None = None
        for frame in (shapes.frames[i], shapes.frames[j]):
            merged = _box_around(shapes, i, j, frame)
            if merged.volumes()[0] * (1 - MOST_EMPTY) > shapes.volumes()[[i, j]].sum():
                continue
            distances = rest.copy()
            rows, own = near_distances(merged, 0, targets)
            distances[rows] = np.minimum(distances[rows], own)
            rise = float((penalties(targets, distances) - standing).sum())
            if best is None or rise < best[0]:
                best = (rise, (i, j), merged)
        if best is not None:
            steps.append(best)
    return steps


def _nearest_three(table: Float64, reach: float) -> tuple[NDArray[np.int64], Float64]:
    """The three nearest shapes (3, p) to each target, the nearest first, and their distances (3, p)."""
    padded = np.concatenate([table, np.full((3, table.shape[1]), reach)])
    nearest = np.argpartition(padded, 2, axis=0)[:3]
    distance = np.take_along_axis(padded, nearest, axis=0)
    order = np.argsort(distance, axis=0, kind="stable")
    return np.take_along_axis(nearest, order, axis=0), np.take_along_axis(distance, order, axis=0)


def _neighbours(shapes: Shapes, kept: int) -> list[tuple[int, int]]:
    """Pairs of boxes that may be merged and whose bounds touch."""
    half = np.einsum("nij,nj->ni", np.abs(shapes.frames), shapes.halves)
    movable = (shapes.kinds == Kind.BOX) & ~shapes.exact & (np.arange(len(shapes)) >= kept)
    rows = np.flatnonzero(movable)
    centers, half = shapes.centers[rows], half[rows]
    gap = np.abs(centers[:, None] - centers) - half[:, None] - half
    slack = np.minimum(half[:, None], half).max(axis=2, keepdims=True)
    first, second = np.nonzero(np.triu((gap <= slack).all(axis=2), 1))
    return list(zip(rows[first].tolist(), rows[second].tolist(), strict=True))


def _box_around(shapes: Shapes, i: int, j: int, frame: NDArray[np.float64]) -> Shapes:
    """The tight box of two boxes along the axes of `frame` (3, 3)."""
    corners = np.concatenate(
        [shapes.centers[k] + (_CORNERS * shapes.halves[k]) @ shapes.frames[k].T for k in (i, j)]
    )
    local = corners @ frame
    lower, upper = local.min(axis=0), local.max(axis=0)
    return make_shapes(Kind.BOX, ((lower + upper) / 2 @ frame.T)[None], frame, (upper - lower) / 2)
