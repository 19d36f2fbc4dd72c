"""The faces of closed shells as a polyhedron has them: coplanar triangles are one facet, with straight edges.

In a union of convex solids, two faces of the same solid meet in a convex edge and faces of different solids
in a concave one. So facets that hang together by convex edges, a *patch*, belong to one primitive.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fit.adjacency import components, find_partners, half_edges, split_at_vertices
from fit.scene import Float64

Int64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

_SLIVER = 100
"""Times the tolerance: a triangle of less height has no direction of its own and joins another's facet."""

_NARROW = 0.005
"""Radians: a facet whose normal may be off by more has no direction of its own."""

_SHORT = 20
"""Times the tolerance: edges of less length link no facets."""


@dataclass(frozen=True)
class Facets:
    """f facets of the closed shells in t triangles.

    points (p, 3), triangles (t, 3): the welded mesh. of_triangle (t,): facet of each triangle, -1 on open
    shells; shell (t,): its shell. normals, centers (f, 3); offsets (f,): normal . x on the facet; areas (f,);
    widths (f,): greatest height of its triangles, which tells how exact its normal is.
    pair (e, 2): facets on both sides of an edge; edge_vertices (e, 2): its ends, counter-clockwise around the
    first;
    angles (e,): between the normals, positive where the edge is convex.
    """

    points: Float64
    triangles: Int64
    of_triangle: Int64
    shell: Int64
    normals: Float64
    centers: Float64
    offsets: Float64
    areas: Float64
    widths: Float64
    pair: Int64
    edge_vertices: Int64
    angles: Float64
    tolerance: float

    def __len__(self) -> int:
        return len(self.areas)

    def slack(self) -> Float64:
        """How far (f,) a facet's normal may be off, radians."""
        return np.minimum(4 * self.tolerance / np.maximum(self.widths, 1e-300) + 1e-6, 1.0)

    def is_concave(self) -> Bool:
        """Which edges (e,) are clearly concave."""
        return self.angles < -self.slack()[self.pair].sum(axis=1)


def find_facets(corners: Float64, tolerance: float) -> Facets:
    """Facets of the closed shells among triangles (t, 3, 3); positions may be off by `tolerance`."""
    points, triangles = weld(corners, tolerance)
    normals, areas, heights = _measure(points[triangles])
    # A triangle that welding or rounding flattened bounds nothing; its neighbours then meet in T-junctions.
    solid = heights > tolerance
    tri, start, end = half_edges(triangles, solid)
    partner = find_partners(points, normals, tri, start, end)
    if (partner < 0).any():
        tri, start, end = split_at_vertices(points, tri, start, end, partner, tolerance)
        partner = find_partners(points, normals, tri, start, end)
    shell = components(len(triangles), tri, np.where(partner >= 0, tri[partner], tri))
    is_open = np.bincount(shell, weights=np.bincount(tri, partner < 0, len(triangles))) > 0
    closed = solid & ~is_open[shell]
    rows = np.flatnonzero((partner > np.arange(len(partner))) & closed[tri])
    sides = np.stack([tri[rows], tri[partner[rows]]], axis=1)
    of_triangle = _merge_flat(points, triangles, normals, heights, sides, closed, tolerance)
    ends = np.stack([start[rows], end[rows]], axis=1)
    while True:
        facets = _assemble(points, triangles, of_triangle, shell, areas, heights, sides, ends, tolerance)
        joined = _join_level(facets)
        if joined.max(initial=-1) + 1 == len(facets):
            return facets
        of_triangle = np.where(of_triangle >= 0, joined[of_triangle], -1)


def weld(corners: Float64, tolerance: float) -> tuple[Float64, Int64]:
    """Distinct points (p, 3) and triangles (t, 3) of a soup (t, 3, 3); points within `tolerance` are one."""
    points, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    pairs = cKDTree(points).query_pairs(tolerance, output_type="ndarray")
    if len(pairs):
        cluster = components(len(points), pairs[:, 0], pairs[:, 1])
        first = np.unique(cluster, return_index=True)[1]
        points, index = points[first], cluster[index]
    return points, index.reshape(-1, 3).astype(np.int64)


def _measure(corners: Float64) -> tuple[Float64, Float64, Float64]:
    """Unit normals (t, 3), areas (t,) and least heights (t,) of triangles."""
    edges = corners - np.roll(corners, 1, axis=1)
    cross = np.cross(edges[:, 1], edges[:, 2])
    double = np.linalg.norm(cross, axis=1)
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    tiny = np.finfo(float).tiny
    return cross / np.maximum(double, tiny)[:, None], double / 2, double / np.maximum(longest, tiny)


# ------------------------------------------------------------------------------------------------- facets


def _merge_flat(
    points: Float64, triangles: Int64, normals: Float64, heights: Float64, sides: Int64, closed: Bool,
    tolerance: float,
) -> Int64:  # fmt: skip
    """Facet of each triangle (t,), -1 where not closed. Slivers join after the others, one neighbour each."""
    broad = heights > _SLIVER * tolerance
    reach = 3 * tolerance

    def off(plane: Int64, other: Int64) -> Float64:
        """Greatest distance of the other triangle's corners from the plane of the first."""
        corners = points[triangles[other]] - points[triangles[plane, 0]][:, None]
        return np.abs(np.einsum("eck,ek->ec", corners, normals[plane])).max(axis=1)

    wider = np.where(heights[sides[:, 0]] >= heights[sides[:, 1]], 0, 1)
    rows = np.arange(len(sides))
    plane, other = sides[rows, wider], sides[rows, 1 - wider]
    aligned = np.einsum("ek,ek->e", normals[plane], normals[other]) > 0
    flat = (off(plane, other) <= reach) & (aligned | ~broad[other])
    both = flat & broad[plane] & broad[other]
    facet = components(len(triangles), plane[both], other[both])
    waiting = np.flatnonzero(flat & ~broad[other])
    settled = broad.copy()
    while True:  # slivers take the facet of a settled neighbour, wave by wave
        ready = waiting[settled[plane[waiting]] & ~settled[other[waiting]]]
        if len(ready) == 0:
            break
        facet[other[ready]] = facet[plane[ready]]
        settled[other[ready]] = True
    facet[~closed] = -1
    number = np.unique(facet, return_inverse=True)[1].astype(np.int64)
    return number - 1 if (facet < 0).any() else number


def _join_level(facets: Facets) -> Int64:
    """New number of each facet (f,): neighbours that share a plane, but met in triangles too thin to tell.

    A facet too narrow to have a direction joins one neighbour only, lest it should tie two planes together.
    """
    pair, size = facets.pair, facets.areas[facets.pair]
    wide = np.where(size[:, 0] >= size[:, 1], 0, 1)
    rows = np.arange(len(pair))
    plane, other = pair[rows, wide], pair[rows, 1 - wide]
    off = np.einsum("ek,ek->e", facets.centers[other], facets.normals[plane]) - facets.offsets[plane]
    slack = facets.slack()
    flat = np.abs(facets.angles) <= slack[pair].sum(axis=1)
    flat &= np.abs(off) <= 3 * facets.tolerance
    narrow = slack > _NARROW
    joins = np.flatnonzero(flat & ~narrow[pair].any(axis=1))
    single = np.flatnonzero(flat & narrow[other])
    single = single[np.unique(other[single], return_index=True)[1]]
    joins = np.concatenate([joins, single])
    return components(len(facets), plane[joins], other[joins])


def _assemble(
    points: Float64, triangles: Int64, of_triangle: Int64, shell: Int64, areas: Float64, heights: Float64,
    sides: Int64, ends: Int64, tolerance: float,
) -> Facets:  # fmt: skip
    rows = np.flatnonzero(of_triangle >= 0)
    count = int(of_triangle.max(initial=-1)) + 1
    facet, corners = of_triangle[rows], points[triangles[rows]]
    vectors = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    total = np.stack([np.bincount(facet, vectors[:, k], count) for k in range(3)], axis=1)
    normals = total / np.maximum(np.linalg.norm(total, axis=1), np.finfo(float).tiny)[:, None]
    area = np.bincount(facet, areas[rows], count).astype(np.float64)
    weight = areas[rows] / np.maximum(area, np.finfo(float).tiny)[facet]
    middles = corners.mean(axis=1) * weight[:, None]
    centers = np.stack([np.bincount(facet, middles[:, k], count) for k in range(3)], axis=1).astype(float)
    offsets = np.einsum("fk,fk->f", centers, normals)
    widths = np.zeros(count)
    np.maximum.at(widths, facet, heights[rows])
    pair = of_triangle[sides]
    real = pair[:, 0] != pair[:, 1]
    pair, ends = pair[real], ends[real]
    along = points[ends[:, 1]] - points[ends[:, 0]]
    along /= np.maximum(np.linalg.norm(along, axis=1), np.finfo(float).tiny)[:, None]
    first, second = normals[pair[:, 0]], normals[pair[:, 1]]
    sine = np.einsum("ek,ek->e", np.cross(first, second), along)
    angles = np.arctan2(sine, np.einsum("ek,ek->e", first, second))
    return Facets(
        points, triangles, of_triangle, shell, normals, centers, offsets, area, widths,
        pair, ends, angles, tolerance,
    )  # fmt: skip


def find_patches(facets: Facets, admitted: Bool | None = None) -> Int64:
    """Patch of each facet (f,): facets that hang together by clearly convex edges, or those `admitted` (e,).

    Rounding turns edges of its own length any way.
    """
    slack = facets.slack()[facets.pair]
    ends = facets.points[facets.edge_vertices]
    certain = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > _SHORT * facets.tolerance
    linked = certain & (facets.angles > slack.sum(axis=1))
    if admitted is not None:
        linked &= admitted
    return components(len(facets), facets.pair[linked, 0], facets.pair[linked, 1])
