"""What a body's set is judged by: the volume in which the set and the solid differ.

With distances clipped to a band, |clip(d_S) - clip(d_M)| summed over points that stand for volumes is the
symmetric difference wherever the two boundaries run side by side, and unlike occupancy it has a slope.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fit.bvh import morton_code
from fit.scene import Float64
from fit.shapes import Shapes, distances_to_one
from fit.solid import Solid
from fit.spaces import Air

BAND_CELLS = 3.0
"""Half the band's width at most: narrower ones follow the samples, wider ones see past what is thin."""

BAND_SHARE, LEAST_BAND_CELLS = 0.5, 0.2
"""Of the mean thickness, twice volume by area: the band of a thin body; and the narrowest one."""

RUN = 32
"""Points side by side whose distances are left out together when a shape is far from all of them."""

_DRAWS = 6
"""Times that the number of points near the surface may be drawn to find that number."""


@dataclass(frozen=True)
class Occupancy:
    """p points (p, 3), the signed distances (p,) of the solid, negative inside, and the volumes (p,) that
    they stand for, all in the units of the air, which are canonical in a fit. Distances count up to the
    `band`. Neighbours in space are side by side."""

    points: Float64
    distances: Float64
    volumes: Float64
    band: float

    def __len__(self) -> int:
        return len(self.points)

    def select(self, rows: NDArray[np.generic] | slice, share: float = 1.0) -> Occupancy:
        """Some rows, which stand for a `share` of the volume that all do."""
        return Occupancy(self.points[rows], self.distances[rows], self.volumes[rows] / share, self.band)

    @property
    def inside(self) -> NDArray[np.bool_]:
        return self.distances < 0

    def differences(self, distances: Float64) -> Float64:
        """Volume (..., p) about each point that differs when a set is at these distances (..., p)."""
        return self.volumes * np.abs(self.clipped(distances) - self.known) / (2 * self.band)

    def differences_at(self, rows: NDArray[np.integer], distances: Float64) -> Float64:
        """`differences` (k,) of some points alone, when the set is at these distances (k,) from them."""
        return self.volumes[rows] * np.abs(self.clipped(distances) - self.known[rows]) / (2 * self.band)

    def clipped(self, distances: Float64) -> Float64:
        """Distances as far as the band tells them apart."""
        return np.clip(distances, -self.band, self.band)

    @cached_property
    def known(self) -> Float64:
        """The solid's clipped distances (p,)."""
        return self.clipped(self.distances)

    @cached_property
    def runs(self) -> tuple[Float64, Float64]:
        """Centres (r, 3) and radii (r,) of the balls around each `RUN` points."""
        starts = np.arange(0, len(self), RUN)
        lower, upper = (f.reduceat(self.points, starts, axis=0) for f in (np.minimum, np.maximum))
        return (lower + upper) / 2, np.linalg.norm(upper - lower, axis=1) / 2

    @cached_property
    def by_run(self) -> Float64:
        """The points of each run (r, `RUN`, 3), the last one filled up with its last point."""
        missing = -len(self) % RUN
        filled = np.concatenate([self.points, np.repeat(self.points[-1:], missing, axis=0)])
        return filled.reshape(-1, RUN, 3)


def sample_occupancy(solid: Solid, air: Air, near: int, far: int, seed: int) -> Occupancy:
    """About `near` points within the band of the surface, up to `far` deeper inside and as many outside."""
    rng = np.random.default_rng(seed)
    band = band_of(solid, air.cell)
    depth = ndimage.distance_transform_cdt(~air.free, "chessboard").astype(np.int32)
    depth -= ndimage.distance_transform_cdt(air.free, "chessboard")
    steps = int(np.ceil(band / air.cell)) + 1
    around = np.flatnonzero((np.abs(depth) <= steps).ravel())
    points, distances = _near_surface(solid, air, around, near, band, rng)
    volumes = np.full(len(points), air.cell**3 * len(around) / max(len(points), 1))
    outer = np.flatnonzero(np.abs(distances) >= band)
    kept = np.sort(rng.choice(outer, size=min(2 * far, len(outer)), replace=False))
    volumes[kept] *= len(outer) / max(len(kept), 1)
    rows = np.sort(np.concatenate([np.flatnonzero(np.abs(distances) < band), kept]))
    drawn = [(points[rows], distances[rows], volumes[rows])]
    far_off = BAND_CELLS * air.cell
    for stratum in (depth > steps, depth < -steps):
        cells = np.flatnonzero(stratum.ravel())
        chosen = rng.choice(cells, size=min(far, len(cells)), replace=False)
        points = _anywhere_in(air, chosen, rng)
        volumes = np.full(len(chosen), air.cell**3 * len(cells) / max(len(chosen), 1))
        drawn.append((points, np.where(solid.inside(points), -far_off, far_off), volumes))
    points, distances, volumes = (np.concatenate(several) for several in zip(*drawn, strict=True))
    order = along_a_curve(points)
    return Occupancy(points[order], distances[order], volumes[order], band)


def band_of(solid: Solid, cell: float) -> float:
    """Half the width of the band in which a solid and a set are compared."""
    corners, areas = solid.boundary.vertices - solid.boundary.center, solid.boundary.areas
    volume = float((areas * np.einsum("ij,ij->i", corners[:, 0], solid.boundary.normals)).sum()) / 3
    thickness = 2 * volume / float(areas.sum())
    return float(np.clip(BAND_SHARE * thickness, LEAST_BAND_CELLS * cell, BAND_CELLS * cell))


def _near_surface(
    solid: Solid, air: Air, cells: NDArray[np.int64], count: int, band: float, rng: np.random.Generator
) -> tuple[Float64, Float64]:
    """Points drawn uniformly in cells until about `count` are within the band, and their distances."""
    points, distances, found = [np.zeros((0, 3))], [np.zeros(0)], 0
    for _ in range(_DRAWS):
        drawn = _anywhere_in(air, rng.choice(cells, size=count if len(cells) else 0), rng)
        points.append(drawn)
        distances.append(solid.distances(drawn))
        found += int((np.abs(distances[-1]) < band).sum())
        if found >= 0.7 * count:
            break
    return np.concatenate(points), np.concatenate(distances)


def _anywhere_in(air: Air, cells: NDArray[np.int64], rng: np.random.Generator) -> Float64:
    """A point (n, 3) anywhere in each of the cells (n,), rows of the raveled grid."""
    centers = air.grid.centers(np.stack(np.unravel_index(cells, air.grid.shape), axis=1))
    return centers + (rng.random(centers.shape) - 0.5) * air.cell


def along_a_curve(points: Float64) -> NDArray[np.int64]:
    """The order (p,) of points along a Morton curve of 64 steps an axis: neighbours come side by side."""
    lower, upper = points.min(axis=0), points.max(axis=0)
    size = max(float((upper - lower).max()), np.finfo(float).tiny)
    steps = np.minimum((points - lower) / size * 64, 63).astype(np.int64)
    return np.argsort(morton_code(steps.T), kind="stable")


def distance_table(shapes: Shapes, occupancy: Occupancy, bands: float = 1.0) -> Float64:
    """Signed distances (n, p) from all points to all shapes; infinite beyond this many bands."""
    table = np.full((len(shapes), *occupancy.by_run.shape[:2]), np.inf)
    for i in range(len(shapes)):
        runs, distances = _near_runs(shapes, i, occupancy, bands)
        table[i, runs] = distances
    return table.reshape(len(shapes), occupancy.by_run[..., 0].size)[:, : len(occupancy)]


def nearest(shapes: Shapes, occupancy: Occupancy, bands: float = 1.0) -> tuple[NDArray[np.int64], Float64]:
    """The first of the nearest shapes (p,) to each point, and its distance as in `distance_table`."""
    lowest = np.full(occupancy.by_run.shape[:2], np.inf)
    owner = np.zeros(lowest.shape, np.int64)
    for i in range(len(shapes)):
        runs, distances = _near_runs(shapes, i, occupancy, bands)
        before = lowest[runs]
        owner[runs] = np.where(distances < before, i, owner[runs])
        lowest[runs] = np.minimum(distances, before)
    return owner.ravel()[: len(occupancy)], lowest.ravel()[: len(occupancy)]


def _near_runs(
    shapes: Shapes, which: int, occupancy: Occupancy, bands: float
) -> tuple[NDArray[np.int64], Float64]:
    """The runs (k,) that may be within so many bands of a shape, and its distances (k, `RUN`) there."""
    centers, radii = occupancy.runs
    runs = np.flatnonzero(distances_to_one(shapes, which, centers) < radii + bands * occupancy.band)
    points = occupancy.by_run[runs].reshape(-1, 3)
    return runs, distances_to_one(shapes, which, points).reshape(-1, RUN)


def difference(shapes: Shapes, occupancy: Occupancy) -> float:
    """The symmetric difference of the set's union and the solid, in cubed units of the points."""
    return float(occupancy.differences(nearest(shapes, occupancy)[1]).sum())


def worths(shapes: Shapes, occupancy: Occupancy) -> Float64:
    """What the difference would rise by without each shape alone (n,)."""
    table = distance_table(shapes, occupancy)
    nearest = table.argmin(axis=0)
    others = np.partition(table, 1, axis=0)[1] if len(table) > 1 else np.full(len(occupancy), np.inf)
    rise = occupancy.differences(others) - occupancy.differences(table.min(axis=0))
    return np.bincount(nearest, weights=rise, minlength=len(shapes)).astype(np.float64)
