"""Shapes that lie in a solid around given points, by rays from there to the faces around."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from fit.primitives import Kind
from fit.sample import random_directions
from fit.scene import Float64
from fit.shapes import Shapes, join, make_shapes, no_shapes
from fit.solid import Solid

DIRECTIONS = 32
"""Rays from each point that find the faces around it."""

LATERAL = 0.3
"""Cosine under which a normal counts as square to another direction."""

SPREAD = 0.9
"""Of an extent found: how far out the next axis is probed, short of the faces."""

_LEAST_HITS = 6


def inscribe(solid: Solid, points: Float64) -> Shapes:
    """Up to eight shapes around each of the points (s, 3) inside: a sphere, a cylinder, and boxes grown in
    the six orders of the axes of the faces around."""
    if len(points) == 0:
        return no_shapes()
    directions = random_directions(DIRECTIONS, 0)
    count = len(points)
    distance, triangle = solid.rays.first_hit(
        np.repeat(points, DIRECTIONS, axis=0), np.tile(directions, (count, 1))
    )
    found = (triangle >= 0).reshape(count, DIRECTIONS)
    reach = np.where(np.isfinite(distance), distance, 0.0).reshape(count, DIRECTIONS)
    hits = points[:, None] + reach[:, :, None] * directions
    normals = solid.boundary.normals[triangle].reshape(count, DIRECTIONS, 3) * found[:, :, None]
    nearest = solid.boundary.normals[solid.tree.nearest(points)[1]]
    usable = np.flatnonzero(found.sum(axis=1) >= _LEAST_HITS)
    if len(usable) == 0:
        return no_shapes()
    points, hits, normals, reach, nearest = (a[usable] for a in (points, hits, normals, reach, nearest))
    hit = found[usable].astype(np.float64)
    return join(
        [
            *_boxes(solid, points, _frames(normals, reach, nearest)),
            _spheres(hits, normals, hit),
            _cylinders(solid, points, hits, normals, hit),
        ]
    )


def _frames(normals: Float64, reach: Float64, nearest: Float64) -> Float64:
    """World from local (s, 3, 3): the nearest face's normal, and the nearest normal square to it."""
    across = np.abs(np.einsum("sdk,sk->sd", normals, nearest))
    square = (across < LATERAL) & normals.any(axis=2)
    first = np.where(square, reach, np.inf).argmin(axis=1)
    second = normals[np.arange(len(normals)), first]
    other = np.eye(3)[np.abs(nearest).argmin(axis=1)]
    second = np.where(square.any(axis=1)[:, None], second, other)
    second = second - np.einsum("sk,sk->s", second, nearest)[:, None] * nearest
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    return np.stack([nearest, second, np.cross(nearest, second)], axis=2)


def _boxes(solid: Solid, points: Float64, frames: Float64) -> list[Shapes]:
    return [_box(solid, points, frames, order) for order in permutations(range(3))]


def _box(solid: Solid, points: Float64, frames: Float64, order: tuple[int, ...]) -> Shapes:
    """Boxes that extend axis by axis, until a face stops a ray from what they span so far."""
    lower, upper = np.zeros((len(points), 3)), np.zeros((len(points), 3))
    probes = np.zeros((len(points), 1, 3))  # in local coordinates about the points
    for axis in order:
        origins = points[:, None] + np.einsum("sij,spj->spi", frames, probes)
        for side, extent in ((1.0, upper), (-1.0, lower)):
            ahead = np.broadcast_to(side * frames[:, None, :, axis], origins.shape)
            distance, _ = solid.rays.first_hit(origins.reshape(-1, 3), ahead.reshape(-1, 3))
            distance[~np.isfinite(distance)] = 0.0
            extent[:, axis] = side * distance.reshape(len(points), -1).min(axis=1)
        steps = np.zeros((len(points), 3, 3))
        steps[:, 0, axis], steps[:, 2, axis] = SPREAD * lower[:, axis], SPREAD * upper[:, axis]
        probes = (probes[:, :, None] + steps[:, None]).reshape(len(points), -1, 3)
    centers = points + np.einsum("sij,sj->si", frames, (lower + upper) / 2)
    return make_shapes(Kind.BOX, centers, frames, (upper - lower) / 2)


def _spheres(hits: Float64, normals: Float64, found: Float64) -> Shapes:
    """Spheres about the points nearest to the normal lines of what is seen (least squares)."""
    across = (np.eye(3) - normals[..., :, None] * normals[..., None, :]) * found[..., None, None]
    matrix = across.sum(axis=1) + 1e-6 * np.eye(3)
    middle = _mean(hits, found)
    side = np.einsum("sdij,sdj->si", across, hits - middle[:, None])
    centers = middle + np.linalg.solve(matrix, side[:, :, None])[:, :, 0]
    radius = _median(np.linalg.norm(hits - centers[:, None], axis=2), found)
    return _sane(Kind.SPHERE, centers, np.eye(3), np.repeat(radius[:, None], 3, axis=1), hits)


def _cylinders(solid: Solid, points: Float64, hits: Float64, normals: Float64, found: Float64) -> Shapes:
    """Cylinders about the direction that the normals around are most nearly square to."""
    _, axes = np.linalg.eigh(np.einsum("sdi,sdj->sij", normals, normals))
    axis = axes[:, :, 0]
    frames = np.stack([axes[:, :, 1], axis, np.cross(axes[:, :, 1], axis)], axis=2)
    lateral = found * (np.abs(np.einsum("sdk,sk->sd", normals, axis)) < LATERAL)
    usable = lateral.sum(axis=1) >= 3
    flat = np.einsum("sdk,ski->sdi", normals, frames)[:, :, [0, 2]]
    flat /= np.maximum(np.linalg.norm(flat, axis=2, keepdims=True), 1e-12)
    place = np.einsum("sdk,ski->sdi", hits - points[:, None], frames)[:, :, [0, 2]]
    across = (np.eye(2) - flat[..., :, None] * flat[..., None, :]) * lateral[..., None, None]
    side = np.einsum("sdij,sdj->si", across, place)
    middle = np.linalg.solve(across.sum(axis=1) + 1e-6 * np.eye(2), side[:, :, None])[:, :, 0]
    radius = _median(np.linalg.norm(place - middle[:, None], axis=2), lateral)
    up, _ = solid.rays.first_hit(points, axis)
    down, _ = solid.rays.first_hit(points, -axis)
    up, down = (np.where(np.isfinite(d), d, 0.0) for d in (up, down))
    local = np.stack([middle[:, 0], (up - down) / 2, middle[:, 1]], axis=1)
    centers = points + np.einsum("sij,sj->si", frames, local)
    halves = np.stack([radius, (up + down) / 2, radius], axis=1)
    return _sane(Kind.CYLINDER, centers[usable], frames[usable], halves[usable], hits[usable])


def _mean(values: Float64, weights: Float64) -> Float64:
    return np.einsum("sdk,sd->sk", values, weights) / np.maximum(weights.sum(axis=1), 1)[:, None]


def _median(values: Float64, chosen: Float64) -> Float64:
    """Median (s,) of the chosen values (s, d) of each row."""
    ordered = np.sort(np.where(chosen > 0, values, np.inf), axis=1)
    middle = np.maximum(chosen.sum(axis=1).astype(np.int64) - 1, 0) // 2
    return ordered[np.arange(len(values)), middle]


def _sane(kind: Kind, centers: Float64, frames: Float64, halves: Float64, hits: Float64) -> Shapes:
    """Those no larger than what is seen from their point."""
    size = np.linalg.norm(hits.max(axis=1) - hits.min(axis=1), axis=1)
    good = np.isfinite(halves).all(axis=1) & (halves.max(axis=1) < size) & (halves.min(axis=1) > 0)
    frames = np.broadcast_to(frames, (len(centers), 3, 3))
    return make_shapes(kind, centers[good], frames[good], halves[good])
