"""Joint refinement of a set: nlopt's L-BFGS on the distance error, every parameter at once."""

from __future__ import annotations

import nlopt
import numpy as np
from numpy.typing import NDArray

from fit.objective import Targets, error, penalties, penalty_slopes
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
) -> Shapes:
    """The set after L-BFGS (Nocedal 1980, as in nlopt) has moved, turned and resized its shapes.

    max_step: metres that a centre or a face may move in one pass; free (n,) bool: the shapes that may change
    (default: all that are not exact). The returned set's error is never above the given one's.
    """
    free = ~shapes.exact if free is None else free
    best, lowest = shapes, error(shapes, targets)
    for _ in range(passes):
        if not free.any():
            break
        candidate = _descend(best, targets, free, max_step, evaluations)
        reached = error(candidate, targets)
        if not reached < lowest:
            break
        paid = lowest - reached > 1e-3 * lowest
        best, lowest = candidate, reached
        if not paid:
            break
    return best


def _descend(
    shapes: Shapes, targets: Targets, free: NDArray[np.bool_], max_step: float, evaluations: int
) -> Shapes:
    targets = _thinned(targets, max(LEAST_TARGETS, TARGETS_PER_SHAPE * int(free.sum())))
    point, shape = _pairs_that_matter(shapes, targets, max_step)
    if len(point) == 0:
        return shapes
    starts = np.flatnonzero(np.diff(point, prepend=-1))
    members = targets.select(point[starts])
    first_of_run = np.zeros(len(point), np.int64)
    first_of_run[starts[1:]] = 1
    run = np.cumsum(first_of_run)
    pair_points = targets.points[point]
    scale = _scales(shapes, max_step)
    moving = np.flatnonzero(free)
    best_x, best_value = np.zeros(len(moving) * PARAMETERS), np.inf

    def steps(x: Float64) -> Float64:
        full = np.zeros((len(shapes), PARAMETERS))
        full[moving] = x.reshape(-1, PARAMETERS) * scale[moving]
        return full

    def objective(x: Float64, gradient: Float64) -> float:
        nonlocal best_x, best_value
        trial = moved(shapes, steps(x))
        distances = pair_distances(trial, pair_points, shape)
        nearest = np.minimum.reduceat(distances, starts)
        value = float(penalties(members, nearest).sum())
        if np.isfinite(value) and value < best_value:
            best_x, best_value = x.copy(), value
        if gradient.size:
            slope = penalty_slopes(members, nearest)[run]
            carriers = np.flatnonzero((distances <= nearest[run]) & (slope != 0))
            derivatives = pair_derivatives(trial, pair_points[carriers], shape[carriers]) * slope[carriers]
            total = np.stack(
                [np.bincount(shape[carriers], weights=row, minlength=len(shapes)) for row in derivatives],
                axis=1,
                dtype=np.float64,
            )
            total[:, 3:6] = _in_start_frames(shapes, trial, total[:, 3:6])
            gradient[:] = (total * scale)[moving].ravel()
        return value

    optimizer = nlopt.opt(nlopt.LD_LBFGS, len(best_x))
    optimizer.set_exceptions_enabled(False)
    optimizer.set_min_objective(objective)
    lower, upper = _bounds(shapes, targets.reach, max_step, scale)
    optimizer.set_lower_bounds(lower[moving].ravel())
    optimizer.set_upper_bounds(upper[moving].ravel())
    optimizer.set_maxeval(evaluations)
    optimizer.set_ftol_rel(1e-5)
    start = np.clip(best_x, lower[moving].ravel(), upper[moving].ravel())
    optimizer.optimize(start)
    return moved(shapes, steps(best_x))


def _thinned(targets: Targets, most: int) -> Targets:
    """At most about `most` targets, evenly out of the given order: a few shapes need no more."""
    return targets.select(np.arange(0, len(targets), max(1, -(-len(targets) // most))))


def _pairs_that_matter(
    shapes: Shapes, targets: Targets, max_step: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows of targets, sorted, and shapes that may become their nearest within reach as they move."""
    kept = min(NEAREST, len(shapes))
    distances = np.full((kept, len(targets)), np.inf)
    nearest = np.zeros((kept, len(targets)), np.int64)
    for i in range(len(shapes)):
        d = distances_to_one(shapes, i, targets.points)
        which = np.full(len(targets), i)
        for k in range(kept):  # one step of insertion sort, for all targets at once
            closer = d < distances[k]
            d, distances[k] = np.where(closer, distances[k], d), np.where(closer, d, distances[k])
            which, nearest[k] = np.where(closer, nearest[k], which), np.where(closer, which, nearest[k])
    limit = np.minimum(distances[0] + 2 * MOST_STEPS * max_step, targets.reach + MOST_STEPS * max_step)
    point, column = np.nonzero((distances <= limit).T)
    return point, nearest[column, point]


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
