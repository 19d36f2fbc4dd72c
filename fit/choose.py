"""Which candidates make the set: greedy by what each takes off the error, and pruning of what is left."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.objective import Targets, penalties
from fit.scene import Float64
from fit.shapes import Shapes, distances_to_one


@dataclass(frozen=True)
class Reach:
    """Of one candidate: the targets that it is near (k,), and its signed distances there (k,)."""

    rows: NDArray[np.int64]
    distances: Float64


def reach_of(candidates: Shapes, targets: Targets, current: Float64) -> list[Reach]:
    """Where each candidate is nearer than `current`, the set's distances (p,)."""
    reaches = []
    for i in range(len(candidates)):
        distances = distances_to_one(candidates, i, targets.points)
        rows = np.flatnonzero(distances < current)
        reaches.append(Reach(rows, distances[rows]))
    return reaches


def choose(
    candidates: Shapes,
    targets: Targets,
    current: Float64,
    *,
    count: int,
    least_gain: float,
    bonus: Float64 | None = None,
) -> list[int]:
    """At most `count` candidates (rows, in the order chosen) to add to a set at distances `current` (p,).

    Lazy greedy (Minoux 1978): the gain of a candidate can hardly rise when another one is taken, so only the
    head of the queue is measured again. Stops when no gain is above `least_gain` (in units of E).
    bonus (n,): factors on the gain, by which simple explanations win over equal ones.
    """
    bonus = np.ones(len(candidates)) if bonus is None else bonus
    reaches = reach_of(candidates, targets, current)
    current = current.copy()
    standing = penalties(targets, current)

    def gain(i: int) -> float:
        rows, distances = reaches[i].rows, reaches[i].distances
        closer = distances < current[rows]
        rows, distances = rows[closer], distances[closer]
        return float(standing[rows].sum() - penalties(targets, distances, rows).sum())

    queue = [(-gain(i) * bonus[i], i) for i in range(len(candidates))]
    heapq.heapify(queue)
    chosen: list[int] = []
    while queue and len(chosen) < count:
        _, i = heapq.heappop(queue)
        fresh = gain(i)
        if fresh <= least_gain:
            continue
        if queue and -fresh * bonus[i] > queue[0][0]:
            heapq.heappush(queue, (-fresh * bonus[i], i))
            continue
        chosen.append(i)
        rows, distances = reaches[i].rows, reaches[i].distances
        closer = distances < current[rows]
        current[rows[closer]] = distances[closer]
        standing[rows[closer]] = penalties(targets, distances[closer], rows[closer])
    return chosen


def prune(
    shapes: Shapes, targets: Targets, *, least_gain: float, kept: int = 0, at_most: int | None = None
) -> Shapes:
    """The set without the shapes that it hardly needs, the least needed first.

    Goes on while one is worth no more than `least_gain`, or the set is larger than `at_most`. The first
    `kept` shapes stay whatever they are worth.
    """
    table = (
        np.stack([distances_to_one(shapes, i, targets.points) for i in range(len(shapes))])
        if len(shapes)
        else None
    )
    alive = np.arange(len(shapes))
    while len(alive) > kept and table is not None:
        worth = _worths(table[alive], targets)
        least = kept + int(np.argmin(worth[kept:]))
        if worth[least] > least_gain and (at_most is None or len(alive) <= at_most):
            break
        alive = np.delete(alive, least)
    return shapes.select(alive)


def worths(shapes: Shapes, targets: Targets) -> Float64:
    """What the error E would rise by without each shape alone (n,); negative where the set is better off."""
    return _worths(
        np.stack([distances_to_one(shapes, i, targets.points) for i in range(len(shapes))]), targets
    )


def _worths(table: Float64, targets: Targets) -> Float64:
    nearest = table.argmin(axis=0)
    first = np.take_along_axis(table, nearest[None], axis=0)[0]
    second = np.full(len(targets), targets.reach)
    if len(table) > 1:
        second = np.minimum(np.partition(table, 1, axis=0)[1], targets.reach)
    rise = penalties(targets, second) - penalties(targets, first)
    return np.bincount(nearest, weights=rise, minlength=len(table)).astype(np.float64)
