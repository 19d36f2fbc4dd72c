"""Joint refinement of a set, every parameter at once: nlopt's L-BFGS, and scipy's least squares to finish.

Each target depends on one shape, the nearest, so the Jacobian of the errors' roots is sparse, and scipy's
trust region method (Branch, Coleman and Li 1999) knows a curvature that L-BFGS has to learn: near the optimum
it gets further in fewer steps.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, fields

import nlopt
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.sparse import csr_array

from fit.objective import Targets, error, near_rows, penalties, penalty_slopes, set_distances
from fit.scene import Float64
from fit.shapes import PARAMETERS, Shapes, distances_to_one, moved, pair_derivatives, pair_distances

NEAREST = 4
"""Shapes that may become a target's nearest one while the optimiser moves them."""

LEAST_TARGETS, TARGETS_PER_SHAPE = 3000, 300
"""Of the targets that one descent looks at; whether it is kept is decided on all of them."""

MOST_STEPS = 2.0
"""Largest steps that a face moves by: its centre's and its extent's together."""

MAX_TURN = 0.3
"""Radians that a shape may turn in one refinement: farther away lies another start, not this optimum."""

LEAST_SQUARES_STEPS = 12
"""Evaluations of scipy's trust region method; docs/method.md has figures."""

_WITHIN = 1e-9
"""How far inside its bounds the trust region method starts, in units of a step."""

THINNEST = 1e-3
"""Of the reach: no half extent gets smaller, so that a sheet stays a solid."""


def refine(
    shapes: Shapes,
    targets: Targets,
    *,
    max_step: float,
    evaluations: int,
    free: NDArray[np.bool_] | None = None,
    passes: int = 2,
    finish: bool = False,
) -> Shapes:
    """The set after L-BFGS (Nocedal 1980, as in nlopt) has moved, turned and resized its shapes.

    max_step: metres that a centre or a face may move in one pass; free (n,) bool: the shapes that may change
    (default: all that are not exact); finish: by least squares, from near the optimum. The returned set's
    error is never above the given one's.
    """
    free = ~shapes.exact if free is None else free
    best, lowest = shapes, error(shapes, targets)
    for _ in range(passes):
        if not free.any():
            break
        candidate = _descend(best, targets, free, max_step, evaluations, finish)
        reached = error(candidate, targets)
        if not reached < lowest:
            break
        paid = lowest - reached > 1e-3 * lowest
        best, lowest = candidate, reached
        if not paid:
            break
    return best


def _descend(
    shapes: Shapes,
    targets: Targets,
    free: NDArray[np.bool_],
    max_step: float,
    evaluations: int,
    finish: bool,
) -> Shapes:
    moving = shapes.select(free)
    targets = targets.select(
        ~targets.is_line
    )  # that a way is free has no slope; whether a step is kept, it decides
    targets = _in_sight(moving, targets, 2 * MOST_STEPS * max_step)
    pairs = _pairs_that_matter(moving, shapes.select(~free), targets, max_step)
    if len(pairs.place) == 0:
        return shapes
    refined = _minimise(moving, targets, pairs, max_step, evaluations, finish)
    rows = np.flatnonzero(free)
    joined = {f.name: getattr(shapes, f.name).copy() for f in fields(Shapes)}
    for name, values in joined.items():
        values[rows] = getattr(refined, name)
    return Shapes(**joined)


def _in_sight(moving: Shapes, targets: Targets, margin: float) -> Targets:
    """Targets that a moving shape may come near to, thinned evenly: a few shapes need no more than a few."""
    near = np.zeros(len(targets), bool)
    for i in range(len(moving)):
        near[near_rows(moving, i, targets, targets.reach + margin)] = True
    rows = np.flatnonzero(near)
    most = max(LEAST_TARGETS, TARGETS_PER_SHAPE * len(moving))
    return targets.select(rows[:: max(1, -(-len(rows) // most))])


@dataclass(frozen=True)
class _Pairs:
    """Places of targets (k, 3) and the moving shapes (k,) that may be nearest there; `starts` (m,) of the
    runs of one target, `run` (k,), the targets (m,), and `fixed` (m,), how near the shapes that stay are."""

    place: Float64
    shape: NDArray[np.int64]
    starts: NDArray[np.int64]
    run: NDArray[np.int64]
    members: Targets
    fixed: Float64


def _pairs_that_matter(moving: Shapes, others: Shapes, targets: Targets, max_step: float) -> _Pairs:
    """Pairs of a target's place and a shape that may become the nearest to the target as it moves."""
    fixed = set_distances(others, targets)
    places, owners = targets.places
    order = np.argsort(owners, kind="stable")
    places, owners = places[order], owners[order]
    table = np.stack([distances_to_one(moving, i, places) for i in range(len(moving))])
    first_place = np.flatnonzero(np.diff(owners, prepend=-1))
    nearest = np.minimum(np.minimum.reduceat(table.min(axis=0), first_place), fixed)[owners]
    limit = np.minimum(nearest + 2 * MOST_STEPS * max_step, targets.reach + MOST_STEPS * max_step)
    if len(moving) > NEAREST:
        limit = np.minimum(limit, np.partition(table, NEAREST - 1, axis=0)[NEAREST - 1])
    place, shape = np.nonzero((table <= limit).T)
    owner = owners[place]
    starts = np.flatnonzero(np.diff(owner, prepend=-1))
    run = np.searchsorted(starts, np.arange(len(owner)), side="right") - 1
    members = owner[starts]
    return _Pairs(places[place], shape, starts, run, targets.select(members), fixed[members])


def _minimise(
    moving: Shapes, targets: Targets, pairs: _Pairs, max_step: float, evaluations: int, finish: bool
) -> Shapes:
    """The moving shapes at the lowest error that nlopt, or to `finish` scipy, has seen."""
    scale = _scales(moving, max_step)
    lower, upper = (b.ravel() for b in _bounds(moving, targets.reach, max_step, scale))
    best_x, best_value = np.clip(np.zeros(scale.size), lower, upper), np.inf

    def at(x: Float64) -> tuple[Shapes, Float64, Float64, float]:
        nonlocal best_x, best_value
        trial = moved(moving, x.reshape(-1, PARAMETERS) * scale)
        distances = pair_distances(trial, pairs.place, pairs.shape)
        nearest = np.minimum(np.minimum.reduceat(distances, pairs.starts), pairs.fixed)
        value = float(penalties(pairs.members, nearest).sum())
        if np.isfinite(value) and value < best_value:
            best_x, best_value = x.copy(), value
        return trial, distances, nearest, value

    def objective(x: Float64, gradient: Float64) -> float:
        trial, distances, nearest, value = at(x)
        if gradient.size:
            gradient[:] = (_slopes(moving, trial, pairs, distances, nearest) * scale).ravel()
        return value

    if finish:
        with suppress(ValueError, np.linalg.LinAlgError):  # of a degenerate start; the best point stays
            least_squares(
                lambda x: _roots(pairs.members, at(x)[2])[0],
                np.clip(best_x, lower + _WITHIN, upper - _WITHIN),
                jac=lambda x: _jacobian(moving, pairs, scale, *at(x)[:3]),
                bounds=(lower, upper), method="trf", tr_solver="lsmr", max_nfev=LEAST_SQUARES_STEPS,
            )  # fmt: skip
        return moved(moving, best_x.reshape(-1, PARAMETERS) * scale)
    optimizer = nlopt.opt(nlopt.LD_LBFGS, scale.size)
    optimizer.set_exceptions_enabled(False)
    optimizer.set_min_objective(objective)
    optimizer.set_lower_bounds(lower)
    optimizer.set_upper_bounds(upper)
    optimizer.set_maxeval(evaluations)
    optimizer.set_ftol_rel(1e-5)
    optimizer.optimize(best_x.copy())
    return moved(moving, best_x.reshape(-1, PARAMETERS) * scale)


def _roots(members: Targets, nearest: Float64) -> tuple[Float64, Float64]:
    """Signed roots (m,) of the errors, whose squares least squares sum, and their slopes by the distance."""
    root = np.sqrt(np.maximum(penalties(members, nearest), 0.0))
    sign = np.where(nearest < members.distances, -1.0, 1.0)
    slope = penalty_slopes(members, nearest) / (2 * np.maximum(root, np.finfo(float).tiny ** 0.5))
    return sign * root, sign * slope


def _jacobian(
    moving: Shapes, pairs: _Pairs, scale: Float64, trial: Shapes, distances: Float64, nearest: Float64
) -> csr_array:
    """Sparse derivatives (m, 9 n) of the signed roots: one shape, the nearest, carries each target."""
    slope = _roots(pairs.members, nearest)[1]
    carriers = np.flatnonzero(distances <= nearest[pairs.run])
    row, first = np.unique(pairs.run[carriers], return_index=True)
    carriers = carriers[first]
    shape = pairs.shape[carriers]
    derivatives = pair_derivatives(trial, pairs.place[carriers], shape) * slope[row]
    derivatives[3:6] = _in_start_frames(moving.select(shape), trial.select(shape), derivatives[3:6].T).T
    values = derivatives * scale[shape].T
    columns = shape * PARAMETERS + np.arange(PARAMETERS)[:, None]
    rows = np.broadcast_to(row, columns.shape)
    return csr_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=(len(slope), scale.size))


def _slopes(moving: Shapes, trial: Shapes, pairs: _Pairs, distances: Float64, nearest: Float64) -> Float64:
    """Derivatives (n, 9) of the error by the steps of the shapes; the nearest shape carries each target."""
    slope = penalty_slopes(pairs.members, nearest)[pairs.run]
    carriers = np.flatnonzero((distances <= nearest[pairs.run]) & (slope != 0))
    shape = pairs.shape[carriers]
    derivatives = pair_derivatives(trial, pairs.place[carriers], shape) * slope[carriers]
    total = np.empty((len(moving), PARAMETERS))
    for k, row in enumerate(derivatives):
        total[:, k] = np.bincount(shape, weights=row, minlength=len(moving))
    total[:, 3:6] = _in_start_frames(moving, trial, total[:, 3:6])
    return total


def _in_start_frames(shapes: Shapes, trial: Shapes, slopes: Float64) -> Float64:
    """Slopes (n, 3) by the rotation vector w from the start, from those by a further small turn.

    R(w) = R0 exp(w): the transpose of the right Jacobian of SO(3), I + [w]/2 + [w]^2/6 within 1e-3 for turns
    up to `MAX_TURN` (Sola et al. 2018, eq. 143).
    """
    relative = np.einsum("nij,nik->njk", shapes.frames, trial.frames)
    vector = (
        np.stack([relative[:, b, c] - relative[:, c, b] for b, c in ((2, 1), (0, 2), (1, 0))], axis=1) / 2
    )
    sine = np.minimum(np.linalg.norm(vector, axis=1), 1.0)
    vector *= np.where(sine > 1e-9, np.arcsin(sine) / np.maximum(sine, 1e-9), 1.0)[:, None]
    once = np.cross(vector, slopes)
    return slopes + once / 2 + np.cross(vector, once) / 6


def _scales(shapes: Shapes, max_step: float) -> Float64:
    """Metres and radians of a unit of each parameter (n, 9): a turn moves a corner as a step moves a face."""
    scale = np.full((len(shapes), PARAMETERS), max_step)
    scale[:, 3:6] = np.minimum(max_step / np.linalg.norm(shapes.halves, axis=1), MAX_TURN)[:, None]
    return scale


def _bounds(shapes: Shapes, reach: float, max_step: float, scale: Float64) -> tuple[Float64, Float64]:
    lower, upper = -np.ones_like(scale), np.ones_like(scale)
    thinnest = np.minimum(THINNEST * reach, shapes.halves)
    lower[:, 6:9] = np.maximum(lower[:, 6:9], (thinnest - shapes.halves) / max_step)
    return lower, upper
