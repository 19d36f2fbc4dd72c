"""One box becomes two where one does not do: its halves, or its ends with the middle left open."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fit.objective import Targets, distance_table, error, penalties
from fit.primitives import Kind
from fit.shapes import Shapes, join, make_shapes

TRIED = 3
"""Boxes that are cut on trial, those of the largest error of their own first."""

ENDS = (0.12, 0.24, 0.36)
"""Of a side: each end of a box whose middle is left open, as that of a lid over a court should be."""

Refine = Callable[[Shapes, NDArray[np.bool_]], Shapes]


def cut_worst(
    shapes: Shapes, targets: Targets, refine: Refine, *, most: int, least_gain: float = 0.0, kept: int = 0
) -> Shapes:
    """The set with up to `TRIED` boxes in two, as long as there is room and each takes enough off E."""
    if len(shapes) == 0:
        return shapes
    table = distance_table(shapes, targets)
    own = np.bincount(table.argmin(axis=0), penalties(targets, table.min(axis=0)), len(shapes))
    can = (shapes.kinds == Kind.BOX) & ~shapes.exact & (np.arange(len(shapes)) >= kept)
    worst = [int(i) for i in np.argsort(-own, kind="stable") if can[i]][:TRIED]
    lowest = error(shapes, targets)
    for i in worst:
        if len(shapes) >= most:
            break
        longest, second = np.argsort(-shapes.halves[i], kind="stable")[:2]
        cuts = [(longest, 0.5), *((axis, share) for axis in (longest, second) for share in ENDS)]
        trial = min((_cut(shapes, i, axis, share) for axis, share in cuts), key=lambda t: error(t, targets))
        free = np.arange(len(trial)) == len(shapes)
        free[i] = True
        trial = refine(trial, free)
        reached = error(trial, targets)
        if lowest - reached > least_gain:
            shapes, lowest = trial, reached
    return shapes


def _cut(shapes: Shapes, which: int, axis: int, share: float) -> Shapes:
    """The set with the two ends of one box, each this share of it: one in its place, the other last."""
    halves = shapes.halves[which].copy()
    offset = shapes.frames[which][:, axis] * halves[axis] * (1 - share)
    halves[axis] *= share
    both = make_shapes(
        Kind.BOX,
        np.stack([shapes.centers[which] - offset, shapes.centers[which] + offset]),
        shapes.frames[which],
        halves,
    )
    before, after = shapes.select(slice(0, which)), shapes.select(slice(which + 1, None))
    return join([before, both.select(slice(0, 1)), after, both.select(slice(1, 2))])
