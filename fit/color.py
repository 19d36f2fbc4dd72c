"""Albedo and emission of each face of each primitive: means over the surface that it stands for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.primitives import Kind, PrimitiveSet, shared_face_colors
from fit.scene import AlphaMode, Float64, Scene
from fit.sdf import distance
from fit.surface import TRANSPARENT_ALPHA, Surface, colors
from fit.targets import Seen

Index = NDArray[np.int64]

_BEHIND = 1e-9
"""Factor on the weight of samples behind their primitive: they speak only where no other does."""

_MIDDLE = 0.4
"""Of the thickness: both sides of a sheet lie near the middle of its primitive, and count."""


def color(
    primitives: PrimitiveSet, scene: Scene, walls: Surface, seen: Seen, weights: Float64
) -> PrimitiveSet:
    """The set with the area-weighted means of the textured linear colours of the surface near each face.

    Every seen sample goes to the primitive whose boundary is nearest, and there to the face that looks its
    way: so the two sides of a thin wall keep their own colours. A face that stands for no sample takes its
    primitive's mean, a primitive without any the mean of the scene. Where alpha cuts a hole, nothing reflects
    a colour and nothing emits.
    weights (p,): of the samples.
    """
    if len(primitives) == 0 or len(seen) == 0:
        return primitives
    owner = nearest_primitive(primitives, seen.samples.points, seen.normals)
    face, turned_here = facing(primitives, owner, seen.samples.points, seen.normals)
    weights = np.where(turned_here, weights, _BEHIND * weights)
    albedo, emission, alpha = colors(scene, walls, seen.samples.triangle, seen.samples.barycentric)
    shown = alpha >= _cutoffs(scene)[walls.material[seen.samples.triangle]]
    slot = owner * 6 + face
    shared = [
        shared_face_colors(
            primitives.kinds, _means(values, slot, mass, len(primitives)), primitives.face_areas()
        )
        for values, mass in (
            (np.clip(albedo, 0.0, 1.0), weights * shown),
            (np.maximum(emission, 0.0) * shown[:, None], weights),
        )
    ]
    return replace(primitives, albedo=shared[0], emission=shared[1])


def nearest_primitive(primitives: PrimitiveSet, points: Float64, normals: Float64) -> Index:
    """Primitive (p,) whose boundary is nearest to each point; of equal ones the one behind the surface."""
    nudge = 1e-6 * float(np.abs(points - points.mean(axis=0)).max())
    best, owner = np.full(len(points), np.inf), np.zeros(len(points), np.int64)
    behind = points - nudge * normals
    for start in range(0, len(points), 4096):
        rows = slice(start, start + 4096)
        distances = distance(primitives, points[rows])
        tie = (distance(primitives, behind[rows]) > 0) * nudge
        score = np.abs(distances) + tie
        owner[rows], best[rows] = score.argmin(axis=1), score.min(axis=1)
    return owner


def facing(
    primitives: PrimitiveSet, owner: Index, points: Float64, normals: Float64
) -> tuple[Index, NDArray[np.bool_]]:
    """Face (p,) of primitive `owner[i]` that looks along normal i, and whether point i lies on its side.

    A point in the half that is turned away looks through the primitive: the inner side of a hollow wall, seen
    through a gap, is no part of the wall's other face.
    """
    frames = primitives.rotation_matrices()[owner]
    local = np.einsum("pij,pi->pj", frames, normals)
    flat = primitives.kinds[owner] == Kind.PLANE
    local[flat, 0] = local[flat, 2] = 0.0  # a sheet shows its two sides only
    axis = np.abs(local).argmax(axis=1)
    axis[flat] = 1
    rows = np.arange(len(local))
    negative = local[rows, axis] < 0
    place = np.einsum("pij,pi->pj", frames, points - primitives.positions[owner])[rows, axis]
    depth = np.where(negative, place, -place)  # beyond the middle, seen from that face
    return 2 * axis + negative, depth <= _MIDDLE * primitives.sizes[owner, axis]


def _cutoffs(scene: Scene) -> Float64:
    """Alpha (m + 1,) below which each material is a hole; the last one stands for index -1, no material."""
    cutoff = {AlphaMode.OPAQUE: -np.inf, AlphaMode.BLEND: TRANSPARENT_ALPHA}
    return np.array([*(cutoff.get(m.alpha_mode, m.alpha_cutoff) for m in scene.materials), -np.inf])


def _means(values: Float64, slot: Index, weights: Float64, count: int) -> Float64:
    """Weighted means (n, 6, 3) over the slots; of the primitive, then of all, where a slot has no sample."""
    mass = np.bincount(slot, weights=weights, minlength=count * 6).reshape(count, 6)
    sums = np.stack(
        [np.bincount(slot, weights=weights * values[:, c], minlength=count * 6) for c in range(3)], axis=1
    ).reshape(count, 6, 3)
    whole = sums.sum(axis=(0, 1)) / max(float(mass.sum()), np.finfo(float).tiny)
    own_mass, own_sum = mass.sum(axis=1), sums.sum(axis=1)
    own = np.where(own_mass[:, None] > 0, own_sum / np.where(own_mass > 0, own_mass, 1.0)[:, None], whole)
    face = sums / np.where(mass > 0, mass, 1.0)[:, :, None]
    return np.where(mass[:, :, None] > 0, face, own[:, None, :])
