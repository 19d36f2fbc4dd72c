"""Light under an even sky: how bright surfaces are that nobody has lit yet.

A set is lit by any sun and any lamp later. What can be said before is what a sky of radiance 1 in all
directions, which stands for every sun and sky, makes of the scene: the radiosity of its surfaces, gathered
along cosine-weighted rays (Goral et al. 1984),

    B = rho E / pi,  E / pi = mean of the radiance that the rays meet: 1 in the open, B at surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fit.sample import random_directions
from fit.scene import Float64
from fit.spaces import Air
from fit.targets import Seen

RAYS = 16
"""From each sample. Their noise evens out over the many samples that anything is asked of."""

BOUNCES = 4
"""Each adds the mean albedo's power: at 0.5 the fifth would add 3 % of the first."""

TURN_CELLS = 4.0
"""How far off a sample counts that faces the other way: the two sides of a thin wall keep their own light."""

START_CELLS = 1e-4
"""How far off its surface a ray starts."""


@dataclass(frozen=True, eq=False)
class EvenLight:
    """radiance (p,): of the seen samples, the same in all directions. places: finds them by where they are
    and what they face, a unit of the normal counting as `turn` metres."""

    air: Air
    radiance: Float64
    places: cKDTree
    turn: float

    @staticmethod
    def of(air: Air, seen: Seen, albedo: Float64, seed: int = 0) -> EvenLight:
        """Lights samples of this albedo (p,), the mean of the channels."""
        turn = TURN_CELLS * air.cell
        points, normals = seen.samples.points, seen.normals
        places = cKDTree(np.concatenate([points, turn * normals], axis=1))
        light = EvenLight(air, np.zeros(len(seen)), places, turn)
        from_ = np.repeat(np.arange(len(seen)), RAYS)
        starts = points[from_] + START_CELLS * air.cell * normals[from_]
        directions = cosine_directions(normals[from_], seed)
        met = light.first_met(starts, directions)[1]
        for _ in range(BOUNCES):
            arriving = light.of_samples(met).reshape(-1, RAYS).mean(axis=1)
            light = replace(light, radiance=albedo * arriving)
        return light

    def first_met(self, origins: Float64, directions: Float64) -> tuple[Float64, NDArray[np.int64]]:
        """How far (p,) rays go, inf in the open, and the sample (p,) nearest to what they meet, -1: none."""
        ends, triangle = self.air.rays.first_hit(origins, directions)
        hit = np.flatnonzero(triangle >= 0)
        normals = self.air.walls.normals[triangle[hit]]
        along = np.einsum("pk,pk->p", normals, directions[hit])
        facing = normals * np.where(along > 0, -1.0, 1.0)[:, None]
        points = origins[hit] + ends[hit, None] * directions[hit]
        met = np.full(len(origins), -1)
        met[hit] = self.places.query(np.concatenate([points, self.turn * facing], axis=1))[1]
        return ends, met

    def of_samples(self, met: NDArray[np.int64]) -> Float64:
        """Radiance (p,) of samples by their rows; that of the sky for -1."""
        return np.where(met < 0, 1.0, self.radiance[met])


def cosine_directions(normals: Float64, seed: int) -> Float64:
    """A unit vector (p, 3) over each normal (p, 3), in proportion to its cosine: a point of the unit sphere
    that stands on the surface."""
    directions = normals + (1 - 1e-9) * random_directions(len(normals), seed)
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)
