"""The primitive set: boxes, spheres, cylinders and planes with albedo and emission, as a structure of arrays."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]

FACES = ("+x", "-x", "+y", "-y", "+z", "-z")
"""Order of the per-face colours of a primitive, in its local axes."""

PLANE_THICKNESS_LIMIT = 0.05
"""A finite plane is at most this share of its smaller size thick; thicker ones are boxes."""


class Kind(IntEnum):
    BOX = 0
    SPHERE = 1
    CYLINDER = 2
    PLANE = 3


@dataclass(frozen=True)
class PrimitiveSet:
    """n primitives in world space.

    kinds (n,) uint8 of `Kind`; positions (n, 3) float64, the centre (a half-space: any point of its surface);
    rotations (n, 4) float64 unit quaternions, xyzw, world from local;
    sizes (n, 3) float64, full extents of the local bounding box: box (x, y, z); sphere (d, d, d);
    cylinder (d, height, d), its axis local Y; plane (size_x, thickness, size_z), its normal local +Y;
    a half-space is a plane of sizes (inf, 0, inf), solid below its surface;
    albedo, emission (n, 6, 3) float32 linear, one for each of `FACES` (emission is radiance, W/m2/sr).
    A sphere has one colour in all six; a cylinder one for its side (+-x, +-z) and one for each cap (+-y);
    a plane one for each side (+-y), its rim (+-x, +-z) the mean of both.
    """

    kinds: NDArray[np.uint8]
    positions: Float64
    rotations: Float64
    sizes: Float64
    albedo: Float32
    emission: Float32
    names: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.kinds)
