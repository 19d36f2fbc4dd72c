"""Points drawn uniformly by area from a surface."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import trimesh
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
    areas = np.where(surface.is_wall, surface.areas, 0.0)
    if count == 0 or not areas.sum() > 0:
        return Samples(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros((0, 3)))
    corners = np.arange(3 * len(surface)).reshape(-1, 3)
    mesh = trimesh.Trimesh(surface.vertices.reshape(-1, 3), corners, process=False)
    _, triangle, barycentric = trimesh.sample.sample_surface(
        mesh, count, face_weight=areas, return_barycentric=True, seed=seed
    )
    points = np.einsum("pc,pck->pk", barycentric, surface.vertices[triangle])
    return Samples(points, surface.normals[triangle], triangle, barycentric)


def random_directions(count: int, seed: int | tuple[int, ...]) -> Float64:
    """Unit vectors (count, 3), uniform."""
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)
