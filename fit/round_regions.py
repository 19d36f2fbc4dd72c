"""Spheres and cylinders along a region that bulges toward the air, in closed form.

Both minimise the mean square of x - c - r n over samples x with normals n: the centre c is where the normal
lines meet, the radius r the slope of position by normal. A cylinder is the same across its axis, the
direction that the normals have least of.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fit.partition import Samples
from fit.primitives import Kind
from fit.scene import Float64
from fit.shapes import Shapes, join, make_shapes, no_shapes, right_handed
from fit.spaces import Air

LEAST_TURN = 0.1
"""Variance of the normals from which a region can be round: a cap of 25 degrees about its mean direction."""

MOST_OFF = 0.25
"""Of the radius: root mean square of the samples' distance from the round surface; a hexagon's is 0.04."""

ENDS = (0.02, 0.98)
"""Quantiles of the samples along a cylinder's axis between which it stands."""


def round_shapes(samples: Samples, members: NDArray[np.int64], air: Air) -> Shapes:
    """The sphere and the cylinder of a region (rows of its samples), each where there is one."""
    points, normals = samples.points[members], samples.normals[members]
    weights = samples.weights[members] / samples.weights[members].sum()
    return join([_sphere(points, normals, weights, air), _cylinder(points, normals, weights, air)])


def _sphere(points: Float64, normals: Float64, weights: Float64, air: Air) -> Shapes:
    fitted = _fit(points, normals, weights)
    if fitted is None:
        return no_shapes()
    center, radius = fitted
    return _placed(Kind.SPHERE, center, np.eye(3), np.full(3, radius), air)


def _cylinder(points: Float64, normals: Float64, weights: Float64, air: Air) -> Shapes:
    axis = np.linalg.eigh(np.einsum("p,pi,pj->ij", weights, normals, normals))[1][:, 0]
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    frame = right_handed(np.stack([helper - axis * (helper @ axis), axis], axis=1))
    local, across = points @ frame, [0, 2]
    fitted = _fit(local[:, across], (normals @ frame)[:, across], weights)
    low, high = np.quantile(local[:, 1], ENDS)
    if fitted is None or not high > low:
        return no_shapes()
    (x, z), radius = fitted
    halves = np.array([radius, (high - low) / 2, radius])
    return _placed(Kind.CYLINDER, frame @ np.array([x, (low + high) / 2, z]), frame, halves, air)


def _fit(points: Float64, normals: Float64, weights: Float64) -> tuple[Float64, float] | None:
    """Centre (k,) and radius of the sphere (k = 3) or circle (k = 2); None where the region is not round."""
    mean_point, mean_normal = weights @ points, weights @ normals
    turn = float(weights @ ((normals - mean_normal) ** 2).sum(axis=1))
    if turn < LEAST_TURN:
        return None
    slope = float(weights @ ((points - mean_point) * (normals - mean_normal)).sum(axis=1)) / turn
    center = mean_point - slope * mean_normal
    reach = np.linalg.norm(points - center, axis=1)
    radius = float(weights @ reach)
    off = float(np.sqrt(weights @ (reach - radius) ** 2))
    return (center, radius) if slope > 0 and off <= MOST_OFF * radius else None


def _placed(kind: Kind, center: Float64, frame: Float64, halves: Float64, air: Air) -> Shapes:
    return make_shapes(kind, (air.origin + air.cell * center)[None], frame, air.cell * halves)
