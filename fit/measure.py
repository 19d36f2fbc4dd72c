"""How well a primitive set stands in for a surface, seen from the air: every number of the report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist

from fit.primitives import Kind, PrimitiveSet
from fit.sample import random_directions, sample_surface
from fit.scene import Float64
from fit.sdf import gradient, sample_boundary, union_distance
from fit.spaces import Air
from fit.surface import Surface
from fit.trace import first_hits
from fit.volume import Volumes, compare_volumes

Bool = NDArray[np.bool_]

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

HOLE_NEIGHBOURS = 6
"""A hit of a ray is connected to as many nearest ones, as a point of a triangulated surface is."""

_HOLE_DIRECTIONS = 256
"""In which a hole's extreme points are looked for: its diameter is right to half a percent."""


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
    early; hit_error_pct: mean difference of the hits. largest_hole_m: diameter of the widest cluster of hits
    that leak; two hits are connected when one is among the other's six nearest on the mesh, leaking or not,
    so that a hit that the set stops lies between two holes, and a single ray that slips by has no width.
    iou, volume_error: exact; None where the mesh is open.
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
    largest_hole_m: float
    diag_m: float
    iou: float | None
    volume_error: float | None


@dataclass(frozen=True)
class PrimitiveError:
    """What one primitive answers for: `surface_share` of the surface that air touches is nearest to it, at
    these distances; of the free air it fills `false_solid`."""

    kind: str
    surface_share: float
    surface_to_set_mean_m: float
    surface_to_set_max_m: float
    false_solid: float


_OWN_POINTS = 104_729
"""Added to the seed, so that no set is measured where it was fitted."""


@dataclass(frozen=True)
class Probes:
    """Where sets are measured, the same for every set: surface (s, 3), points that air touches; air (a, 3),
    points of the free air, and their distances (a,) to the surface; rays from there along `directions`
    (a, 3), and where they meet the mesh, on_mesh (a,), inf where they don't; diagonal of the surface."""

    surface: Float64
    air: Float64
    air_distance: Float64
    clear: Bool
    directions: Float64
    on_mesh: Float64
    diagonal: float


def place_probes(surface: Surface, air: Air, seed: int = 0) -> Probes:
    """Draws the points and rays of every metric but those that start at the set's own boundary.

    They are others than those that a fit of the same seed looks at.
    """
    seed += _OWN_POINTS
    surface = surface.walls()
    samples = sample_surface(surface, SURFACE_SAMPLES, seed)
    touched = air.touches(samples.points, samples.normals) != 0
    points, distance = air.random_points_and_distances(AIR_POINTS, seed)
    directions = random_directions(len(points), (seed, 1))
    return Probes(
        surface=samples.points[touched],
        air=points,
        air_distance=distance,
        clear=distance >= CLEAR_CELLS * air.cell,
        directions=directions,
        on_mesh=air.rays.first_hit(points, directions)[0],
        diagonal=surface.diagonal,
    )


def measure(
    primitives: PrimitiveSet,
    surface: Surface,
    air: Air,
    *,
    seed: int = 0,
    probes: Probes | None = None,
    metre: float = 1.0,
    volumes: Volumes | None = None,
) -> Metrics:
    """All metrics of a set against the surface it was fitted to.

    `probes`: from `place_probes` of the same surface, air and seed; giving them to several calls saves time.
    `metre`: a metre in the units of the surface, where they are others; `volumes`: where they are known.
    """
    probes = probes or place_probes(surface, air, seed)
    diagonal = probes.diagonal
    boundary, normals = _union_boundary(primitives, air, diagonal, seed)
    to_set = np.minimum(_surface_to_set(primitives, probes, boundary), diagonal)
    to_surface = _set_to_surface(air, boundary, normals)
    false_solid, air_error = _air_errors(primitives, probes)
    leaks, blocked, hit_error, largest_hole = _ray_errors(primitives, probes)
    volumes = volumes or compare_volumes(primitives, air.walls, air)
    return Metrics(
        surface_to_set_mean_m=_mean(to_set),
        surface_to_set_p95_m=float(np.percentile(to_set, 95)) if len(to_set) else 0.0,
        surface_to_set_max_m=float(to_set.max(initial=0.0)),
        covered_25cm=_mean(to_set <= COVERED_METRES * metre, empty=1.0),
        covered_half_pct=_mean(to_set <= COVERED_SHARE * diagonal, empty=1.0),
        set_to_surface_mean_m=_mean(to_surface),
        false_solid=false_solid,
        air_distance_error_m=air_error,
        air_distance_error_pct=100 * air_error / diagonal,
        leaks=leaks,
        blocked=blocked,
        hit_error_pct=hit_error,
        largest_hole_m=largest_hole,
        diag_m=diagonal,
        iou=volumes.iou,
        volume_error=volumes.error,
    )


def measure_each(primitives: PrimitiveSet, probes: Probes) -> tuple[PrimitiveError, ...]:
    """The share of each primitive in the errors of the set, in the set's order."""
    signed, owner = union_distance(primitives, probes.surface)
    clear = probes.air[probes.clear]
    in_air, filler = union_distance(primitives, clear)
    filled = np.bincount(filler[in_air < 0], minlength=len(primitives)) / max(len(clear), 1)
    errors = []
    for i in range(len(primitives)):
        own = np.abs(signed[owner == i])
        errors.append(
            PrimitiveError(
                kind=Kind(primitives.kinds[i]).name.lower(),
                surface_share=len(own) / max(len(signed), 1),
                surface_to_set_mean_m=_mean(own),
                surface_to_set_max_m=float(own.max(initial=0.0)),
                false_solid=float(filled[i]),
            )
        )
    return tuple(errors)


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


def _surface_to_set(primitives: PrimitiveSet, probes: Probes, boundary: Float64) -> Float64:
    """Unsigned distance to the union's boundary of the surface that air touches."""
    points = probes.surface
    signed, index = union_distance(primitives, points)
    distance = np.abs(signed)
    inside = np.flatnonzero(signed < 0)
    if len(inside) and len(boundary):
        # In overlaps the nearest primitive's way out may end within another one. Then the way to the nearest
        # sample of the union's boundary counts, exact to the spacing of the samples.
        way_out = gradient(primitives, points[inside], index[inside])
        leaving = points[inside] - way_out * signed[inside, None]
        covered = inside[union_distance(primitives, leaving)[0] < -1e-9 * probes.diagonal]
        distance[covered] = np.maximum(distance[covered], cKDTree(boundary).query(points[covered])[0])
    return distance


def _set_to_surface(air: Air, boundary: Float64, normals: Float64) -> Float64:
    """Distance to the surface of the points of the union's boundary that air touches."""
    distance = air.tree.nearest(boundary)[0]
    touched = air.is_air(boundary, distance) | np.isin(air.labels_seen(boundary, normals), air.air_labels)
    return distance[touched]


def _air_errors(primitives: PrimitiveSet, probes: Probes) -> tuple[float, float]:
    """Share of clear air points inside the set, and the mean error of the distance there."""
    signed = np.minimum(union_distance(primitives, probes.air[probes.clear])[0], probes.diagonal)
    return _mean(signed < 0), _mean(np.abs(signed - probes.air_distance[probes.clear]))


def _ray_errors(primitives: PrimitiveSet, probes: Probes) -> tuple[float, float, float, float]:
    """Leaks, blocked, the mean error of the hit distance in percent of the diagonal, the largest hole."""
    on_mesh = probes.on_mesh
    on_set = first_hits(primitives, probes.air, probes.directions)
    met = np.isfinite(on_mesh)
    missed = MISSED_SHARE * probes.diagonal
    late, early = on_set > on_mesh + missed, on_mesh > on_set + missed  # inf > inf is False: both miss
    error = np.abs(np.minimum(on_set, probes.diagonal) - np.minimum(on_mesh, probes.diagonal))
    hits = probes.air[met] + on_mesh[met, None] * probes.directions[met]
    hole = _largest_hole(hits, late[met])
    return _mean(late[met]), _mean(early), 100 * _mean(error) / probes.diagonal, hole


def _largest_hole(hits: Float64, leaking: Bool) -> float:
    """Largest diameter of the clusters of leaking hits (p, 3), connected through their nearest neighbours."""
    if np.count_nonzero(leaking) < 2:
        return 0.0
    rows = np.flatnonzero(leaking)
    neighbours = cKDTree(hits).query(hits[rows], k=np.arange(2, min(HOLE_NEIGHBOURS + 2, len(hits) + 1)))[1]
    number = np.full(len(hits), -1)
    number[rows] = np.arange(len(rows))
    ends = number[neighbours]
    start, column = np.nonzero(ends >= 0)
    links = coo_array((np.ones(len(start), bool), (start, ends[start, column])), shape=(len(rows),) * 2)
    _, cluster = connected_components(links, directed=False)
    order = np.argsort(cluster, kind="stable")
    clusters = np.split(rows[order], np.flatnonzero(np.diff(cluster[order])) + 1)
    return max(_diameter(hits[members]) for members in clusters)


def _diameter(points: Float64) -> float:
    """Largest distance between two of the points (p, 3), among those that are extreme in some direction."""
    if len(points) > _HOLE_DIRECTIONS:
        height = (np.arange(_HOLE_DIRECTIONS) + 0.5) / _HOLE_DIRECTIONS
        angle = np.pi * (1 + np.sqrt(5)) * np.arange(_HOLE_DIRECTIONS)  # Vogel's spiral over half a sphere
        across = np.sqrt(1 - height**2)
        along = points @ np.stack([across * np.cos(angle), across * np.sin(angle), height])
        points = points[np.unique([along.argmin(axis=0), along.argmax(axis=0)])]
    return float(pdist(points).max(initial=0.0))


def _mean(values: Float64 | Bool, empty: float = 0.0) -> float:
    return float(np.mean(values)) if len(values) else empty
