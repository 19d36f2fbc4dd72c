"""The set, grown by rounds: propose where it is wrong, choose what pays, refine together, drop what is idle.

It is the alternation of variational shape approximation (Cohen-Steiner et al. 2004) and of its hybrid form
(Wu and Kobbelt 2005), with distances to surface and air in the place of distances to the proxy's plane:
proposals at the worst places are its seeding, the nearest primitive is its partition, the joint refinement
its refit, and pruning with a new choice its teleportation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.choose import choose, prune
from fit.grow import Lattice, grow_boxes
from fit.objective import Targets, error, penalties, set_distances
from fit.refine import refine
from fit.scene import Float64
from fit.shapes import KINDS, Shapes, are_of, join, no_shapes

SIZES = (4, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)
"""Rounds end at these sizes whatever the budget: a larger budget goes on from where a smaller one stopped."""

SEEDS = 400
"""Surface points, drawn by the error there, that boxes are grown from in a round."""

TELEPORTS = 2
"""Rounds at the final size, each of which may move the least useful tenth to where the error is largest."""

EVALUATIONS = 60
STEP_CELLS = 1.5


STEPS = ("parts", "growing", "refinement", "teleportation")
"""The optional steps in the order they join; `bench fit` leaves some out to learn what each brings."""


@dataclass(frozen=True)
class Scope:
    """The kinds that may stand in the set, and the optional steps that are taken."""

    kinds: tuple[str, ...] = KINDS
    steps: tuple[str, ...] = STEPS


EVERYTHING = Scope()


@dataclass(frozen=True)
class Pool:
    """Candidates that stay on offer in every round, and the factors (n,) on their gains."""

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
    rng = np.random.default_rng(seed)
    least = least_gain * max(error(no_shapes(), targets), np.finfo(float).tiny)
    shapes = fixed.select(slice(0, limit))
    for size in [*(s for s in SIZES if len(fixed) < s < limit), limit]:
        before = len(shapes)
        shapes = _round(shapes, len(fixed), targets, lattices, pool, size, least, scope, rng)
        if progress:
            progress(len(shapes) / limit)
        if len(shapes) <= before or (good_enough and good_enough(shapes)):
            break
    for _ in range(TELEPORTS if "teleportation" in scope.steps else 0):
        kept = prune(
            shapes, targets, least_gain=least, kept=len(fixed), at_most=len(shapes) - len(shapes) // 10
        )
        size = min(limit, len(shapes))
        moved = _round(kept, len(fixed), targets, lattices, pool, size, least, scope, rng)
        if error(moved, targets) > (1 - 1e-3) * error(shapes, targets):
            break
        shapes = moved
    return shapes


def _round(
    shapes: Shapes,
    kept: int,
    targets: Targets,
    lattices: list[Lattice],
    pool: Pool,
    size: int,
    least: float,
    scope: Scope,
    rng: np.random.Generator,
) -> Shapes:
    distances = set_distances(shapes, targets)
    standing = pool.shapes if "parts" in scope.steps else no_shapes()
    grown = propose(targets, lattices, distances, rng) if "growing" in scope.steps else no_shapes()
    candidates = join([standing, grown])
    bonus = np.concatenate([pool.bonus[: len(standing)], np.ones(len(grown))])
    allowed = are_of(candidates, scope.kinds)
    candidates, bonus = candidates.select(allowed), bonus[allowed]
    chosen = choose(candidates, targets, distances, count=size - len(shapes), least_gain=least, bonus=bonus)
    shapes = join([shapes, candidates.select(np.array(chosen, np.int64))])
    free = ~shapes.exact
    free[:kept] = False
    if "refinement" in scope.steps:
        step = STEP_CELLS * lattices[0].cell
        shapes = refine(shapes, targets, max_step=step, evaluations=EVALUATIONS, free=free)
        stays = are_of(shapes, scope.kinds)
        stays[:kept] = True
        shapes = shapes.select(stays)
    return prune(shapes, targets, least_gain=least, kept=kept)


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
    chance = np.where(targets.is_surface, penalties(targets, distances), 0.0)
    total = float(chance.sum())
    if not total > 0:
        return np.zeros(0, np.int64)
    count = min(SEEDS, int(np.count_nonzero(chance)))
    return np.sort(rng.choice(len(chance), size=count, replace=False, p=chance / total)).astype(np.int64)
