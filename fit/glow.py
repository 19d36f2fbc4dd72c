"""What the scene's own surfaces emit: points on them, each with the light that it stands for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.sample import sample_surface
from fit.scene import AlphaMode, Float64, Scene
from fit.spaces import Air
from fit.surface import TRANSPARENT_ALPHA, colors

Index = NDArray[np.int64]

GLOW_SAMPLES = 4_000
"""Points on emissive surfaces alone: a lamp of a few cm2 in a hall would else be missed by all samples."""


@dataclass(frozen=True)
class Glow:
    """g points (g, 3) of emissive surface that air touches, normals (g, 3) toward the air; triangle (g,):
    rows of the walls; areas (g,) that they stand for, m2; emission (g, 3), W/m2/sr. All with g = 0 when the
    scene has no lamp of its own."""

    points: Float64
    normals: Float64
    triangle: Index
    areas: Float64
    emission: Float64

    def __len__(self) -> int:
        return len(self.areas)

    @property
    def flux(self) -> Float64:
        """Emission times area (g, 3), W/sr."""
        return self.emission * self.areas[:, None]


def find_glow(scene: Scene, air: Air, seed: int = 0) -> Glow:
    """Samples the emissive surfaces in proportion to area and strength; a sheet lit on both sides twice."""
    strength = np.array([*(max(m.emission) for m in scene.materials), 0.0])[air.walls.material]
    lit = np.flatnonzero(strength > 0)
    lamps = air.walls.select(lit)
    if len(lamps) == 0:
        return Glow(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 3)))
    power = lamps.areas * strength[lit]
    samples = sample_surface(replace(lamps, areas=power), GLOW_SAMPLES, seed)
    side = air.touches(samples.points, samples.normals)
    front, back = np.flatnonzero((side == 1) | (side == 2)), np.flatnonzero((side == -1) | (side == 2))
    rows = np.concatenate([front, back])
    triangle = lit[samples.triangle[rows]]
    _, emission, alpha = colors(scene, air.walls, triangle, samples.barycentric[rows])
    shown = alpha >= alpha_cutoffs(scene)[air.walls.material[triangle]]
    return Glow(
        points=samples.points[rows],
        normals=np.concatenate([samples.normals[front], -samples.normals[back]]),
        triangle=triangle,
        areas=power.sum() / (GLOW_SAMPLES * strength[triangle]),
        emission=np.maximum(emission, 0.0) * shown[:, None],
    )


def alpha_cutoffs(scene: Scene) -> Float64:
    """Alpha (m + 1,) below which each material is a hole; the last one stands for index -1, no material."""
    cutoff = {AlphaMode.OPAQUE: -np.inf, AlphaMode.BLEND: TRANSPARENT_ALPHA}
    return np.array([*(cutoff.get(m.alpha_mode, m.alpha_cutoff) for m in scene.materials), -np.inf])
