"""How well a primitive set stands in for a surface, seen from the air: every number of the report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fit.primitives import PrimitiveSet
from fit.sample import sample_surface
from fit.scene import Float64
from fit.sdf import gradient, sample_boundary, union_distance
from fit.spaces import Air
from fit.surface import Surface
from fit.trace import first_hits
from fit.volume import compare_volumes

SURFACE_SAMPLES = 20_000
BOUNDARY_SAMPLES = 40_000
AIR_POINTS = 20_000
COVERED_METRES = 0.25
COVERED_SHARE = 0.005
"""Of the diagonal."""

CLEAR_CELLS = 1.4
"""Air points nearer to the surface than this say more of the grid than of the set."""

MISSED_SHARE = 0.01
"""Of the diagonal: from this difference on, a hit is a leak or a ray blocked."""


@dataclass(frozen=True)
class Metrics:
    """The report's figures; lengths in metres, shares from 0 to 1, `_pct` in percent of the diagonal.

    A perfect set has 0 in all but the two `covered`, which are 1, and `iou`, 1. Distances, and rays that hit
    nothing, count as at most one diagonal.
    surface_to_set_*: distance of the surface that air touches to the boundary of the set's union: mean, 95th
    percentile, largest; covered_25cm, covered_half_pct: share of it within 25 cm, within 0.5 % of the
    diagonal. set_to_surface_mean_m: distance of the union's boundary, where air touches it, to the surface.
    false_solid: share of the free air, 1.4 cells off the surface, that the set fills. air_distance_error:
    mean difference of the set's distance there and the surface's. leaks: share of the first hits of random
    rays that the set lets pass by over 1 % of the diagonal; blocked: share of rays that it stops as much too
    early; hit_error_pct: mean difference of the hits. iou, volume_error: exact; None where the mesh is open.
    """

    surface_to_set_mean_m: float
    surface_to_set_p95_m: float
    surface_to_set_max_m: float
    covered_25cm: float
    covered_half_pct: float
    set_to_surface_mean_m: float
    false_solid: float
    air_distance_error_m: float
    air_distance_error_pct: float
    leaks: float
    blocked: float
    hit_error_pct: float
    diag_m: float
    iou: float | None
    volume_error: float | None


def measure(primitives: PrimitiveSet, surface: Surface, air: Air, *, seed: int = 0) -> Metrics:
    """All metrics of a set against the surface it was fitted to, at the same points for every set."""
    diagonal = surface.diagonal
    boundary, normals = _union_boundary(primitives, air, diagonal, seed)
    to_set = np.minimum(_surface_to_set(primitives, surface, air, boundary, seed), diagonal)
    to_surface = _set_to_surface(air, boundary, normals)
    points, free_distance = air.random_points_and_distances(AIR_POINTS, seed)
    false_solid, air_error = _air_errors(primitives, air, points, free_distance, diagonal)
    leaks, blocked, hit_error = _ray_errors(primitives, air, points, diagonal, seed)
    volumes = compare_volumes(primitives, air.walls, air)
    return Metrics(
        surface_to_set_mean_m=_mean(to_set),
        surface_to_set_p95_m=float(np.percentile(to_set, 95)) if len(to_set) else 0.0,
        surface_to_set_max_m=float(to_set.max(initial=0.0)),
        covered_25cm=_mean(to_set <= COVERED_METRES, empty=1.0),
        covered_half_pct=_mean(to_set <= COVERED_SHARE * diagonal, empty=1.0),
        set_to_surface_mean_m=_mean(to_surface),
        false_solid=false_solid,
        air_distance_error_m=air_error,
        air_distance_error_pct=100 * air_error / diagonal,
        leaks=leaks,
        blocked=blocked,
        hit_error_pct=hit_error,
        diag_m=diagonal,
        iou=volumes.iou,
        volume_error=volumes.error,
    )


def _union_boundary(
    primitives: PrimitiveSet, air: Air, diagonal: float, seed: int
) -> tuple[Float64, Float64]:
    """Points and outward normals on the union's boundary; of half-spaces only what lies in the grid."""
    if len(primitives) == 0:
        return np.zeros((0, 3)), np.zeros((0, 3))
    points, normals, index = sample_boundary(primitives, BOUNDARY_SAMPLES, seed, half_space_size=2 * diagonal)
    exposed = union_distance(primitives, points)[0] > -1e-9 * diagonal
    exposed &= ~primitives.is_half_space[index] | air.grid.holds(air.grid.cells_of(points))
    return points[exposed], normals[exposed]


def _surface_to_set(
    primitives: PrimitiveSet, surface: Surface, air: Air, boundary: Float64, seed: int
) -> Float64:
    """Unsigned distance to the union's boundary of the surface samples that air touches."""
    samples = sample_surface(surface, SURFACE_SAMPLES, seed)
    points = samples.points[air.touches(samples.points, samples.normals) != 0]
    signed, index = union_distance(primitives, points)
    distance = np.abs(signed)
    inside = np.flatnonzero(signed < 0)
    if len(inside) and len(boundary):
        # In overlaps the nearest primitive's way out may end within another one. Then the way to the nearest
        # sample of the union's boundary counts, exact to the spacing of the samples.
        way_out = gradient(primitives, points[inside], index[inside])
        leaving = points[inside] - way_out * signed[inside, None]
        covered = inside[union_distance(primitives, leaving)[0] < -1e-9 * surface.diagonal]
        distance[covered] = np.maximum(distance[covered], cKDTree(boundary).query(points[covered])[0])
    return distance


def _set_to_surface(air: Air, boundary: Float64, normals: Float64) -> Float64:
    """Distance to the surface of the points of the union's boundary that air touches."""
    distance = air.tree.nearest(boundary)[0]
    touched = air.is_air(boundary, distance) | np.isin(air.labels_seen(boundary, normals), air.air_labels)
    return distance[touched]


def _air_errors(
    primitives: PrimitiveSet, air: Air, points: Float64, free_distance: Float64, diagonal: float
) -> tuple[float, float]:
    """Share of clear air points inside the set, and the mean error of the distance there."""
    clear = free_distance >= CLEAR_CELLS * air.cell
    signed = np.minimum(union_distance(primitives, points[clear])[0], diagonal)
    return _mean(signed < 0), _mean(np.abs(signed - free_distance[clear]))


def _ray_errors(
    primitives: PrimitiveSet, air: Air, points: Float64, diagonal: float, seed: int
) -> tuple[float, float, float]:
    """Leaks, blocked, and the mean error of the hit distance in percent of the diagonal."""
    directions = np.random.default_rng((seed, 1)).normal(size=points.shape)
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    on_mesh = air.rays.first_hit(points, directions)[0]
    on_set = first_hits(primitives, points, directions)
    met = np.isfinite(on_mesh)
    missed = MISSED_SHARE * diagonal
    with np.errstate(invalid="ignore"):  # inf - inf: neither is hit
        late, early = on_set - on_mesh > missed, on_mesh - on_set > missed
    error = np.abs(np.minimum(on_set, diagonal) - np.minimum(on_mesh, diagonal))
    return _mean(late[met]), _mean(early), 100 * _mean(error) / diagonal


def _mean(values: Float64 | NDArray[np.bool_], empty: float = 0.0) -> float:
    return float(np.mean(values)) if len(values) else empty
