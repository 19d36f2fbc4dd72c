"""What a set is fitted to: distances that are known, at surfaces (zero) and in the free air (to the surface).

One residual serves every step of the method, from the choice of candidates to the joint refinement:

    E(S) = sum_i w_i rho(min(d_S(x_i), cap_i) - D_i)
    rho(r) = sqrt(r^2 + soft^2) - soft, times `STICKS_OUT` for r < 0

Where neither surface nor free air is, nothing is asked for: a wall seen from one side may be as thick as it
likes, and a solid may be one box however hollow it was modelled.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from fit.scene import Float64
from fit.shapes import Shapes, distances_to_one

STICKS_OUT = 1.3
"""Error of a set nearer than the surface (it darkens the air) against one that is farther (it leaks)."""


@dataclass(frozen=True)
class Targets:
    """p points (p, 3) whose distance to the surface is known: distances (p,), weights (p,) that sum to 1 over
    the surface and to 1 over the air; normals (p, 3) toward the air, zero in the air itself;
    sample (p,) row of the surface samples that a point is, -1 in the air;
    caps (p,): farther distances count as this one, at most `reach`; soft: errors far below count as none."""

    points: Float64
    distances: Float64
    weights: Float64
    normals: Float64
    sample: NDArray[np.int64]
    caps: Float64
    reach: float
    soft: float

    def __len__(self) -> int:
        return len(self.points)

    @property
    def is_surface(self) -> NDArray[np.bool_]:
        return self.sample >= 0

    def select(self, index: NDArray[np.generic]) -> Targets:
        rows = {f.name: getattr(self, f.name)[index] for f in fields(self) if f.name not in ("reach", "soft")}
        return Targets(**rows, reach=self.reach, soft=self.soft)


def penalties(
    targets: Targets, distances: Float64, rows: NDArray[np.integer] | slice = slice(None)
) -> Float64:
    """Weighted error (k,) of the targets `rows` when the set is at these signed distances (k,)."""
    residual = np.clip(distances, -targets.reach, targets.caps[rows]) - targets.distances[rows]
    error = np.sqrt(residual * residual + targets.soft**2) - targets.soft
    return targets.weights[rows] * error * np.where(residual < 0, STICKS_OUT, 1.0)


def penalty_slopes(targets: Targets, distances: Float64) -> Float64:
    """Derivative (p,) of `penalties` by the distance."""
    residual = np.minimum(distances, targets.caps) - targets.distances
    slope = residual / np.sqrt(residual * residual + targets.soft**2)
    slope[(distances >= targets.caps) | (distances <= -targets.reach)] = 0.0
    return targets.weights * slope * np.where(residual < 0, STICKS_OUT, 1.0)


def set_distances(shapes: Shapes, targets: Targets) -> Float64:
    """Signed distance (p,) from the targets to the union, no more than `reach`."""
    points, distances = targets.points, np.full(len(targets), targets.reach)
    for i in range(len(shapes)):
        np.minimum(distances, distances_to_one(shapes, i, points), out=distances)
    return distances


def error(shapes: Shapes, targets: Targets) -> float:
    """E(S)."""
    return float(penalties(targets, set_distances(shapes, targets)).sum())
