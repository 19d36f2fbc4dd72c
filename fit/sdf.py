"""Exact Euclidean signed distances of the primitives, their gradients and their boundaries.

Negative inside, and exact there too. The `sd_` functions work in a primitive's local space, keep the type of
their points (float32 stays float32), and are twins of runtime/shaders/lib/sdf.wgsl: same names, same order of
arguments. The formulas are the classic ones (Hart 1996, "Sphere tracing"; Quilez, "Distance functions").

Where two faces are equally near, the gradient takes one of them, always the same: the first axis of a box,
the side of a cylinder rather than its cap, the positive direction at a coordinate of 0, and +x at the centre
of a sphere or on the axis of a cylinder. So every gradient has unit length.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fit.primitives import FACES, Kind, PrimitiveSet

Array = NDArray[np.floating]
Float64 = NDArray[np.float64]
Indices = NDArray[np.intp]

NO_PRIMITIVE = -1
"""Index of the nearest primitive of an empty set."""

_PAIRS_AT_ONCE = 1 << 15
"""Point-primitive pairs evaluated together: few enough that the temporaries stay in the cache."""

_HALF_SPACE = len(Kind)
"""Stands beside the four kinds where a plane without end needs a formula of its own."""


def sd_box(p: Array, half: Array) -> Array:
    """Distance (...) from points (..., 3) to the box of half extents (..., 3) about the origin."""
    q = np.abs(p) - half
    return _length(np.maximum(q, 0)) + np.minimum(np.max(q, axis=-1), 0)


def sd_sphere(p: Array, radius: Array | float) -> Array:
    """Distance (...) from points (..., 3) to the sphere of `radius` (...) about the origin."""
    return _length(p) - radius


def sd_cylinder(p: Array, radius: Array | float, half_height: Array | float) -> Array:
    """Distance (...) from points (..., 3) to the cylinder along Y, capped at +-half_height."""
    side = np.sqrt(p[..., 0] * p[..., 0] + p[..., 2] * p[..., 2]) - radius
    cap = np.abs(p[..., 1]) - half_height
    out_side, out_cap = np.maximum(side, 0), np.maximum(cap, 0)
    return np.sqrt(out_side * out_side + out_cap * out_cap) + np.minimum(np.maximum(side, cap), 0)


def sd_half_space(p: Array) -> Array:
    """Distance (...) from points (..., 3) to the half-space y <= 0."""
    return p[..., 1]


def sd_box_gradient(p: Array, half: Array) -> Array:
    """Unit gradient (..., 3) of `sd_box`."""
    q = np.abs(p) - half
    facing = np.where(p < 0, -1.0, 1.0).astype(p.dtype)
    inside = np.eye(3, dtype=p.dtype)[np.argmax(q, axis=-1)]
    outside = np.maximum(q, 0)
    return facing * np.where(np.any(outside > 0, axis=-1, keepdims=True), _unit(outside), inside)


def sd_sphere_gradient(p: Array, radius: Array | float = 0.0) -> Array:
    """Unit gradient (..., 3) of `sd_sphere`, whatever the radius."""
    return _unit(p)


def sd_cylinder_gradient(p: Array, radius: Array | float, half_height: Array | float) -> Array:
    """Unit gradient (..., 3) of `sd_cylinder`."""
    across = _unit(p * np.array([1, 0, 1], dtype=p.dtype))
    along = np.where(p[..., 1:2] < 0, -1.0, 1.0).astype(p.dtype) * np.array([0, 1, 0], dtype=p.dtype)
    side = np.sqrt(p[..., 0] * p[..., 0] + p[..., 2] * p[..., 2]) - radius
    cap = np.abs(p[..., 1]) - half_height
    out = _unit(np.stack([np.maximum(side, 0), np.maximum(cap, 0)], axis=-1))
    inside = np.where((side >= cap)[..., None], across, along)
    outside = out[..., 0:1] * across + out[..., 1:2] * along
    return np.where((np.maximum(side, cap) > 0)[..., None], outside, inside)


def sd_half_space_gradient(p: Array) -> Array:
    """Unit gradient (..., 3) of `sd_half_space`."""
    return np.broadcast_to(np.array([0, 1, 0], dtype=p.dtype), p.shape).copy()


def distance(primitives: PrimitiveSet, points: ArrayLike) -> Float64:
    """Signed distances (p, n) from world points (p, 3) to each of n primitives."""
    points = _as_points(points)
    result = np.empty((len(points), len(primitives)))
    groups = _groups(primitives)
    for rows in _row_chunks(len(points), len(primitives)):
        _fill_distances(groups, points[rows], result[rows])
    return result


def union_distance(
    primitives: PrimitiveSet, points: ArrayLike, chunk: int | None = None
) -> tuple[Float64, Indices]:
    """Signed distances (p,) from world points (p, 3) to the union, and whose they are (p,).

    It is the smallest of the primitives' distances: exact outside, a bound inside where primitives overlap.
    Of equally near primitives the first counts. An empty set is infinitely far, of index -1. `chunk` is the
    number of points evaluated together; memory grows with chunk * n only.
    """
    points = _as_points(points)
    if len(primitives) == 0:
        return np.full(len(points), np.inf), np.full(len(points), NO_PRIMITIVE, np.intp)
    nearest, index = np.empty(len(points)), np.empty(len(points), np.intp)
    groups = _groups(primitives)
    for rows in _row_chunks(len(points), len(primitives), chunk):
        block = np.empty((len(points[rows]), len(primitives)))
        _fill_distances(groups, points[rows], block)
        index[rows] = np.argmin(block, axis=1)
        nearest[rows] = block[np.arange(len(block)), index[rows]]
    return nearest, index


def gradient(primitives: PrimitiveSet, points: ArrayLike, index: ArrayLike) -> Float64:
    """World-space unit gradients (p, 3) of the distance from point i to primitive `index[i]`."""
    local, half, turn, index = _paired(primitives, points, index)
    result = np.empty_like(local)
    with np.errstate(under="ignore"):
        for shape, own in _by_shape(primitives, index):
            p, h = local[own], half[own]
            if shape == Kind.SPHERE:
                result[own] = sd_sphere_gradient(p, h[:, 0])
            elif shape == Kind.CYLINDER:
                result[own] = sd_cylinder_gradient(p, h[:, 0], h[:, 1])
            elif shape == _HALF_SPACE:
                result[own] = sd_half_space_gradient(p)
            else:
                result[own] = sd_box_gradient(p, h)
        return np.einsum("pij,pj->pi", turn, result)


def primitive_face(primitives: PrimitiveSet, points: ArrayLike, index: ArrayLike) -> Indices:
    """Which of `FACES` (p,) colours a hit at point i on primitive `index[i]`.

    It is the face whose plane lies farthest outwards at the point, which is the one hit but for rounding. A
    sphere, and a cylinder's side, has one colour: +x stands for it. A half-space is all +y.
    """
    local, half, _, index = _paired(primitives, points, index)
    face = np.zeros(len(index), np.intp)
    with np.errstate(under="ignore"):
        for shape, own in _by_shape(primitives, index):
            p, h = local[own], half[own]
            if shape == Kind.CYLINDER:
                cap = np.abs(p[:, 1]) - h[:, 1] > np.hypot(p[:, 0], p[:, 2]) - h[:, 0]
                face[own] = np.where(cap, 2 + (p[:, 1] < 0), 0)
            elif shape == _HALF_SPACE:
                face[own] = FACES.index("+y")
            elif shape != Kind.SPHERE:
                axis = np.argmax(np.abs(p) - h, axis=1)
                face[own] = 2 * axis + (p[np.arange(len(p)), axis] < 0)
    return face


def boundary_area(primitives: PrimitiveSet, half_space_size: float | None = None) -> Float64:
    """Area (n,) of each boundary; a half-space has 0, or that of a square of side `half_space_size`."""
    area = primitives.face_areas().sum(axis=1)
    area[primitives.is_half_space] = 0.0 if half_space_size is None else half_space_size**2
    return area


def volume(primitives: PrimitiveSet) -> Float64:
    """Volume (n,) of each primitive; a half-space's is infinite."""
    endless = primitives.is_half_space
    box = np.prod(np.where(endless[:, None], 1.0, primitives.sizes), axis=1)
    filled = np.choose(primitives.kinds, [1.0, np.pi / 6, np.pi / 4, 1.0])
    return np.where(endless, np.inf, box * filled)


def sample_boundary(
    primitives: PrimitiveSet, count: int, seed: int, half_space_size: float | None = None
) -> tuple[Float64, Float64, Indices]:
    """Points (count, 3) uniform by area on the primitives' boundaries, their outward normals (count, 3), and
    whose they are (count,), in ascending order.

    Points that lie inside another primitive are the caller's to drop. Half-spaces are skipped, or stand for
    the square of side `half_space_size` about their position.

    Raises:
        ValueError: the set has no area to sample.
    """
    area = boundary_area(primitives, half_space_size)
    if not area.sum() > 0:
        raise ValueError("the primitive set has no finite boundary to sample; give half_space_size")
    rng = np.random.default_rng(seed)
    index = np.sort(rng.choice(len(primitives), size=count, p=area / area.sum())).astype(np.intp)
    unit = rng.random((count, 3))
    half = primitives.sizes[index] / 2
    local, normals = np.empty((count, 3)), np.empty((count, 3))
    for shape, own in _by_shape(primitives, index):
        u, h = unit[own], half[own]
        if shape == Kind.SPHERE:
            normals[own] = _directions(u)
            local[own] = normals[own] * h[:, :1]
        elif shape == Kind.CYLINDER:
            local[own], normals[own] = _on_cylinder(u, h)
        elif shape == _HALF_SPACE:
            local[own] = (u - 0.5) * np.array([half_space_size, 0.0, half_space_size])
            normals[own] = (0, 1, 0)
        else:
            local[own], normals[own] = _on_box(u, h)
    turn = primitives.rotation_matrices()[index]
    points = np.einsum("pij,pj->pi", turn, local) + primitives.positions[index]
    return points, np.einsum("pij,pj->pi", turn, normals), index


def _length(v: Array) -> Array:
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    return np.sqrt(x * x + y * y + z * z)


def _unit(v: Array) -> Array:
    """Vectors (..., k) at unit length without under- or overflow; a zero vector becomes the first axis."""
    largest = np.max(np.abs(v), axis=-1, keepdims=True)
    zero = largest == 0
    first = np.eye(v.shape[-1], dtype=v.dtype)[0]
    scaled = np.where(zero, first, v / np.where(zero, 1, largest))
    return scaled / np.linalg.norm(scaled, axis=-1, keepdims=True)


def _as_points(points: ArrayLike) -> Float64:
    p = np.asarray(points, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 3:
        raise ValueError(f"points have the shape {p.shape}; (p, 3) is needed")
    return p


def _shapes(primitives: PrimitiveSet) -> Indices:
    """The formula (n,) each primitive needs: its kind, or `_HALF_SPACE`."""
    return np.where(primitives.is_half_space, _HALF_SPACE, primitives.kinds).astype(np.intp)


def _by_shape(primitives: PrimitiveSet, index: Indices) -> Iterator[tuple[int, Indices]]:
    """Each formula in use with the rows of `index` whose primitive needs it."""
    shapes = _shapes(primitives)[index]
    for shape in range(_HALF_SPACE + 1):
        own = np.flatnonzero(shapes == shape)
        if len(own):
            yield shape, own


def _paired(
    primitives: PrimitiveSet, points: ArrayLike, index: ArrayLike
) -> tuple[Float64, Float64, Float64, Indices]:
    """Point i in the space of primitive `index[i]`: local points, half extents, world from local, index."""
    world, own = _as_points(points), np.asarray(index, dtype=np.intp)
    turn = primitives.rotation_matrices()[own]
    with np.errstate(under="ignore"):
        local = np.einsum("pji,pj->pi", turn, world - primitives.positions[own])
    return local, primitives.sizes[own] / 2, turn, own


Group = tuple[int, Indices, Float64, Float64, Float64]
"""Primitives of one formula: the formula, their indices (k,), positions, turns (k, 3, 3), half extents."""


def _groups(primitives: PrimitiveSet) -> list[Group]:
    turn, half = primitives.rotation_matrices(), primitives.sizes / 2
    every = np.arange(len(primitives), dtype=np.intp)
    return [
        (shape, own, primitives.positions[own], turn[own], half[own])
        for shape, own in _by_shape(primitives, every)
    ]


def _row_chunks(rows: int, columns: int, chunk: int | None = None) -> Iterator[slice]:
    step = max(1, chunk or _PAIRS_AT_ONCE // max(columns, 1))
    for start in range(0, rows, step):
        yield slice(start, start + step)


def _fill_distances(groups: list[Group], points: Float64, result: Float64) -> None:
    """Write the distances (c, n) of points (c, 3) into `result`.

    The offset to the primitive is taken before the rotation: far from the origin this order keeps the digits.
    Coordinates are the leading axis in memory, so that each sum runs over adjacent numbers.
    """
    with np.errstate(under="ignore"):
        for shape, own, position, turn, half in groups:
            dx, dy, dz = (points[:, i, None] - position[:, i] for i in range(3))
            local = np.empty((3, len(points), len(own)))
            for i in range(3):
                local[i] = dx * turn[:, 0, i] + dy * turn[:, 1, i] + dz * turn[:, 2, i]
            p = np.moveaxis(local, 0, -1)
            if shape == Kind.SPHERE:
                result[:, own] = sd_sphere(p, half[:, 0])
            elif shape == Kind.CYLINDER:
                result[:, own] = sd_cylinder(p, half[:, 0], half[:, 1])
            elif shape == _HALF_SPACE:
                result[:, own] = sd_half_space(p)
            else:
                result[:, own] = sd_box(p, half)


def _directions(u: Float64) -> Float64:
    """Uniform unit vectors (p, 3) of random numbers (p, 3), by Archimedes' hat-box theorem."""
    y, angle = 2 * u[:, 0] - 1, 2 * np.pi * u[:, 1]
    across = np.sqrt(np.maximum(1 - y * y, 0))
    return np.stack([across * np.cos(angle), y, across * np.sin(angle)], axis=-1)


def _on_cylinder(u: Float64, half: Float64) -> tuple[Float64, Float64]:
    """Uniform points and normals (p, 3) on capped cylinders of half extents (p, 3)."""
    radius, half_height = half[:, 0], half[:, 1]
    # Side 4 pi r h, both caps 2 pi r^2: the first number chooses, and what is left of it is uniform again.
    side_share = 2 * half_height / (2 * half_height + radius)
    side = u[:, 0] < side_share
    left = np.where(side, u[:, 0] / side_share, (u[:, 0] - side_share) / np.maximum(1 - side_share, 1e-300))
    top = np.where(left < 0.5, -1.0, 1.0)
    reach = np.where(side, radius, radius * np.sqrt(u[:, 2]))
    c, s = np.cos(2 * np.pi * u[:, 1]), np.sin(2 * np.pi * u[:, 1])
    points = np.stack([reach * c, np.where(side, 2 * left - 1, top) * half_height, reach * s], axis=-1)
    normals = np.where(
        side[:, None],
        np.stack([c, np.zeros_like(c), s], axis=-1),
        np.stack([np.zeros_like(c), top, np.zeros_like(c)], axis=-1),
    )
    return points, normals


def _on_box(u: Float64, half: Float64) -> tuple[Float64, Float64]:
    """Uniform points and normals (p, 3) on boxes of half extents (p, 3)."""
    x, y, z = half.T
    pair_areas = np.stack([y * z, x * z, x * y], axis=-1)
    ends = np.cumsum(pair_areas / pair_areas.sum(axis=1, keepdims=True), axis=1)
    axis = np.minimum(np.sum(u[:, :1] >= ends, axis=1), 2)
    rows = np.arange(len(u))
    starts = np.where(axis > 0, ends[rows, axis - 1], 0.0)
    left = (u[:, 0] - starts) / np.maximum(ends[rows, axis] - starts, 1e-300)
    sign = np.where(left < 0.5, -1.0, 1.0)
    points = np.empty_like(half)
    for k in (1, 2):
        other = (axis + k) % 3
        points[rows, other] = (2 * u[:, k] - 1) * half[rows, other]
    points[rows, axis] = sign * half[rows, axis]
    normals = np.zeros_like(half)
    normals[rows, axis] = sign
    return points, normals
