"""The colour of what shuts an opening: as dark as the opening looks.

A few primitives can't leave every arch, window and gap between curtains open. A face that shuts one in the
colour of the wall around it sends back the light that would have gone in, and the bright side gets too
bright. So the part of a face behind which there is no surface reflects what comes out of the opening
instead: the radiance of what lies behind over the light that arrives, both under an even sky. That is at
most the albedo of the wall: what comes from brighter places is light, no colour can stand for it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fit.light import EvenLight, cosine_directions
from fit.primitives import PrimitiveSet
from fit.scene import Float64
from fit.sdf import boundary_area, primitive_face, sample_boundary, union_distance
from fit.spaces import Air
from fit.targets import LEAK_SHARE

POINTS, RAYS = 16_000, 8
"""On the set, by area, and through each of those that air touches."""

OUT_CELLS = 0.5
"""Before its face: where a ray inwards starts, so that a surface that stands a little proud stops it."""

LEAST_COSINE = 0.3
"""Of a ray to its face's normal: rays that graze it start far away."""

LEAST_POINTS = 8
"""On a face, below which its colour stays as it is."""


def reflected_shares(primitives: PrimitiveSet, light: EvenLight, *, seed: int = 0) -> Float64:
    """What is left (n, 6, 1) of the albedo of each face that shuts an opening, 1 for all others.

    Where faces have one colour together, that of the first of them counts.
    """
    shares = np.ones((len(primitives), 6, 1))
    finite = np.flatnonzero(~primitives.is_half_space)
    chosen = primitives.select(finite)
    if light.radiance.any() and boundary_area(chosen).sum() > 0:
        shares[finite] = _reflected_shares(chosen, light, seed).reshape(-1, 6, 1)
    return shares


def _reflected_shares(primitives: PrimitiveSet, light: EvenLight, seed: int) -> Float64:
    """The same (6 n,) of finite primitives: 1 - open share + what comes from the openings over the albedo."""
    points, normals, face = _exposed_points(primitives, light.air, seed)
    passing, found = _through(points, normals, light, seed)
    count = 6 * len(primitives)
    area = np.bincount(face, minlength=count)
    open_area = np.bincount(face, passing, count)
    behind = np.flatnonzero((open_area[face] > 0) & (area[face] >= LEAST_POINTS))
    before = points[behind] + OUT_CELLS * light.air.cell * normals[behind]
    arriving = np.bincount(face[behind], _arriving(before, normals[behind], light, seed + 1), count)
    own = primitives.albedo.mean(axis=2).ravel()
    black = arriving * own <= 0
    reflected = np.bincount(face, found, count) * area / np.where(black, 1.0, arriving * own)
    left = 1 - (open_area - np.minimum(reflected, open_area)) / np.maximum(area, 1)
    return np.asarray(np.where(black, 1.0, left))


def _exposed_points(
    primitives: PrimitiveSet, air: Air, seed: int
) -> tuple[Float64, Float64, NDArray[np.int64]]:
    """Points (q, 3) on the set, uniform by area, that air touches, their normals (q, 3), and the row (q,) of
    the face that each lies on among six a primitive."""
    points, normals, index = sample_boundary(primitives, POINTS, seed)
    exposed = union_distance(primitives, points)[0] > -1e-9 * air.walls.diagonal
    exposed[exposed] = air.is_air(points[exposed] + OUT_CELLS * air.cell * normals[exposed])
    points, normals, index = points[exposed], normals[exposed], index[exposed]
    return points, normals, 6 * index + primitive_face(primitives, points, index)


def _through(points: Float64, normals: Float64, light: EvenLight, seed: int) -> tuple[Float64, Float64]:
    """Share (q,) of the rays through points of faces that find no surface behind them, and the radiance (q,)
    that these find, as a mean over all.

    They find none when they go on behind the face for as long as one that leaks.
    """
    points, normals = np.repeat(points, RAYS, axis=0), np.repeat(normals, RAYS, axis=0)
    inwards = cosine_directions(-normals, seed)
    cosine = -np.einsum("pk,pk->p", inwards, normals)
    counts = cosine > LEAST_COSINE
    back = OUT_CELLS * light.air.cell / np.maximum(cosine, LEAST_COSINE)
    ends, met = light.first_met(points - back[:, None] * inwards, inwards)
    passes = counts & (ends > back + LEAK_SHARE * light.air.walls.diagonal)
    found = np.where(passes, light.of_samples(met), 0.0)
    all_rays = np.maximum(counts.reshape(-1, RAYS).sum(axis=1), 1)
    return passes.reshape(-1, RAYS).sum(axis=1) / all_rays, found.reshape(-1, RAYS).sum(axis=1) / all_rays


def _arriving(points: Float64, normals: Float64, light: EvenLight, seed: int) -> Float64:
    """Mean radiance (q,) over the cosine-weighted hemispheres before faces."""
    outwards = cosine_directions(np.repeat(normals, RAYS, axis=0), seed)
    met = light.first_met(np.repeat(points, RAYS, axis=0), outwards)[1]
    return light.of_samples(met).reshape(-1, RAYS).mean(axis=1)
