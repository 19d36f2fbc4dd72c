"""Points drawn uniformly by area from a surface."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from fit.scene import Float64
from fit.surface import Surface


@dataclass(frozen=True)
class Samples:
    """p points on a surface: points, normals (p, 3) float64; triangle (p,) rows of the surface;
    barycentric (p, 3), the weights of the triangle's vertices."""

    points: Float64
    normals: Float64
    triangle: NDArray[np.int64]
    barycentric: Float64

    def __len__(self) -> int:
        return len(self.triangle)

    def select(self, index: NDArray[np.generic]) -> Samples:
        """The samples of an index array or a mask."""
        return Samples(**{f.name: getattr(self, f.name)[index] for f in fields(self)})


def sample_surface(surface: Surface, count: int, seed: int) -> Samples:
    """`count` points, uniform by area over the faces that stop light; none when there is no such face."""
    rng = np.random.default_rng(seed)
    cumulative = np.cumsum(np.where(surface.is_wall, surface.areas, 0.0))
    if len(cumulative) == 0 or cumulative[-1] <= 0:
        count = 0
    u, v, w = rng.random((3, count))
    if count:
        last = np.flatnonzero(cumulative < cumulative[-1])
        triangle = np.searchsorted(cumulative, u * cumulative[-1], side="right")
        triangle = np.minimum(triangle, last[-1] + 1 if len(last) else 0)
    else:
        triangle = np.zeros(0, np.int64)
    # Osada et al. 2002, equation 1: the square root makes the density uniform.
    root = np.sqrt(v)
    barycentric = np.stack([1 - root, root * (1 - w), root * w], axis=1)
    points = np.einsum("pc,pck->pk", barycentric, surface.vertices[triangle])
    return Samples(points, surface.normals[triangle], triangle, barycentric)
