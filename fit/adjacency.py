"""Which sides of triangles meet, however many share an edge and wherever vertices lie on it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fit.scene import Float64

Int64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

_MOST_OPEN = 2_000
"""Edges without a partner that are searched for vertices on them; a mesh with more is open."""

_MOST_CROWDED = 20_000
"""Edges of more than two triangles that are untangled."""


def components(count: int, a: Int64, b: Int64) -> Int64:
    links = coo_array((np.ones(len(a), bool), (a, b)), shape=(count, count))
    return connected_components(links, directed=False)[1].astype(np.int64)


def half_edges(triangles: Int64, solid: Bool) -> tuple[Int64, Int64, Int64]:
    """Triangle, first and second vertex of each directed side."""
    rows = np.flatnonzero(solid)
    kept = triangles[rows]
    return np.tile(rows, 3), kept.T.reshape(-1), np.roll(kept, -1, axis=1).T.reshape(-1)


def find_partners(points: Float64, normals: Float64, tri: Int64, start: Int64, end: Int64) -> Int64:
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
    crowded = np.flatnonzero(counts > 2)[:_MOST_CROWDED]
    rows = order[_spans(first[crowded], counts[crowded])]
    there, back = _narrowest_wedges(points, normals[tri[rows]], start[rows], end[rows], counts[crowded])
    for a, b in zip(rows[there].tolist(), rows[back].tolist(), strict=True):
        if partner[a] < 0 and partner[b] < 0:
            partner[a], partner[b] = b, a
    return partner


def _spans(first: Int64, counts: Int64) -> Int64:
    """All rows of spans that start at `first` (s,), one span after the other."""
    before = np.cumsum(counts) - counts
    return np.arange(counts.sum()) + np.repeat(first - before, counts)


def _narrowest_wedges(
    points: Float64, normals: Float64, start: Int64, end: Int64, counts: Int64
) -> tuple[Int64, Int64]:
    """Pairs (w,), (w,) of half-edges there and back along each of the edges that `counts` (c,) half-edges
    (h,) on end share, those of the narrowest wedge of solid first."""
    leader = np.repeat(np.cumsum(counts) - counts, counts)
    axis = points[end[leader]] - points[start[leader]]
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    forward = start == start[leader]
    inward = np.cross(normals, np.where(forward[:, None], axis, -axis))
    size = np.repeat(counts, counts)
    there, back = np.repeat(np.arange(len(size)), size), _spans(leader, size)
    opposite = forward[there] & ~forward[back]
    there, back = there[opposite], back[opposite]
    sine = -np.einsum("wk,wk->w", inward[back], normals[there])
    angle = np.arctan2(sine, np.einsum("wk,wk->w", inward[back], inward[there])) % (2 * np.pi)
    angle[angle <= 1e-6] = 2 * np.pi
    order = np.lexsort((back, there, angle, leader[there]))
    return there[order], back[order]


def split_at_vertices(
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
