"""Which candidates make the set: greedy by what each takes off the error, and pruning of what is left."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.objective import RUN, Targets, distance_table, near_distances, penalties
from fit.scene import Float64
from fit.shapes import Shapes


@dataclass(frozen=True)
class Offers:
    """n candidates, factors (n,) on their gains, and where each was nearer than the set when it was offered.

    Candidate i is near the targets rows[starts[i]:starts[i + 1]], at `distances`, with the error `own` there.
    """

    shapes: Shapes
    bonus: Float64
    starts: NDArray[np.int64]
    rows: NDArray[np.int32]
    distances: NDArray[np.float32]
    own: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.shapes)

    def gains(self, current: Float64, standing: Float64) -> Float64:
        """What each takes off the errors `standing` (p,) of a set at distances `current` (p,)."""
        saved = np.where(self.distances < current[self.rows], standing[self.rows] - self.own, 0.0)
        return np.diff(np.concatenate([[0.0], np.cumsum(saved)])[self.starts])

    def gain(self, i: int, current: Float64, standing: Float64) -> float:
        span = slice(self.starts[i], self.starts[i + 1])
        rows = self.rows[span]
        saved = np.where(self.distances[span] < current[rows], standing[rows] - self.own[span], 0.0)
        return float(saved.sum())

    def join(self, i: int, current: Float64, standing: Float64) -> None:
        """Lowers `current` and `standing` in place to those of the set with candidate i."""
        span = slice(self.starts[i], self.starts[i + 1])
        closer = self.distances[span] < current[self.rows[span]]
        rows = self.rows[span][closer]
        current[rows] = self.distances[span][closer]
        standing[rows] = self.own[span][closer]


def offer(candidates: Shapes, bonus: Float64, targets: Targets, current: Float64) -> Offers:
    """The candidates held against a set at distances `current` (p,)."""
    starts, rows, distances = [0], [], []
    open_to = np.where(np.repeat(run_maxima(current, targets), RUN)[: len(current)] > 0, current, -np.inf)
    for i in range(len(candidates)):
        near, own = near_distances(candidates, i, targets)
        closer = np.flatnonzero(own < open_to[near])
        rows.append(near[closer].astype(np.int32))
        distances.append(own[closer].astype(np.float32))
        starts.append(starts[-1] + len(closer))
    joined = np.concatenate([*rows, np.zeros(0, np.int32)])
    own_distances = np.concatenate([*distances, np.zeros(0, np.float32)])
    own_error = penalties(targets, own_distances.astype(np.float64), joined).astype(np.float32)
    return Offers(candidates, bonus, np.array(starts), joined, own_distances, own_error)


def run_maxima(values: Float64, targets: Targets) -> Float64:
    """Largest of the values (p,) in each of the targets' runs, at least 0."""
    if len(values) == 0:
        return np.zeros(0)
    return np.maximum(np.maximum.reduceat(values, np.arange(0, len(targets), RUN)), 0.0)


def choose(offers: Offers, targets: Targets, current: Float64, *, count: int, least_gain: float) -> list[int]:
    """At most `count` of the offers (rows, in the order chosen) to add to a set at distances `current` (p,).

    Lazy greedy (Minoux 1978): the gain of a candidate can hardly rise when another one is taken, so only the
    head of the queue is measured again. Stops when no gain is above `least_gain` (in units of E).
    """
    current = current.copy()
    standing = penalties(targets, current)
    queue = [(-g, i) for i, g in enumerate(offers.gains(current, standing) * offers.bonus) if g > 0]
    heapq.heapify(queue)
    chosen: list[int] = []
    while queue and len(chosen) < count:
        _, i = heapq.heappop(queue)
        fresh = offers.gain(i, current, standing)
        if fresh <= least_gain:
            continue
        if queue and -fresh * offers.bonus[i] > queue[0][0]:
            heapq.heappush(queue, (-fresh * float(offers.bonus[i]), i))
            continue
        chosen.append(i)
        offers.join(i, current, standing)
    return chosen


def prune(
    shapes: Shapes, targets: Targets, *, least_gain: float, kept: int = 0, at_most: int | None = None
) -> Shapes:
    """The set without the shapes that it hardly needs, the least needed first.

    Goes on while one is worth no more than `least_gain`, or the set is larger than `at_most`. The first
    `kept` shapes stay whatever they are worth.
    """
    table = distance_table(shapes, targets)
    alive = np.arange(len(shapes))
    while len(alive) > kept:
        worth = worths(table[alive], targets)
        least = kept + int(np.argmin(worth[kept:]))
        if worth[least] > least_gain and (at_most is None or len(alive) <= at_most):
            break
        alive = np.delete(alive, least)
    return shapes.select(alive)


def without_least(shapes: Shapes, targets: Targets, kept: int) -> tuple[Shapes, NDArray[np.bool_]]:
    """The set without its least useful shape, and which of the others (n - 1,) are nearest in its place."""
    table = distance_table(shapes, targets)
    least = kept + int(np.argmin(worths(table, targets)[kept:]))
    orphans = table.argmin(axis=0) == least
    rest = np.delete(table[:, orphans], least, axis=0)
    heirs = np.zeros(len(rest), bool)
    heirs[rest.argmin(axis=0)[rest.min(axis=0, initial=np.inf) < targets.reach]] = True
    return shapes.select(np.delete(np.arange(len(shapes)), least)), heirs


def worths(table: Float64, targets: Targets) -> Float64:
    """What E would rise by without each shape alone (n,), from the shapes' distances (n, p).

    Negative where the set is better off without it.
    """
    nearest = table.argmin(axis=0)
    first = np.minimum(np.take_along_axis(table, nearest[None], axis=0)[0], targets.reach)
    second = np.full(len(targets), targets.reach)
    if len(table) > 1:
        second = np.minimum(np.partition(table, 1, axis=0)[1], targets.reach)
    rise = penalties(targets, second) - penalties(targets, first)
    return np.bincount(nearest, weights=rise, minlength=len(table)).astype(np.float64)
