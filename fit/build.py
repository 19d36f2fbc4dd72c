"""The set, grown by rounds: propose where it is wrong, choose what pays, refine together, move what idles.

It is the alternation of variational shape approximation (Cohen-Steiner et al. 2004) and of its hybrid form
(Wu and Kobbelt 2005), with distances to surface and air in the place of distances to the proxy's plane:
proposals at the worst places are its seeding, the nearest primitive is its partition, the joint refinement
its refit, and dropping, merging and splitting with a new choice its teleportation.

No step raises E and the rungs of growth do not know the budget, so a larger budget is never worse: a set
between two rungs is the upper one's, less the shapes that it needs least.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.choose import choose, offer, prune, without_least
from fit.grow import Lattice, grow_boxes
from fit.objective import Targets, error, penalties, set_distances
from fit.refine import refine
from fit.scene import Float64
from fit.shapes import KINDS, Shapes, are_of, join, no_shapes

RUNGS = (4, 6, 8, 12, 16, 20, 24, 32, 40, 48, 64, 80, 96, 128, 160, 192, 256, 320, 384, 448, 512)
"""Sizes at which rounds of growth end, whatever the budget."""

SEEDS = 400
"""Points, drawn by the error there, that boxes are grown from in a round."""

MOVED_SHARE = 1 / 10
"""Of the shapes: the least useful, which may move to where the error is largest at the end of a round."""

EVALUATIONS = 60
"""Of the error, in one pass of the refinement."""

STEP_CELLS = 1.5
"""Farthest that a face may move in one pass."""

STEPS = ("parts", "growing", "refinement", "teleportation")
"""The optional steps in the order in which they join; `bench fit` leaves some out to see what each brings."""


@dataclass(frozen=True)
class Scope:
    """The kinds that may stand in the set, and the optional steps that are taken."""

    kinds: tuple[str, ...] = KINDS
    steps: tuple[str, ...] = STEPS


EVERYTHING = Scope()


@dataclass(frozen=True)
class Pool:
    """Candidates that stay on offer all the time, and the factors (n,) on their gains."""

    shapes: Shapes
    bonus: Float64


def build(
    targets: Targets,
    lattices: list[Lattice],
    pool: Pool,
    fixed: Shapes,
    *,
    limit: int,
    least_gain: float,
    scope: Scope = EVERYTHING,
    good_enough: Callable[[Shapes], bool] | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Shapes:
    """At most `limit` shapes, the `fixed` ones first and unchanged.

    least_gain: share of the empty set's error that one more shape must take off; good_enough: an end before.
    """
    least = least_gain * max(error(no_shapes(), targets), np.finfo(float).tiny)
    growth = _Growth(targets, lattices, pool, scope, len(fixed), least, np.random.default_rng(seed))
    lower, upper = no_shapes(), fixed
    for rung in (r for r in RUNGS if r > len(fixed)):
        lower, upper = upper, growth.climb(upper, rung)
        if progress:
            progress(min(1.0, len(upper) / limit))
        if len(upper) <= len(lower) or len(upper) >= limit or (good_enough and good_enough(upper)):
            break
    return growth.descend(upper, lower, limit)


@dataclass
class _Growth:
    """What the steps share."""

    targets: Targets
    lattices: list[Lattice]
    pool: Pool
    scope: Scope
    kept: int
    least: float
    rng: np.random.Generator

    def climb(self, shapes: Shapes, size: int) -> Shapes:
        """A set of at most `size` shapes and of no larger error."""
        grown = self._round(shapes, size)
        if "teleportation" in self.scope.steps and len(grown) > self.kept:
            fewer = len(grown) - max(1, int(MOVED_SHARE * len(grown)))
            rest = prune(grown, self.targets, least_gain=self.least, kept=self.kept, at_most=fewer)
            grown = self._better(self._round(rest, size), grown)
        return self._better(grown, shapes)

    def descend(self, shapes: Shapes, lower: Shapes, limit: int) -> Shapes:
        """At most `limit` shapes between two rungs: no better than `shapes`, no worse than `lower`."""
        while len(shapes) > limit:
            fewer, heirs = without_least(shapes, self.targets, self.kept)
            refined = self._refined(fewer, heirs)
            shapes = refined if self._error(refined) >= self._error(shapes) else fewer
        return self._better(shapes, lower) if len(lower) <= limit else shapes

    def _round(self, shapes: Shapes, size: int) -> Shapes:
        distances = set_distances(shapes, self.targets)
        candidates, bonus = self._candidates(distances)
        offers = offer(candidates, bonus, self.targets, distances)
        chosen = choose(offers, self.targets, distances, count=size - len(shapes), least_gain=self.least)
        grown = join([shapes, candidates.select(np.array(chosen, np.int64))])
        return prune(self._refined(grown), self.targets, least_gain=0.0, kept=self.kept)

    def _candidates(self, distances: Float64) -> tuple[Shapes, Float64]:
        standing = self.pool.shapes if "parts" in self.scope.steps else no_shapes()
        grown = no_shapes()
        if "growing" in self.scope.steps:
            grown = propose(self.targets, self.lattices, distances, self.rng)
        candidates = join([standing, grown])
        bonus = np.concatenate([self.pool.bonus[: len(standing)], np.ones(len(grown))])
        allowed = are_of(candidates, self.scope.kinds)
        return candidates.select(allowed), bonus[allowed]

    def _refined(self, shapes: Shapes, free: NDArray[np.bool_] | bool = True) -> Shapes:
        if "refinement" not in self.scope.steps:
            return shapes
        free = free & ~shapes.exact & (np.arange(len(shapes)) >= self.kept)
        step = STEP_CELLS * self.lattices[0].cell
        refined = refine(shapes, self.targets, max_step=step, evaluations=EVALUATIONS, free=free)
        return refined if are_of(refined, self.scope.kinds)[self.kept :].all() else shapes

    def _better(self, one: Shapes, other: Shapes) -> Shapes:
        return one if self._error(one) < self._error(other) else other

    def _error(self, shapes: Shapes) -> float:
        return error(shapes, self.targets)


def propose(
    targets: Targets, lattices: list[Lattice], distances: Float64, rng: np.random.Generator
) -> Shapes:
    """Boxes grown from surface points drawn in proportion to their error at the set's `distances` (p,)."""
    seeds = _worst(targets, distances, rng)
    share = np.array_split(rng.permutation(seeds), max(len(lattices), 1)) if len(lattices) > 1 else [seeds]
    return join(
        [grow_boxes(lattice, targets, np.sort(own)) for lattice, own in zip(lattices, share, strict=True)]
    )


def _worst(targets: Targets, distances: Float64, rng: np.random.Generator) -> NDArray[np.int64]:
    chance = np.where(targets.is_surface | targets.is_ray, penalties(targets, distances), 0.0)
    total = float(chance.sum())
    if not total > 0:
        return np.zeros(0, np.int64)
    count = min(SEEDS, int(np.count_nonzero(chance)))
    return np.sort(rng.choice(len(chance), size=count, replace=False, p=chance / total)).astype(np.int64)
