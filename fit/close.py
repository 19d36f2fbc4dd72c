"""Leaks are closed by moving faces one at a time, judged by rays that are counted and not estimated.

Whether a ray leaks or is blocked has no slope: it meets the set near its surface or it does not. So the joint
refinement can't follow it, and trades leaks for blocked rays badly. Here each face of each shape tries a few
steps, long ones first, and takes the one that lowers

    J(S) = E(S) without its rays + `LEAK_PRICE` * leaks(S) + `BLOCK_PRICE` * blocked(S)

most: coordinate descent on a pattern of steps (Hooke and Jeeves 1961). Leaks cost more than blocked rays: a
leak lights what should be dark, and a set refined by distances alone leaks more than it blocks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.objective import Targets, distance_table, near_rows, penalties
from fit.primitives import Kind
from fit.sample import random_directions
from fit.scene import Float64
from fit.shapes import Shapes, distances_to_one
from fit.spaces import Air
from fit.spans import FLAT, ROUND, entries_of_one

LEAK_PRICE, BLOCK_PRICE = 0.2, 0.05
"""Of the diagonal: what a share of one of leaking, and of blocked rays costs, beside the mean distances."""

STEPS = (1.0, 0.5, 0.25, 0.12)
"""Cells of the air's grid that a face moves by, one pass over all shapes each."""

LINES, LINES_PER_POINT = 120_000, 4
"""Rays that are counted, from points of the air: fewer are learned by heart, and others go on leaking."""

SLACK = 0.01
"""Of the diagonal: a ray leaks that goes on for longer behind the surface, and is blocked so far before."""

_THINNEST = 1e-3
"""Of the targets' reach: no half extent gets smaller, so that a sheet stays a solid."""

_OWN_LINES = 15_485_863
"""Added to the seed: neither growth nor report looks along these rays."""

_MOST_RISES, _RISE = 4, 2.0
"""How often the price of a leak rises, and by what factor, while more leak than are asked for."""


@dataclass(frozen=True)
class Lines:
    """Rays (r, 3) of unit directions from points of the air, and where each meets the surface (r,), inf where
    it does not; slack: how much farther or nearer makes no odds."""

    origins: Float64
    directions: Float64
    ends: Float64
    slack: float

    def __len__(self) -> int:
        return len(self.origins)


def draw_lines(air: Air, seed: int) -> Lines:
    """Random rays through the air."""
    starts = air.random_points(LINES // LINES_PER_POINT, seed + _OWN_LINES)
    origins = np.repeat(starts, LINES_PER_POINT, axis=0)
    directions = random_directions(len(origins), (seed + _OWN_LINES, 1))
    ends = air.rays.first_hit(origins, directions)[0]
    return Lines(origins, directions, ends, SLACK * air.walls.diagonal)


def close_leaks(
    shapes: Shapes, targets: Targets, lines: Lines, *, cell: float, most_leaks: float = 1.0, kept: int = 0
) -> Shapes:
    """The set after its faces moved; the first `kept` shapes and exact ones stay as they are.

    cell: of the air's grid. While more than the share `most_leaks` of the rays that meet the surface leak,
    the price of a leak rises.
    """
    points = targets.select(np.flatnonzero(~targets.passing & ~targets.is_ray))
    diagonal = lines.slack / SLACK
    for rise in range(_MOST_RISES + 1):
        costs = _Costs.of(lines, LEAK_PRICE * diagonal * _RISE**rise, BLOCK_PRICE * diagonal)
        state = _State(shapes, points, lines, costs)
        for step in STEPS:
            for i in np.flatnonzero(~shapes.exact):
                if i >= kept:
                    state.move(int(i), step * cell)
        shapes = state.shapes
        if state.leaks() <= most_leaks or most_leaks == 1.0:
            break
    return shapes


@dataclass(frozen=True)
class _Costs:
    """For each ray (r,): from where to where the set must stop it, and what else it costs."""

    first: Float64
    last: Float64
    leak: Float64
    block: float

    @staticmethod
    def of(lines: Lines, leak: float, block: float) -> _Costs:
        met = np.isfinite(lines.ends)
        each = np.where(met, leak / max(int(met.sum()), 1), 0.0)
        return _Costs(lines.ends - lines.slack, lines.ends + lines.slack, each, block / max(len(lines), 1))

    def select(self, rows: NDArray[np.int64]) -> _Costs:
        return _Costs(self.first[rows], self.last[rows], self.leak[rows], self.block)

    def total(self, entries: Float64) -> float:
        """Of rays that meet the set at these distances (r,)."""
        return float(self.leak @ (entries > self.last)) + self.block * int(
            np.count_nonzero(entries < self.first)
        )


class _State:
    """The set as it moves, with its distances (n, p) from the points, and where rays enter it (n, r)."""

    def __init__(self, shapes: Shapes, points: Targets, lines: Lines, costs: _Costs) -> None:
        self.shapes, self.points, self.lines, self.costs = shapes, points, lines, costs
        self._distances = distance_table(shapes, points).astype(np.float32)
        self._entries = np.empty((len(shapes), len(lines)), np.float32)
        for i in range(len(shapes)):
            self._entries[i] = self._enter(shapes, i)

    def _enter(self, shapes: Shapes, which: int) -> Float64:
        return entries_of_one(shapes, which, self.lines.origins, self.lines.directions)

    def leaks(self) -> float:
        met = self.costs.leak > 0
        late = self._entries.min(axis=0, initial=np.inf) > self.costs.last
        return float(late[met].mean()) if met.any() else 0.0

    def move(self, which: int, step: float) -> None:
        """Takes the one move of a face by +-`step` that lowers J most, if any does."""
        bounds = _resized(self.shapes, which, 2 * step)
        rays = np.flatnonzero(np.isfinite(self._enter(bounds, which)))
        rows = near_rows(bounds, which, self.points, self.points.reach)
        others = np.arange(len(self.shapes)) != which
        trial = _Trial(
            self.points.select(rows),
            self._distances[np.ix_(others, rows)].min(axis=0, initial=self.points.reach),
            self.lines.origins[rays], self.lines.directions[rays],
            self._entries[np.ix_(others, rays)].min(axis=0, initial=np.inf),
            self.costs.select(rays),
        )  # fmt: skip
        best, least = None, trial.cost(self.shapes, which)
        for candidate in _moves(self.shapes, which, step, _THINNEST * self.points.reach):
            cost = trial.cost(candidate, which)
            if cost < least:
                best, least = candidate, cost
        if best is not None:
            self.shapes = best
            self._entries[which, rays] = trial.enter(best, which)
            self._distances[which] = self.points.reach
            near = np.minimum(distances_to_one(best, which, trial.points.points), self.points.reach)
            self._distances[which, rows] = near


@dataclass(frozen=True)
class _Trial:
    """What one shape can change: points and rays that it comes near to, and how near the others are."""

    points: Targets
    distances: Float64
    origins: Float64
    directions: Float64
    entries: Float64
    costs: _Costs

    def enter(self, shapes: Shapes, which: int) -> Float64:
        return entries_of_one(shapes, which, self.origins, self.directions)

    def cost(self, shapes: Shapes, which: int) -> float:
        distances = np.minimum(distances_to_one(shapes, which, self.points.points), self.distances)
        entries = np.minimum(self.enter(shapes, which), self.entries)
        return float(penalties(self.points, distances).sum()) + self.costs.total(entries)


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
    return [moved for moved in moves if moved.halves[which].min() > thinnest]


def _resized(shapes: Shapes, which: int, by: float) -> Shapes:
    return _changed(shapes, which, np.zeros(3), np.full(3, by))


def _changed(shapes: Shapes, which: int, shift: Float64, growth: Float64) -> Shapes:
    """The set with one shape's centre moved in its own frame and its half extents grown."""
    centers, halves = shapes.centers.copy(), shapes.halves.copy()
    centers[which] += shapes.frames[which] @ shift
    halves[which] += growth
    return Shapes(shapes.kinds, centers, shapes.frames, halves, shapes.exact)
