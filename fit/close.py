"""Leaks are closed by moving faces one at a time, judged by rays that are counted and not estimated.

Whether a ray leaks or is blocked has no slope: it meets the set near its surface or it does not. So the joint
refinement can't follow it, and trades leaks for blocked rays badly. Here each face of each shape tries a few
steps, long ones first, and takes the one that lowers the error most: coordinate descent on a pattern of steps
(Hooke and Jeeves 1961).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.objective import Targets, distance_table, distances_from, near_rows, penalties
from fit.primitives import Kind
from fit.scene import Float64
from fit.shapes import KINDS, Shapes, are_of
from fit.spans import FLAT, ROUND

STEPS = (1.0, 0.5, 0.25, 0.12)
"""Cells of the air's grid that a face moves by, one pass over all shapes each."""

_ALL_AROUND = 2.0
"""Steps that a shape is grown by on all sides to find what a move of one face can change."""

_THINNEST = 1e-3
"""Of the targets' reach: no half extent gets smaller, unless it was, so that a sheet stays a solid."""


def close_leaks(
    shapes: Shapes,
    targets: Targets,
    *,
    cell: float,
    free: NDArray[np.bool_],
    steps: Sequence[float] = STEPS,
    kinds: Sequence[str] = KINDS,
) -> Shapes:
    """The set after the faces of the shapes `free` (n,) have moved; its error never rises.

    targets: those whose rays are counted (`targets.count_rays`); cell: of the air's grid; kinds: those that
    shapes may be of once they have moved: a plane that grows thick is a box.
    """
    moving = _Moving(shapes, targets, kinds)
    for step in steps:
        for which in np.flatnonzero(free & ~shapes.exact):
            moving.move(int(which), step * cell)
    return moving.shapes


class _Moving:
    """A set as it moves, and the distances (n, p) of its shapes from the targets, no more than `reach`."""

    def __init__(self, shapes: Shapes, targets: Targets, kinds: Sequence[str]) -> None:
        self.shapes, self.targets, self._kinds = shapes, targets, kinds
        self._distances = distance_table(shapes, targets, np.float32)

    def move(self, which: int, step: float) -> None:
        """Takes the one move of a face by +-`step` that lowers the error most, if any does."""
        around = _changed(self.shapes, which, np.zeros(3), np.full(3, _ALL_AROUND * step))
        rows = near_rows(around, which, self.targets, self.targets.reach)
        rows = rows[distances_from(around, which, self.targets, rows) < self.targets.reach]
        others = np.arange(len(self.shapes)) != which
        beside = self._distances[np.ix_(others, rows)].min(axis=0, initial=self.targets.reach)
        is_line = self.targets.is_line[rows]
        trial = _Trial(
            [
                (self.targets.select(rows[part]), beside[part].astype(np.float64))
                for part in (~is_line, is_line)
            ]
        )
        best, least = None, trial.error(self.shapes, which)
        for candidate in _moves(self.shapes, which, step, _THINNEST * self.targets.reach):
            if not are_of(candidate.select(slice(which, which + 1)), self._kinds)[0]:
                continue
            error = trial.error(candidate, which)
            if error < least:
                best, least = candidate, error
        if best is not None:
            self.shapes = best
            own = distances_from(best, which, self.targets, rows)
            self._distances[which, rows] = np.minimum(own, self.targets.reach)


@dataclass(frozen=True)
class _Trial:
    """The points, and the lines, that one shape comes near to, each with how near (k,) the others are."""

    near: list[tuple[Targets, Float64]]

    def error(self, shapes: Shapes, which: int) -> float:
        total = 0.0
        for targets, beside in self.near:
            distances = np.minimum(distances_from(shapes, which, targets), beside)
            total += float(penalties(targets, distances).sum())
        return total


def _moves(shapes: Shapes, which: int, step: float, thinnest: float) -> list[Shapes]:
    """The set with one face of one shape, flat or round, moved by +-`step`."""
    kind, axes = Kind(shapes.kinds[which]), np.arange(3)
    moves = []
    for way in (step, -step):
        if ROUND[kind]:
            moves.append(_changed(shapes, which, np.zeros(3), np.where(np.isin(axes, ROUND[kind]), way, 0.0)))
        for axis in FLAT[kind]:
            half = np.where(axes == axis, way / 2, 0.0)
            moves += [_changed(shapes, which, half, half), _changed(shapes, which, -half, half)]
    thinnest = min(thinnest, float(shapes.halves[which].min()))
    return [moved for moved in moves if moved.halves[which].min() >= thinnest]


def _changed(shapes: Shapes, which: int, shift: Float64, growth: Float64) -> Shapes:
    """The set with one shape's centre moved in its own frame and its half extents grown."""
    centers, halves = shapes.centers.copy(), shapes.halves.copy()
    centers[which] += shapes.frames[which] @ shift
    halves[which] += growth
    return Shapes(shapes.kinds, centers, shapes.frames, halves, shapes.exact)
