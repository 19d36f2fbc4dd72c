"""Levenberg-Marquardt on the volume of difference: one 9 x 9 system a shape.

The union's distance at a point is its nearest shape's, so each point pulls at one shape only and the normal
equations of all shapes together fall apart into small ones. That makes a step of all shapes as cheap as a
gradient, and twenty steps do what hundreds of a quasi-Newton method did. The absolute error is met by weights
1 / |residual| (iteratively reweighted least squares).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.occupancy import Occupancy, difference, distance_table, nearest
from fit.scene import Float64
from fit.shapes import PARAMETERS, Shapes, distances_to_one, moved, pair_derivatives, pair_distances

DAMPING, EASE, BRAKE = 1e-2, 0.25, 6.0
"""Of the mean diagonal: at the start; its factors after a step that helped and after one that did not."""

LEAST_DAMPING, MOST_DAMPING = 1e-4, 1e3

SHARPEST = 0.1
"""Of the band: smaller residuals weigh as this one."""

SAVING = 5e-4
"""Share of the difference that a step must save, or it is the last."""

THINNEST = 0.05
"""Of the band: no half extent gets smaller."""

POINTS_PER_CANDIDATE = 1000
"""That a candidate is fitted alone to, of those around it, evenly thinned."""

AROUND = 0.6
"""Of a candidate's largest half extent: how far around it its points lie."""


def descend_together(
    shapes: Shapes, occupancy: Occupancy, steps: int, free: NDArray[np.bool_] | None = None
) -> Shapes:
    """The set after at most `steps` of all its `free` shapes (n,); its difference is never above the given.

    A step moves no coordinate of a centre and no half extent farther than the band is wide, nor turns a
    corner farther about any axis: all together, a face may move a few bands.
    """
    band, free = occupancy.band, ~shapes.exact if free is None else free
    if not free.any():
        return shapes
    table = distance_table(shapes, occupancy, bands=3.0)
    near = occupancy.select(np.flatnonzero(np.abs(table.min(axis=0)) < 3 * band))
    given, owner, distances = shapes, *nearest(shapes, near)
    lowest = near.differences(distances).sum()
    damping = DAMPING
    for _ in range(steps):
        step = _step(shapes, near, owner, distances, np.full(len(shapes), damping), free)
        trial = _thickened(moved(shapes, step), band)
        trial_owner, trial_distances = nearest(trial, near)
        reached = near.differences(trial_distances).sum()
        if not reached < lowest:
            damping *= BRAKE
            if damping > MOST_DAMPING:
                break
            continue
        saved = (lowest - reached) / lowest
        shapes, owner, distances, lowest = trial, trial_owner, trial_distances, reached
        damping = max(damping * EASE, LEAST_DAMPING)
        if saved < SAVING:
            break
    return shapes if difference(shapes, occupancy) < difference(given, occupancy) else given


def descend_alone(
    candidates: Shapes, backgrounds: Sequence[Float64], occupancy: Occupancy, steps: int
) -> tuple[Shapes, Float64]:
    """Each candidate fitted by itself into the rest of a set, and what it then takes off the difference (n,).

    backgrounds: of each candidate, the distance (p,) of the rest.
    """
    count, band = len(candidates), occupancy.band
    rows, owners, scale = [], [], np.ones(count)
    for i in range(count):
        around = max(AROUND * float(candidates.halves[i].max()), 2 * band)
        distances = distances_to_one(candidates, i, occupancy.points)
        found = np.flatnonzero((distances < around) & (backgrounds[i] > -band))
        scale[i] = max(1, -(-len(found) // POINTS_PER_CANDIDATE))
        rows.append(found[:: int(scale[i])])
        owners.append(np.full(len(rows[-1]), i))
    row, owner = (
        np.concatenate([*rows, np.zeros(0, np.int64)]),
        np.concatenate([*owners, np.zeros(0, np.int64)]),
    )
    if len(row) == 0:
        return candidates, np.zeros(count)
    rest = np.concatenate([backgrounds[i][rows[i]] for i in range(count)])
    near = occupancy.select(row)
    near = replace(near, volumes=near.volumes * scale[owner])

    def measured(trial: Shapes) -> tuple[Float64, Float64]:
        distances = pair_distances(trial, near.points, owner)
        own = near.differences(np.minimum(distances, rest))
        return np.where(distances < rest, distances, np.inf), np.bincount(owner, own, count).astype(
            np.float64
        )

    without = np.bincount(owner, near.differences(rest), count)
    distances, lowest = measured(candidates)
    damping, alive = np.full(count, DAMPING), np.ones(count, bool)
    for _ in range(steps):
        step = _step(candidates, near, owner, distances, damping, alive)
        trial = _thickened(moved(candidates, step), band)
        trial_distances, reached = measured(trial)
        better = reached < lowest
        alive &= np.where(better, lowest - reached > SAVING * lowest, damping < MOST_DAMPING)
        candidates = _where(better, trial, candidates)
        distances = np.where(better[owner], trial_distances, distances)
        lowest = np.where(better, reached, lowest)
        damping = np.where(better, np.maximum(damping * EASE, LEAST_DAMPING), damping * BRAKE)
        if not alive.any():
            break
    return candidates, without - lowest


def _step(
    shapes: Shapes,
    occupancy: Occupancy,
    owner: NDArray[np.int64],
    distances: Float64,
    damping: Float64,
    free: NDArray[np.bool_],
) -> Float64:
    """One damped step (n, 9) of all shapes. Points at infinite `distances` (p,) pull at none."""
    band, count = occupancy.band, len(shapes)
    scale = np.ones((count, PARAMETERS))
    scale[:, 3:6] = 1 / np.linalg.norm(shapes.halves, axis=1)[:, None]
    residual = distances - occupancy.known
    pulls = np.flatnonzero((np.abs(distances) < band) & (residual != 0) & free[owner])
    residual, owner = residual[pulls], owner[pulls]
    weights = occupancy.volumes[pulls] / np.maximum(np.abs(residual), SHARPEST * band)
    slopes = pair_derivatives(shapes, occupancy.points[pulls], owner) * scale[owner].T
    matrix, vector = np.empty((count, PARAMETERS, PARAMETERS)), np.empty((count, PARAMETERS))
    for i in range(PARAMETERS):
        weighted = weights * slopes[i]
        vector[:, i] = np.bincount(owner, weighted * residual, count)
        for j in range(i, PARAMETERS):
            matrix[:, i, j] = matrix[:, j, i] = np.bincount(owner, weighted * slopes[j], count)
    trace = np.trace(matrix, axis1=1, axis2=2) / PARAMETERS
    damped = np.maximum(damping * trace, np.finfo(float).tiny)
    step = -np.linalg.solve(matrix + damped[:, None, None] * np.eye(PARAMETERS), vector[:, :, None])[:, :, 0]
    largest = np.maximum(np.abs(step).max(axis=1), np.finfo(float).tiny)
    return step * np.minimum(1.0, band / largest)[:, None] * scale


def _thickened(shapes: Shapes, band: float) -> Shapes:
    return replace(shapes, halves=np.maximum(shapes.halves, THINNEST * band))


def _where(choice: NDArray[np.bool_], one: Shapes, other: Shapes) -> Shapes:
    """Shapes of one set where chosen (n,), else the other's in the same row."""
    return replace(
        other,
        centers=np.where(choice[:, None], one.centers, other.centers),
        frames=np.where(choice[:, None, None], one.frames, other.frames),
        halves=np.where(choice[:, None], one.halves, other.halves),
    )
