"""Joint refinement of a set: nlopt's L-BFGS on the distance error, every parameter at once."""

from __future__ import annotations

import nlopt
import numpy as np
from numpy.typing import NDArray

from fit.objective import Targets, error, penalties, penalty_slopes
from fit.scene import Float64
from fit.shapes import PARAMETERS, Shapes, distances_to_one, moved, pair_derivatives

NEAREST = 4
"""Shapes that may become a target's nearest one while the optimiser moves them."""

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
    point, shape = _pairs_within_reach(shapes, targets)
    if len(point) == 0:
        return shapes
    starts = np.flatnonzero(np.diff(point, prepend=-1))
    rows = point[starts]
    members, row_of_pair = targets.select(rows), np.cumsum(np.diff(point, prepend=-1) > 0) - 1
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
        distances, derivatives = pair_derivatives(trial, pair_points, shape)
        nearest = np.minimum.reduceat(distances, starts)
        value = float(penalties(members, nearest).sum())
        if np.isfinite(value) and value < best_value:
            best_x, best_value = x.copy(), value
        if gradient.size:
            chosen = distances <= nearest[row_of_pair]
            slope = penalty_slopes(members, nearest)[row_of_pair[chosen]]
            local = slope[:, None] * _in_current_frame(shapes, trial, derivatives[chosen], shape[chosen])
            total = np.empty((len(shapes), PARAMETERS))
            for k in range(PARAMETERS):
                total[:, k] = np.bincount(shape[chosen], weights=local[:, k], minlength=len(shapes))
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


def _pairs_within_reach(shapes: Shapes, targets: Targets) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For each target its `NEAREST` shapes within twice the reach: rows of targets, sorted, and shapes."""
    kept = min(NEAREST, len(shapes))
    distances = np.full((len(targets), kept), np.inf)
    nearest = np.zeros((len(targets), kept), np.int64)
    for i in range(len(shapes)):
        d = distances_to_one(shapes, i, targets.points)
        which = np.full(len(targets), i)
        for k in range(kept):  # one step of insertion sort, for all targets at once
            closer = d < distances[:, k]
            d, distances[:, k] = np.where(closer, distances[:, k], d), np.where(closer, d, distances[:, k])
            which, nearest[:, k] = (
                np.where(closer, nearest[:, k], which),
                np.where(closer, which, nearest[:, k]),
            )
    point, column = np.nonzero(distances < 2 * targets.reach)
    return point, nearest[point, column]


def _in_current_frame(
    shapes: Shapes, trial: Shapes, derivatives: Float64, index: NDArray[np.integer]
) -> Float64:
    """Derivatives by the rotation vector from the start, from those by a further small turn.

    R(w) = R0 exp(w): for turns up to `MAX_TURN` the right Jacobian of SO(3) is I - [w]/2 + [w]^2/6 within 1e-3.
    """
    relative = np.einsum("nij,nik->njk", shapes.frames, trial.frames)
    vector = np.stack(
        [
            relative[:, 2, 1] - relative[:, 1, 2],
            relative[:, 0, 2] - relative[:, 2, 0],
            relative[:, 1, 0] - relative[:, 0, 1],
        ],
        axis=1,
    )
    sine = np.linalg.norm(vector, axis=1) / 2
    vector *= (np.where(sine > 1e-9, np.arcsin(np.minimum(sine, 1.0)) / np.maximum(sine, 1e-9), 1.0) / 2)[
        :, None
    ]
    w, turn = vector[index], derivatives[:, 3:6]
    once = np.cross(w, turn)  # the transpose of -[w] acting on the gradient
    result = derivatives.copy()
    result[:, 3:6] = turn + once / 2 + np.cross(w, once) / 6
    return result


def _scales(shapes: Shapes, max_step: float) -> Float64:
    """Metres and radians of one unit of each parameter (n, 9): a turn moves the far end as a step moves a face."""
    scale = np.full((len(shapes), PARAMETERS), max_step)
    scale[:, 3:6] = np.minimum(max_step / np.linalg.norm(shapes.halves, axis=1), MAX_TURN)[:, None]
    return scale


def _bounds(shapes: Shapes, reach: float, max_step: float, scale: Float64) -> tuple[Float64, Float64]:
    lower, upper = -np.ones_like(scale), np.ones_like(scale)
    thinnest = np.minimum(THINNEST * reach, shapes.halves)
    lower[:, 6:9] = np.maximum(lower[:, 6:9], (thinnest - shapes.halves) / max_step)
    return lower, upper
