"""The grown set, held against rays that are counted: leaks are closed, and idle shapes go where rays leak.

Growth needs slopes, and follows leaks by distances. Its set is finished under

    J(S) = E(S) without its rays + leak price * leaks(S) + `BLOCKED_PRICE` * blocked(S)

by rounds of the same moves: the shapes that J needs least are dropped or merged, in every other round the
worst boxes are cut, the candidates that lower J most are chosen, and the faces around them are closed. No
round is kept unless J fell.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fit.build import Scope, Sources
from fit.choose import choose, offer, prune
from fit.close import close_leaks
from fit.cut import cut_worst
from fit.merge import thin_out
from fit.objective import Targets, error, leaking_lines, set_distances, thin
from fit.shapes import Shapes, are_of, join, no_shapes
from fit.spaces import Air
from fit.targets import count_rays

LEAK_PRICE, BLOCKED_PRICE = 0.25, 0.075
"""Of the diagonal: what leaks and blocked rays cost when all are such, beside the mean distance of the set.
A leak costs more: it lights what should be dark, and a set grown by distances leaks more than it blocks."""

LEAK_RISES = (1.0, 2.0, 4.0, 8.0)
"""Times `LEAK_PRICE` that leaks cost while more leak than were asked for."""

ROUNDS, MOVED_SHARE = 5, 0.07
"""How often shapes move, and of how many."""

LEAST_GAIN = 0.005
"""Of J: two rounds on end that bring less are the last."""

CHOSEN_BY = 4
"""One target of so many is looked at when candidates are chosen; whether a round is kept, all decide."""

ASKED_EVERY = 3
"""Rounds that are served by one call for proposals."""

ROUND_STEPS = (0.5, 0.25)
"""Cells that faces move by in a round."""

TOUCHED_CELLS = 3.0
"""Cells of the air's grid around a new or dropped shape within which the others' faces move again."""


def polish_until(
    shapes: Shapes,
    targets: Targets,
    air: Air,
    sources: Sources,
    scope: Scope,
    *,
    most_leaks: float,
    limit: int,
    kept: int = 0,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> tuple[Shapes, Targets]:
    """`polish` with counted rays, whose leaks cost more and more while over the share `most_leaks` of those
    that meet the surface leak; and the targets that judged last."""
    for rise in LEAK_RISES:
        judge = count_rays(targets, air, seed, rise * LEAK_PRICE, BLOCKED_PRICE)
        shapes = polish(
            shapes, targets, judge, sources, scope,
            limit=limit, cell=air.cell, kept=kept, seed=seed, progress=progress,
        )  # fmt: skip
        if (
            most_leaks == 1
            or leaking_lines(shapes, count_rays(targets, air, seed + 1, 1.0, 1.0)) <= most_leaks
        ):
            break  # by other rays: those that it was polished by leak less
    return shapes, judge


def polish(
    shapes: Shapes,
    targets: Targets,
    judge: Targets,
    sources: Sources,
    scope: Scope,
    *,
    limit: int,
    cell: float,
    kept: int = 0,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Shapes:
    """At most `limit` shapes of no larger error by `judge`, the targets whose rays are counted.

    targets: what the set was grown by; proposals are made where it is wrong by them. The first `kept` shapes
    stay as they are; exact ones do or go.
    """
    free = np.arange(len(shapes)) >= kept
    best = close_leaks(shapes, judge, cell=cell, free=free, kinds=scope.kinds)
    lowest, few = error(best, judge), thin(judge, CHOSEN_BY)

    def closing(trial: Shapes, free: NDArray[np.bool_]) -> Shapes:
        return close_leaks(trial, few, cell=cell, free=free, kinds=scope.kinds)

    rng, idle, offered = np.random.default_rng(seed), 0, no_shapes()
    for number in range(ROUNDS if "teleportation" in scope.steps and len(best) > kept else 0):
        rest = _without_idle(best, few, kept, "merging" in scope.steps)
        if "splitting" in scope.steps and number % 2:
            rest = cut_worst(rest, few, closing, most=limit, kept=kept)
        if number % ASKED_EVERY == 0:
            offered = _proposed(rest, targets, sources, scope, rng)
        trial = join([rest, _chosen(offered, rest, few, limit - len(rest))])
        touched = _touched(trial, best, kept, TOUCHED_CELLS * cell)
        trial = close_leaks(trial, judge, cell=cell, free=touched, steps=ROUND_STEPS, kinds=scope.kinds)
        trial = prune(trial, few, least_gain=0.0, kept=kept)
        reached = error(trial, judge)
        idle = 0 if lowest - reached > LEAST_GAIN * lowest else idle + 1
        if reached < lowest and are_of(trial, scope.kinds)[kept:].all():
            best, lowest = trial, reached
        if progress:
            progress((number + 1) / ROUNDS)
        if idle == 2:
            break
    return best


def _without_idle(shapes: Shapes, targets: Targets, kept: int, merging: bool) -> Shapes:
    """The set without the few shapes that it needs least, the first `kept` left alone."""
    count = min(max(1, int(MOVED_SHARE * len(shapes))), len(shapes) - kept)
    return thin_out(shapes, targets, count=count, kept=kept, merging=merging)


def _proposed(
    rest: Shapes, targets: Targets, sources: Sources, scope: Scope, rng: np.random.Generator
) -> Shapes:
    """All on offer where the set `rest` is wrong."""
    wrong = set_distances(rest, targets)
    asked = [ask(wrong, rng) for step, ask in sources.proposers.items() if step in scope.steps]
    offered = join([sources.shapes, *asked] if "parts" in scope.steps else asked)
    return offered.select(are_of(offered, scope.kinds))


def _chosen(offered: Shapes, rest: Shapes, few: Targets, count: int) -> Shapes:
    """At most `count` of the shapes on offer, those that lower the error of the set `rest` most."""
    current = set_distances(rest, few)
    offers = offer(offered, np.ones(len(offered)), few, current)
    return offered.select(np.array(choose(offers, few, current, count=count, least_gain=0.0), np.int64))


def _touched(shapes: Shapes, before: Shapes, kept: int, margin: float) -> NDArray[np.bool_]:
    """Which shapes (n,) are not among those `before`, or are near to one that only either set holds."""
    mine, theirs = _keys(shapes), _keys(before)
    new = np.array([key not in theirs for key in mine], bool)
    gone = np.array([key not in mine for key in theirs], bool)
    changed = join([shapes.select(new), before.select(gone)])
    lower, upper = _bounds(shapes)
    low, high = _bounds(changed)
    apart = np.maximum(lower[:, None] - high[None], low[None] - upper[:, None]).max(axis=2)
    return (new | (apart < margin).any(axis=1)) & (np.arange(len(shapes)) >= kept)


def _keys(shapes: Shapes) -> list[bytes]:
    return [
        shapes.kinds[i].tobytes()
        + shapes.centers[i].tobytes()
        + shapes.halves[i].tobytes()
        + shapes.frames[i].tobytes()
        for i in range(len(shapes))
    ]


def _bounds(shapes: Shapes) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    half = np.einsum("nij,nj->ni", np.abs(shapes.frames), shapes.halves)
    return shapes.centers - half, shapes.centers + half
