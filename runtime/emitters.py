"""Surfaces that shine, as the shaders draw them: one after the other with their shares of all power.

A surface is drawn by its power and a point on it evenly, so that a point's density is the strength of its
emission over the power of all, whatever it lies on. Half-spaces have no power that could be shared: rays
meet them by chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fit.encoding import decode_rgb9e5
from fit.primitives import Kind, PrimitiveSet
from runtime.structs import GpuStruct, f32, u32


class Emitter(GpuStruct):
    share: f32
    surface: u32
    face: u32


@dataclass(frozen=True)
class Emitters:
    """records (n,) of `Emitter`, at least one because an empty buffer cannot be bound.

    share: of all power, summed up to this one; surface: index of the primitive or triangle; face: of a
    primitive. power: of all together, the sum of the channels' emission times area.
    """

    records: np.ndarray
    count: int
    power: float


def emitters_of(strength: ArrayLike, areas: ArrayLike, surfaces: ArrayLike, faces: ArrayLike) -> Emitters:
    """Emitters of n surfaces: strength (n,), the sum of the channels' radiance; areas (n,), m2."""
    power = np.asarray(strength, np.float64) * np.asarray(areas, np.float64)
    shining = np.flatnonzero(power > 0)
    total = float(power[shining].sum())
    if not len(shining):
        return Emitters(np.zeros(1, Emitter.dtype), 0, 0.0)
    records = Emitter.pack_array(
        len(shining),
        share=np.cumsum(power[shining]) / total,
        surface=np.asarray(surfaces, np.uint32)[shining],
        face=np.asarray(faces, np.uint32)[shining],
    )
    return Emitters(records, len(shining), total)


def primitive_emitters(primitives: PrimitiveSet, words: NDArray[np.uint32]) -> Emitters:
    """Of the finite primitives whose records are `words` (n, 16), both in the order of the GPU.

    Emission is what the records hold, so that shaders find the same densities.
    """
    selector = words[:, 8:14] >> 30
    shown = np.stack([selector & 1, selector >> 1], axis=-1).astype(np.float64)
    strength = np.einsum("nfe,nec->nf", shown, decode_rgb9e5(words[:, 14:16]))
    areas = primitives.face_areas()
    areas[primitives.is_half_space] = 0
    # A sphere, and the side of a cylinder, is one surface: shaders call it the first face.
    spheres, cylinders = (np.flatnonzero(primitives.kinds == kind) for kind in (Kind.SPHERE, Kind.CYLINDER))
    for rows, parts in ((spheres, [0, 1, 2, 3, 4, 5]), (cylinders, [0, 1, 4, 5])):
        whole = areas[rows][:, parts].sum(axis=1)
        areas[rows[:, None], parts] = 0
        areas[rows, 0] = whole
    surfaces, faces = np.divmod(np.arange(6 * len(words)), 6)
    return emitters_of(strength.reshape(-1), areas.reshape(-1), surfaces, faces)
