"""The set, grown by rounds: propose where it is wrong, choose what pays, refine together, move what idles.

It is the alternation of variational shape approximation (Cohen-Steiner et al. 2004) and of its hybrid form
(Wu and Kobbelt 2005), with distances to surface and air in the place of distances to the proxy's plane:
proposals at the worst places are its seeding, the nearest primitive is its partition, the joint refinement
its refit, and dropping, merging and splitting with a new choice its teleportation.

No step raises E and the rungs of growth do not know the budget, so a larger budget is never worse as long as
the set is grown: one between two rungs is the upper one's, less the shapes that it needs least. A closed
body's own fit is made anew for each size.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fit.choose import choose, offer, prune, without_least
from fit.cut import cut_worst
from fit.merge import thin_out
from fit.objective import Targets, error, leak_share, set_distances, thin
from fit.refine import refine
from fit.scene import Float64
from fit.shapes import KINDS, Shapes, are_of, join, no_shapes

RUNGS = (4, 8, 12, 16, 24, 32, 48, 64, 96, 128, 160, 192, 256, 320, 384, 448, 512)
"""Sizes at which rounds of growth end, whatever the budget."""

BODY_RUNGS = (16, 24, 32, 64, 128, 256, 512)
"""Rungs at which a closed body's own fit competes: it costs as much as a rung or two of growth."""

NEGLIGIBLE = 0.2
"""Of the softness of the error: a set of so small an error needs no more shapes."""

CHOSEN_BY = 3
"""One target of so many is looked at when candidates are chosen; whether a set is kept, all decide."""

MOVED_SHARE = 1 / 10
"""Of the shapes: the least useful, which may move to where the error is largest at the end of a round."""

EVALUATIONS = 60
"""Of the error, in one pass of the refinement."""

STEPS = (
    "parts", "growing", "regions", "bodies", "refinement", "merging", "splitting", "teleportation", "closing",
)  # fmt: skip
"""The optional steps in the order in which they join; `bench fit` leaves some out to see what each brings."""


@dataclass(frozen=True)
class Scope:
    """The kinds that may stand in the set, and the optional steps that are taken."""

    kinds: tuple[str, ...] = KINDS
    steps: tuple[str, ...] = STEPS


EVERYTHING = Scope()


@dataclass(frozen=True)
class Sources:
    """Where shapes come from.

    shapes: candidates that are always on offer, with factors `bonus` (n,) on their gains; proposers: asked
    for more in every round, given the set's distances (p,), by the names of the steps that they are; body: a
    complete set of at most so many shapes, made another way, which competes by its error; alone: where not 0,
    the body's own fit of this size is the set, without any growth.
    """

    shapes: Shapes
    bonus: Float64
    proposers: Mapping[str, Callable[[Float64, np.random.Generator], Shapes]]
    body: Callable[[int], Shapes] | None = None
    alone: int = 0


@dataclass(frozen=True)
class Enough:
    """When to stop before the budget.

    least_gain: share of the empty set's error that one more shape must take off, and `least_gain_leaking` as
    long as more than the share `most_leaks` of the rays leak; good: whether a set is good enough as it is.
    """

    least_gain: float
    least_gain_leaking: float = 0.0
    most_leaks: float = 1.0
    good: Callable[[Shapes], bool] = lambda shapes: False

    def best(self, later: Shapes, earlier: Shapes) -> Shapes:
        """The later of two sets, unless only the earlier one is good enough."""
        return earlier if self.good(earlier) and not self.good(later) else later


def build(
    targets: Targets,
    sources: Sources,
    fixed: Shapes,
    *,
    limit: int,
    max_step: float,
    enough: Enough,
    scope: Scope = EVERYTHING,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Shapes:
    """At most `limit` shapes, the `fixed` ones first and unchanged.

    max_step: farthest that a face may move in one refinement.
    """
    empty = max(error(no_shapes(), targets), np.finfo(float).tiny)
    rng = np.random.default_rng(seed)
    least = enough.least_gain * empty
    growth = _Growth(targets, sources, scope, len(fixed), least, max_step, rng)
    if sources.alone and sources.body:
        return prune(sources.body(sources.alone), targets, least_gain=growth.least)
    lower, upper = no_shapes(), fixed
    for rung in (r for r in RUNGS if r > len(fixed)):
        lower, upper = upper, growth.climb(upper, rung)
        if progress:
            progress(min(1.0, len(upper) / limit))
        if len(upper) >= limit or growth.error(upper) <= NEGLIGIBLE * targets.soft or enough.good(upper):
            break
        leaks, gave_all = leak_share(upper, targets) > enough.most_leaks, growth.least < least
        growth.least = enough.least_gain_leaking * empty if leaks else least
        if len(upper) <= len(lower) and (gave_all or not leaks):
            break
    return growth.descend(upper, lower, limit, enough)


@dataclass
class _Growth:
    """What the steps share, and the candidates proposed last."""

    targets: Targets
    sources: Sources
    scope: Scope
    kept: int
    least: float
    max_step: float
    rng: np.random.Generator
    proposed: Shapes | None = None

    @cached_property
    def thinned(self) -> Targets:
        """One target of `CHOSEN_BY`, which stands for them all."""
        return thin(self.targets, CHOSEN_BY)

    def climb(self, shapes: Shapes, size: int) -> Shapes:
        """A set of at most `size` shapes and of no larger error."""
        grown = self._better(self._filled(shapes, size), shapes)
        self.proposed = None
        if "bodies" in self.scope.steps and self.sources.body and size in BODY_RUNGS and not self.kept:
            body = self.sources.body(size)
            grown = self._better(body.select(are_of(body, self.scope.kinds)), grown)
        for step, move in (("splitting", self._split), ("teleportation", self._teleported)):
            if step in self.scope.steps and len(grown) > self.kept:
                grown = self._better(move(grown, size), grown)
        return self._better(self._refined(grown, finish=True), grown)

    def _teleported(self, shapes: Shapes, size: int) -> Shapes:
        """The least useful shapes, or one of two that are alike, moved to where the error is largest."""
        count = min(max(1, int(MOVED_SHARE * len(shapes))), len(shapes) - self.kept)
        merging = "merging" in self.scope.steps
        rest = thin_out(shapes, self.targets, count=count, kept=self.kept, merging=merging)
        return self._filled(rest, size)

    def _split(self, shapes: Shapes, size: int) -> Shapes:
        """The boxes of the largest error of their own in two, while the set is short."""
        return cut_worst(
            shapes, self.targets, self._refined, most=size, least_gain=self.least, kept=self.kept
        )

    def descend(self, shapes: Shapes, lower: Shapes, limit: int, enough: Enough) -> Shapes:
        """At most `limit` shapes between two rungs: no better than `shapes`, no worse than `lower`."""
        while len(shapes) > max(limit, self.kept) or (
            enough.good(shapes) and len(shapes) > max(self.kept, len(lower))
        ):
            fewer, heirs = without_least(shapes, self.targets, self.kept)
            refined = self._refined(fewer, heirs)
            fewer = refined if self.error(refined) >= self.error(shapes) else fewer
            if len(shapes) <= limit and not enough.good(fewer):
                break
            shapes = fewer
        if enough.good(shapes):
            return shapes
        return self._better(shapes, lower) if len(lower) <= limit else shapes

    def _filled(self, shapes: Shapes, size: int) -> Shapes:
        """The set with the candidates that pay, up to `size`, refined; shapes that do harm are left out."""
        distances = set_distances(shapes, self.targets)
        candidates, bonus = self._candidates(distances)
        thinned = distances[::CHOSEN_BY]
        offers = offer(candidates, bonus, self.thinned, thinned)
        chosen = choose(offers, self.thinned, thinned, count=size - len(shapes), least_gain=self.least)
        grown = join([shapes, candidates.select(np.array(chosen, np.int64))])
        return prune(self._refined(grown), self.targets, least_gain=0.0, kept=self.kept)

    def _candidates(self, distances: Float64) -> tuple[Shapes, Float64]:
        """All on offer; proposals for a set that was thinned out also serve to make it grow from there."""
        standing = self.sources.shapes if "parts" in self.scope.steps else no_shapes()
        if self.proposed is None:
            active = [ask for step, ask in self.sources.proposers.items() if step in self.scope.steps]
            self.proposed = join([ask(distances, self.rng) for ask in active])
        candidates = join([standing, self.proposed])
        bonus = np.ones(len(candidates))
        bonus[: len(standing)] = self.sources.bonus[: len(standing)]
        allowed = are_of(candidates, self.scope.kinds)
        return candidates.select(allowed), bonus[allowed]

    def _refined(self, shapes: Shapes, free: NDArray[np.bool_] | bool = True, finish: bool = False) -> Shapes:
        if "refinement" not in self.scope.steps:
            return shapes
        free = free & ~shapes.exact & (np.arange(len(shapes)) >= self.kept)
        refined = refine(
            shapes, self.targets, max_step=self.max_step, evaluations=EVALUATIONS, free=free, finish=finish
        )
        return refined if are_of(refined, self.scope.kinds)[self.kept :].all() else shapes

    def _better(self, one: Shapes, other: Shapes) -> Shapes:
        return one if self.error(one) < self.error(other) else other

    def error(self, shapes: Shapes) -> float:
        return error(shapes, self.targets)
