"""Closed-form fits of one box, sphere or cylinder to a piece of mesh, and whether the mesh *is* it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.primitives import Kind
from fit.scene import Float64
from fit.shapes import Shapes, distances_to_one, join, make_shapes, no_shapes, right_handed

_ON_BOX, _ON_ROUND = 4e-4, 4e-3
"""Of the size: how far a vertex of an exact primitive may lie off it: files keep 12 bits, some 8."""

_AREA_OF_BOX, _AREA_OF_ROUND = 0.01, 0.12
"""Missing or surplus area of an exact primitive; a tessellated round one has less (8 segments: 10 %)."""

_SAGITTA = 0.08
"""Of the radius: how far a chord of an exact round primitive may lie inside it (8 segments: 7.6 %)."""

_PARALLEL = 0.999

_EDGES_TRIED = 32


@dataclass(frozen=True)
class Piece:
    """Triangles of one part: corners (t, 3, 3), unit normals (t, 3), areas (t,)."""

    corners: Float64
    normals: Float64
    areas: Float64

    @property
    def vertices(self) -> Float64:
        return self.corners.reshape(-1, 3)


def closed_forms(piece: Piece) -> Shapes:
    """Every closed-form candidate: boxes in two frames, a sphere, a cylinder about each principal axis."""
    frames = [np.eye(3), normal_frame(piece)]
    found = [box_around(piece.vertices, frame) for frame in frames]
    found.append(fit_sphere(piece))
    found += [fit_cylinder(piece, axis) for axis in principal_normals(piece).T]
    return join(found)


def recognize(piece: Piece) -> Shapes:
    """The primitive that the piece is (one shape, marked exact), or no shape.

    It is one when all vertices lie on it, all faces lie along it, and the areas agree: so nothing of it is
    missing. Vertices, not faces, give the radius: tessellation puts them on the round surface.
    """
    candidates = closed_forms(piece)
    for i in range(len(candidates)):
        if _is_exact(candidates, i, piece):
            one = candidates.select(np.array([i]))
            return make_shapes(Kind(one.kinds[0]), one.centers, one.frames[0], one.halves, exact=True)
    return no_shapes()


def _is_exact(candidates: Shapes, which: int, piece: Piece) -> bool:
    kind, halves = Kind(candidates.kinds[which]), candidates.halves[which]
    if halves.min() <= 1e-3 * halves.max():
        return False
    size = float(np.linalg.norm(halves))
    off = (_ON_BOX if kind is Kind.BOX else _ON_ROUND) * size
    if np.abs(distances_to_one(candidates, which, piece.vertices)).max() > off:
        return False
    middles = np.abs(distances_to_one(candidates, which, piece.corners.mean(axis=1)))
    sagitta = off if kind is Kind.BOX else _SAGITTA * halves[0]
    tolerance = _AREA_OF_BOX if kind is Kind.BOX else _AREA_OF_ROUND
    ratio = piece.areas.sum() / boundary_area(kind, halves)
    return bool(middles.max() <= sagitta and 1 - tolerance <= ratio <= 1 + _AREA_OF_BOX)


def boundary_area(kind: Kind, halves: Float64) -> float:
    """Surface area of one shape of half extents (3,)."""
    x, y, z = halves
    if kind is Kind.BOX:
        return float(8 * (x * y + y * z + z * x))
    return float(4 * np.pi * x * x if kind is Kind.SPHERE else 2 * np.pi * x * (x + 2 * y))


# -------------------------------------------------------------------------------------------------- box


def box_around(points: Float64, frame: Float64) -> Shapes:
    """The box of a frame (3, 3) that holds all points (p, 3); a flat one gets a thousandth of its size."""
    local = points @ frame
    lower, upper = local.min(axis=0), local.max(axis=0)
    halves = (upper - lower) / 2
    halves = np.maximum(halves, 1e-3 * max(float(halves.max()), np.finfo(float).tiny))
    return make_shapes(Kind.BOX, ((lower + upper) / 2 @ frame.T)[None], frame, halves[None])


def normal_frame(piece: Piece) -> Float64:
    """Frame (3, 3) of the two heaviest face directions, a wall's and that of the walls across it."""
    rounded = np.rint(piece.normals * 256)
    rounded *= np.where(_leading_sign(rounded) < 0, -1, 1)[:, None]
    directions, group = np.unique(rounded, axis=0, return_inverse=True)
    weights = np.bincount(group.ravel(), weights=piece.areas)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    first = _mean_direction(piece, directions[np.argmax(weights)])
    across = np.abs(directions @ first) < 0.02
    if across.any():
        second = _mean_direction(piece, directions[across][np.argmax(weights[across])])
    else:
        second = _tightest_edge(piece, first)
    return right_handed(np.stack([first, second], axis=1))


def _tightest_edge(piece: Piece, normal: Float64) -> Float64:
    """Among the longest edges across `normal`, the one along which the bounding rectangle is smallest.

    The smallest rectangle around a convex polygon shares an edge with it (Freeman and Shapira 1975).
    """
    edges = (piece.corners - np.roll(piece.corners, 1, axis=1)).reshape(-1, 3)
    edges -= np.outer(edges @ normal, normal)
    lengths = np.linalg.norm(edges, axis=1)
    longest = np.argsort(-lengths, kind="stable")[:_EDGES_TRIED]
    longest = longest[lengths[longest] > 0]
    if len(longest) == 0:
        return np.eye(3)[np.argmin(np.abs(normal))]
    along = edges[longest] / lengths[longest, None]
    rectangles = np.ptp(piece.vertices @ along.T, axis=0) * np.ptp(
        piece.vertices @ np.cross(normal, along).T, axis=0
    )
    return along[int(np.argmin(rectangles))]


def _leading_sign(vectors: Float64) -> Float64:
    """Sign of each vector's largest component, ties to the first."""
    return np.sign(vectors[np.arange(len(vectors)), np.abs(vectors).argmax(axis=1)])


def _mean_direction(piece: Piece, direction: Float64) -> Float64:
    along = piece.normals @ direction
    near = np.abs(along) > _PARALLEL
    mean = (piece.normals[near] * (np.sign(along[near]) * piece.areas[near])[:, None]).sum(axis=0)
    length = np.linalg.norm(mean)
    return mean / length if length > 0 else direction


# ------------------------------------------------------------------------------------------ round shapes


def fit_sphere(piece: Piece) -> Shapes:
    """Least squares of |x|^2 = 2 c.x + k over the vertices: linear, and exact on an exact sphere."""
    points, center, scale = _normalized(piece.vertices)
    system = np.column_stack([2 * points, np.ones(len(points))])
    solution = np.linalg.lstsq(system, np.einsum("pk,pk->p", points, points), rcond=None)[0]
    radius = np.sqrt(max(solution[3] + solution[:3] @ solution[:3], 1e-12))
    if not np.isfinite(radius) or radius > 4:
        return no_shapes()
    return make_shapes(
        Kind.SPHERE, (center + scale * solution[:3])[None], np.eye(3), np.full((1, 3), scale * radius)
    )


def fit_cylinder(piece: Piece, axis: Float64) -> Shapes:
    """Circle by least squares over the vertices of the faces along the axis (3,), height by all vertices."""
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    frame = right_handed(np.stack([helper - axis * (helper @ axis), axis], axis=1))
    side = np.abs(piece.normals @ axis) < 0.2
    if piece.areas[side].sum() < 0.2 * piece.areas.sum():
        return no_shapes()
    points, center, scale = _normalized(piece.vertices)
    local = points @ frame
    around = local.reshape(-1, 3, 3)[side].reshape(-1, 3)[:, [0, 2]]
    system = np.column_stack([2 * around, np.ones(len(around))])
    solution, _, rank, _ = np.linalg.lstsq(system, np.einsum("pk,pk->p", around, around), rcond=1e-9)
    radius = np.sqrt(max(solution[2] + solution[:2] @ solution[:2], 1e-12))
    if rank < 3 or not np.isfinite(radius) or radius > 2:
        return no_shapes()
    low, high = local[:, 1].min(), local[:, 1].max()
    middle = frame @ np.array([solution[0], (low + high) / 2, solution[1]])
    halves = np.array([[radius, max((high - low) / 2, 1e-3 * radius), radius]])
    return make_shapes(Kind.CYLINDER, (center + scale * middle)[None], frame, scale * halves)


def principal_normals(piece: Piece) -> Float64:
    """Axes (3, 3), columns: a cylinder's axis is among the eigenvectors of the normals' covariance."""
    covariance = np.einsum("t,ti,tj->ij", piece.areas / piece.areas.sum(), piece.normals, piece.normals)
    axes = np.linalg.eigh(covariance)[1]
    return axes * _leading_sign(axes.T)


def _normalized(points: Float64) -> tuple[Float64, Float64, float]:
    """Points about their centre in units of their size, the centre and the size."""
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    scale = max(float(np.abs(points - center).max()), np.finfo(float).tiny)
    return (points - center) / scale, center, scale
