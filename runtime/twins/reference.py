"""The truth that the techniques are measured against: a path tracer through the primitives, NumPy, float64.

Rays meet primitives by solving equations, not by marching, and nothing is shared with the GPU but the
primitive set. Units and conventions are the product's: irradiance in W/m2, radiance in W/m2/sr, Lambertian
surfaces.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fit import sdf
from fit.primitives import Kind, PrimitiveSet

Float64 = NDArray[np.float64]
Index = NDArray[np.intp]
Radiance = Callable[[Float64], Float64]

START = 1e-6
"""Metres by which a ray leaves the surface it starts from."""


@dataclass(frozen=True)
class SunLight:
    """Parallel light: unit direction (3,) towards it, irradiance (3,) on a surface facing it."""

    direction: tuple[float, float, float]
    irradiance: tuple[float, float, float]


def black_sky(directions: Float64) -> Float64:
    """No light from anywhere."""
    return np.zeros((len(directions), 3))


def intersect(
    primitives: PrimitiveSet, origins: Float64, directions: Float64, reach: ArrayLike = np.inf
) -> tuple[Float64, Index]:
    """Distance (n,) to the first primitive that rays (n, 3), (n, 3) enter within `reach`, and its index (n,),
    else -1.

    A ray that starts inside a primitive meets that one at 0.
    """
    nearest = np.broadcast_to(np.asarray(reach, np.float64), len(origins)).copy()
    index = np.full(len(origins), -1, np.intp)
    turns = primitives.rotation_matrices()
    for i, kind in enumerate(primitives.kinds):
        o = (origins - primitives.positions[i]) @ turns[i]
        d = directions @ turns[i]
        if primitives.is_half_space[i]:
            enter, leave = _slab(o[:, 1], d[:, 1], -np.inf, 0.0)
        elif kind == Kind.SPHERE:
            enter, leave = _round(o, d, primitives.sizes[i, 0] / 2)
        else:
            half = primitives.sizes[i] / 2
            if kind == Kind.CYLINDER:
                flat = np.array([1.0, 0.0, 1.0])
                enter, leave = _round(o * flat, d * flat, half[0])
                axes: tuple[int, ...] = (1,)
            else:
                enter, leave = np.full(len(o), -np.inf), np.full(len(o), np.inf)
                axes = (0, 1, 2)
            for axis in axes:
                a, b = _slab(o[:, axis], d[:, axis], -half[axis], half[axis])
                enter, leave = np.maximum(enter, a), np.minimum(leave, b)
        t = np.maximum(enter, 0.0)
        closer = (enter <= leave) & (leave > 0) & (t < nearest)
        nearest[closer], index[closer] = t[closer], i
    return nearest, index


def _slab(o: Float64, d: Float64, low: float, high: float) -> tuple[Float64, Float64]:
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - o) / d, (high - o) / d
    parallel = d == 0
    inside = (o >= low) & (o <= high)
    a = np.where(parallel, np.where(inside, -np.inf, np.inf), a)
    b = np.where(parallel, np.where(inside, np.inf, -np.inf), b)
    return np.minimum(a, b), np.maximum(a, b) if not parallel.any() else np.where(
        parallel, b, np.maximum(a, b)
    )


def _round(o: Float64, d: Float64, radius: float) -> tuple[Float64, Float64]:
    """Where rays pass through |p| <= radius; an infinite cylinder is that without its axis' coordinate."""
    a = np.einsum("ni,ni->n", d, d)
    b = np.einsum("ni,ni->n", o, d)
    c = np.einsum("ni,ni->n", o, o) - radius**2
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    moving = a > 1e-24
    safe = np.where(moving, a, 1.0)
    never = np.where(moving, b * b < a * c, c > 0)
    enter = np.where(moving, (-b - root) / safe, -np.inf)
    leave = np.where(moving, (-b + root) / safe, np.inf)
    return np.where(never, np.inf, enter), np.where(never, -np.inf, leave)


def cosine_directions(normals: Float64, u: Float64) -> Float64:
    """Directions (n, 3), cosine-distributed about unit normals (n, 3), from uniform numbers (n, 2)."""
    r, angle = np.sqrt(u[:, 0]), 2 * np.pi * u[:, 1]
    helper = np.where(np.abs(normals[:, :1]) > 0.5, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    x = np.cross(helper, normals)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(normals, x)
    z = np.sqrt(1 - u[:, :1])
    return (r * np.cos(angle))[:, None] * x + (r * np.sin(angle))[:, None] * y + z * normals


def indirect_irradiance(
    primitives: PrimitiveSet,
    points: Float64,
    normals: Float64,
    *,
    sky: Radiance = black_sky,
    suns: tuple[SunLight, ...] = (),
    samples: int = 64,
    bounces: int = 64,
    seed: int = 0,
) -> Float64:
    """Indirect E (n, 3) at points (n, 3) with normals (n, 3): sky, emission and every bounce; direct sun left
    out.

    `samples` paths a point, at most `bounces` long, ended by Russian roulette. The noise falls as
    1/sqrt(samples).
    """
    rng = np.random.default_rng(seed)
    total = np.zeros((len(points), 3))
    for _ in range(samples):
        total += _trace_paths(primitives, points, normals, sky, suns, bounces, rng)
    return total / samples


def direct_irradiance(
    primitives: PrimitiveSet, points: Float64, normals: Float64, suns: tuple[SunLight, ...]
) -> Float64:
    """Direct E (n, 3) of the suns at points (n, 3) with normals (n, 3), sharp shadows."""
    total = np.zeros((len(points), 3))
    starts = points + START * normals
    for sun in suns:
        direction = np.asarray(sun.direction) / np.linalg.norm(sun.direction)
        cosine = np.maximum(normals @ direction, 0.0)
        lit = np.flatnonzero(cosine > 0)
        blocked = intersect(primitives, starts[lit], np.broadcast_to(direction, (len(lit), 3)))[1] >= 0
        lit = lit[~blocked]
        total[lit] += cosine[lit, None] * np.asarray(sun.irradiance)
    return total


def _trace_paths(
    primitives: PrimitiveSet,
    points: Float64,
    normals: Float64,
    sky: Radiance,
    suns: tuple[SunLight, ...],
    bounces: int,
    rng: np.random.Generator,
) -> Float64:
    irradiance = np.zeros((len(points), 3))
    path = np.arange(len(points))
    weight = np.full((len(points), 3), np.pi)
    position, normal = points, normals
    for bounce in range(bounces):
        direction = cosine_directions(normal, rng.random((len(path), 2)))
        t, index = intersect(primitives, position + START * normal, direction)
        missed = index < 0
        irradiance[path[missed]] += weight[missed] * sky(direction[missed])
        path, weight, index = path[~missed], weight[~missed], index[~missed]
        position = (position + START * normal)[~missed] + t[~missed, None] * direction[~missed]
        if not len(path):
            break
        normal = sdf.gradient(primitives, position, index)
        face = sdf.primitive_face(primitives, position, index)
        albedo = primitives.albedo[index, face].astype(np.float64)
        light = primitives.emission[index, face] + albedo / np.pi * direct_irradiance(
            primitives, position, normal, suns
        )
        irradiance[path] += weight * light
        weight = weight * albedo
        survival = np.clip(weight.max(axis=1) / np.pi, 0.0, 1.0) if bounce >= 2 else np.ones(len(path))
        alive = rng.random(len(path)) < survival
        weight = weight[alive] / survival[alive, None]
        path, position, normal = path[alive], position[alive], normal[alive]
    return irradiance
