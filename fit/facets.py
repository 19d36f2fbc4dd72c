"""The faces of closed shells as a polyhedron has them: coplanar triangles are one facet, with straight edges.

In a union of convex solids, two faces of the same solid meet in a convex edge and faces of different solids
in a concave one. So facets that hang together by convex edges, a *patch*, belong to one primitive.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fit.scene import Float64

Int64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

_SLIVER = 100
"""Times the tolerance: a triangle of less height has no direction of its own and joins another's facet."""

_NARROW = 0.005
"""Radians: a facet whose normal may be off by more has no direction of its own."""

_SHORT = 20
"""Times the tolerance: edges of less length link no facets."""

_MOST_OPEN = 2_000
"""Edges without a partner that are searched for vertices on them; a mesh with more is open."""

_MOST_CROWDED = 20_000
"""Edges of more than two triangles that are untangled."""


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
    tri, start, end = _half_edges(triangles, solid)
    partner = _partners(points, normals, tri, start, end)
    if (partner < 0).any():
        tri, start, end = _split_at_vertices(points, tri, start, end, partner, tolerance)
        partner = _partners(points, normals, tri, start, end)
    shell = _components(len(triangles), tri, np.where(partner >= 0, tri[partner], tri))
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
        cluster = _components(len(points), pairs[:, 0], pairs[:, 1])
        first = np.unique(cluster, return_index=True)[1]
        points, index = points[first], cluster[index]
    return points, index.reshape(-1, 3).astype(np.int64)


def _components(count: int, a: Int64, b: Int64) -> Int64:
    links = coo_array((np.ones(len(a), bool), (a, b)), shape=(count, count))
    return connected_components(links, directed=False)[1].astype(np.int64)


def _measure(corners: Float64) -> tuple[Float64, Float64, Float64]:
    """Unit normals (t, 3), areas (t,) and least heights (t,) of triangles."""
    edges = corners - np.roll(corners, 1, axis=1)
    cross = np.cross(edges[:, 1], edges[:, 2])
    double = np.linalg.norm(cross, axis=1)
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    tiny = np.finfo(float).tiny
    return cross / np.maximum(double, tiny)[:, None], double / 2, double / np.maximum(longest, tiny)


# ----------------------------------------------------------------------------------------------- adjacency


def _half_edges(triangles: Int64, solid: Bool) -> tuple[Int64, Int64, Int64]:
    """Triangle, first and second vertex of each directed side."""
    rows = np.flatnonzero(solid)
    kept = triangles[rows]
    return np.tile(rows, 3), kept.T.reshape(-1), np.roll(kept, -1, axis=1).T.reshape(-1)


def _partners(points: Float64, normals: Float64, tri: Int64, start: Int64, end: Int64) -> Int64:
    """The half-edge (h,) across each edge, -1 where there is none.

    Where more than two triangles share an edge, those are partners that bound the narrowest wedge of solid:
    so boxes that touch along an edge or a face stay two.
    """
    low, high = np.minimum(start, end), np.maximum(start, end)
    order = np.lexsort((high, low))
    new = np.ones(len(order), bool)
    new[1:] = (low[order][1:] != low[order][:-1]) | (high[order][1:] != high[order][:-1])
    first = np.flatnonzero(new)
    counts = np.diff(np.append(first, len(order)))
    partner = np.full(len(tri), -1)
    a, b = order[first[counts == 2]], order[first[counts == 2] + 1]
    opposite = start[a] == end[b]
    partner[a[opposite]], partner[b[opposite]] = b[opposite], a[opposite]
    for k in np.flatnonzero(counts > 2)[:_MOST_CROWDED]:
        crowd = order[first[k] : first[k] + counts[k]]
        _untangle(points, normals, tri, start, end, crowd, partner)
    return partner


def _untangle(
    points: Float64, normals: Float64, tri: Int64, start: Int64, end: Int64, group: Int64, partner: Int64
) -> None:
    """Pairs the half-edges of one crowded edge, narrowest wedges of solid first."""
    axis = points[end[group[0]]] - points[start[group[0]]]
    axis /= np.linalg.norm(axis)
    forward = start[group] == start[group[0]]
    inward = np.cross(normals[tri[group]], np.where(forward[:, None], axis, -axis))
    wedges = []
    for i in np.flatnonzero(forward):
        for j in np.flatnonzero(~forward):
            angle = np.arctan2(-inward[j] @ normals[tri[group[i]]], inward[j] @ inward[i]) % (2 * np.pi)
            wedges.append((angle if angle > 1e-6 else 2 * np.pi, int(group[i]), int(group[j])))
    for _, there, back in sorted(wedges):
        if partner[there] < 0 and partner[back] < 0:
            partner[there], partner[back] = back, there


def _split_at_vertices(
    points: Float64, tri: Int64, start: Int64, end: Int64, partner: Int64, tolerance: float
) -> tuple[Int64, Int64, Int64]:
    """Half-edges without a partner are cut at the vertices of others that lie on them (T-junctions)."""
    rows = np.flatnonzero(partner < 0)
    if len(rows) > _MOST_OPEN:
        return tri, start, end
    loose = np.unique(np.concatenate([start[rows], end[rows]]))
    kept = np.ones(len(tri), bool)
    pieces: list[tuple[int, int, int]] = []
    for row in rows:
        origin, along = points[start[row]], points[end[row]] - points[start[row]]
        length = float(np.linalg.norm(along))
        offset = points[loose] - origin
        place = offset @ along / length
        beside = np.linalg.norm(offset - np.outer(place, along / length), axis=1)
        on = (beside <= 2 * tolerance) & (place > 0) & (place < length)
        on &= (loose != start[row]) & (loose != end[row])
        if on.any():
            kept[row] = False
            chain = [
                int(start[row]),
                *loose[on][np.argsort(place[on], kind="stable")].tolist(),
                int(end[row]),
            ]
            pieces += [(int(tri[row]), u, v) for u, v in pairwise(chain)]
    if not pieces:
        return tri, start, end
    added = np.array(pieces, np.int64).T
    whole = np.stack([tri, start, end])[:, kept]
    joined = np.concatenate([whole, added], axis=1)
    return joined[0], joined[1], joined[2]


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
    facet = _components(len(triangles), plane[both], other[both])
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
    return _components(len(facets), plane[joins], other[joins])


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
    return _components(len(facets), facets.pair[linked, 0], facets.pair[linked, 1])
