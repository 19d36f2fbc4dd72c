"""What a body's set is judged by: the volume in which the set and the solid differ.

With distances clipped to a band, |clip(d_S) - clip(d_M)| summed over points that stand for volumes is the
symmetric difference wherever the two boundaries run side by side, and unlike occupancy it has a slope.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fit.scene import Float64
from fit.shapes import Shapes, distances_to_one
from fit.solid import Solid
from fit.spaces import Air

NEAR_CELLS = 3
"""Most points are drawn nearer to the surface than this: there the set and the solid differ."""


@dataclass(frozen=True)
class Occupancy:
    """p points (p, 3), the signed distances (p,) of the solid there, negative inside, clipped to `band`, and
    the volumes (p,) that they stand for, in m3."""

    points: Float64
    distances: Float64
    volumes: Float64
    band: float

    def __len__(self) -> int:
        return len(self.points)

    def select(self, rows: NDArray[np.generic]) -> Occupancy:
        return Occupancy(self.points[rows], self.distances[rows], self.volumes[rows], self.band)

    @property
    def inside(self) -> NDArray[np.bool_]:
        return self.distances < 0

    def differences(self, distances: Float64) -> Float64:
        """Volume (..., p) about each point that differs when a set is at these distances (..., p)."""
        clipped = np.clip(distances, -self.band, self.band)
        return self.volumes * np.abs(clipped - self.distances) / (2 * self.band)


def sample_occupancy(solid: Solid, air: Air, near: int, far: int, band_cells: float, seed: int) -> Occupancy:
    """Up to `near` points within three cells of the surface, up to `far` deeper inside and as many outside.

    One point in each cell drawn, anywhere in the cell.
    """
    rng = np.random.default_rng(seed)
    depth = ndimage.distance_transform_cdt(~air.free, "chessboard").astype(np.int32)
    depth -= ndimage.distance_transform_cdt(air.free, "chessboard")
    strata = (np.abs(depth) <= NEAR_CELLS, depth > NEAR_CELLS, depth < -NEAR_CELLS)
    drawn, volumes = [], []
    for stratum, most in zip(strata, (near, far, far), strict=True):
        cells = np.flatnonzero(stratum.ravel())
        chosen = np.sort(rng.choice(cells, size=min(most, len(cells)), replace=False))
        drawn.append(chosen)
        volumes.append(np.full(len(chosen), air.cell**3 * len(cells) / max(len(chosen), 1)))
    index = np.concatenate(drawn)
    points = air.grid.centers(np.stack(np.unravel_index(index, air.grid.shape), axis=1))
    points += (rng.random(points.shape) - 0.5) * air.cell
    band = band_cells * air.cell
    return Occupancy(
        points, np.clip(solid.distances(points), -band, band), np.concatenate(volumes), band
    )  # fmt: skip


def distance_table(shapes: Shapes, occupancy: Occupancy) -> Float64:
    """Signed distances (n, p) from all points to all shapes."""
    table = np.empty((len(shapes), len(occupancy)))
    for i in range(len(shapes)):
        table[i] = distances_to_one(shapes, i, occupancy.points)
    return table


def difference(shapes: Shapes, occupancy: Occupancy) -> float:
    """The symmetric difference of the set's union and the solid, in m3."""
    distances = distance_table(shapes, occupancy).min(axis=0, initial=np.inf)
    return float(occupancy.differences(distances).sum())


def worths(shapes: Shapes, occupancy: Occupancy) -> Float64:
    """What the difference would rise by without each shape alone (n,)."""
    table = distance_table(shapes, occupancy)
    nearest = table.argmin(axis=0)
    others = np.partition(table, 1, axis=0)[1] if len(table) > 1 else np.full(len(occupancy), np.inf)
    rise = occupancy.differences(others) - occupancy.differences(table.min(axis=0))
    return np.bincount(nearest, weights=rise, minlength=len(shapes)).astype(np.float64)
