"""The fitter's working form of primitives: solid boxes, spheres and cylinders without colour.

A plane is a thin box until the set is written out, so three distance functions are all that is optimised.
Every function takes *pairs*: shape `index[i]` seen from point `i`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from fit.primitives import PLANE_THICKNESS_LIMIT, Kind, PrimitiveSet
from fit.rotation import quaternions_from_matrices
from fit.scene import Float64

Index = NDArray[np.integer]

KINDS = tuple(kind.name.lower() for kind in Kind)

_SPHERE, _CYLINDER = Kind.SPHERE.value, Kind.CYLINDER.value
"""Looked up once: a member of an enumeration takes a microsecond."""

PARAMETERS = 9
"""Of one shape: centre (3), rotation vector (3), half extents (3)."""


@dataclass(frozen=True)
class Shapes:
    """n solids: kinds (n,) `Kind` (no planes), centers (n, 3), frames (n, 3, 3) world from local,
    halves (n, 3) half extents: box (x, y, z), sphere (r, r, r), cylinder (r, half height, r);
    exact (n,) bool: True where the mesh *is* this primitive, so that nothing is left to refine."""

    kinds: NDArray[np.uint8]
    centers: Float64
    frames: Float64
    halves: Float64
    exact: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.kinds)

    def select(self, index: NDArray[np.generic] | slice) -> Shapes:
        return Shapes(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    def volumes(self) -> Float64:
        box = 8 * np.prod(self.halves, axis=1)
        return box * np.array([1.0, np.pi / 6, np.pi / 4])[self.kinds]


def no_shapes() -> Shapes:
    return Shapes(
        np.zeros(0, np.uint8), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros(0, bool)
    )


def make_shapes(
    kind: Kind, centers: Float64, frames: Float64, halves: Float64, exact: bool = False
) -> Shapes:
    """Shapes of one kind; `frames` and `halves` broadcast over the n `centers`."""
    count = len(centers)
    return Shapes(
        np.full(count, kind, np.uint8),
        np.array(centers, np.float64),
        np.array(np.broadcast_to(frames, (count, 3, 3)), np.float64),
        np.array(np.broadcast_to(halves, (count, 3)), np.float64),
        np.full(count, exact),
    )


def join(several: Sequence[Shapes]) -> Shapes:
    several = [no_shapes(), *several]
    return Shapes(**{f.name: np.concatenate([getattr(s, f.name) for s in several]) for f in fields(Shapes)})


# -------------------------------------------------------------------------------------------- distance


_BLOCK = 4096
"""Points at a time: their temporaries stay in the cache, and in memory that need not be asked for anew."""


def _blocks(count: int) -> Iterator[slice]:
    return (slice(start, start + _BLOCK) for start in range(0, count, _BLOCK))


def pair_distances(shapes: Shapes, points: Float64, index: Index) -> Float64:
    """Exact signed distance (p,) from point i (p, 3) to shape `index[i]`."""
    distances = np.empty(len(points))
    for block in _blocks(len(points)):
        own = index[block]
        local = _local(_turns(shapes, own), shapes, points[block], own)
        distances[block] = _signed(_excess(shapes.kinds[own], local, shapes, own))
    return distances


def distances_to_one(shapes: Shapes, which: int, points: Float64) -> Float64:
    """Exact signed distance (p,) from all points to one shape."""
    kind, halves, turn = shapes.kinds[which], shapes.halves[which][:, None], shapes.frames[which].T
    distances = np.empty(len(points))
    for block in _blocks(len(points)):
        local = turn @ (points[block] - shapes.centers[which]).T
        if kind == _SPHERE:
            distances[block] = np.sqrt(_sum(local * local)) - halves[0]
            continue
        if kind == _CYLINDER:
            np.sqrt(local[0] * local[0] + local[2] * local[2], out=local[0])
            local = local[:2]
        np.abs(local, out=local)
        local -= halves[: len(local)]
        distances[block] = _signed(local)
    return distances


def pair_derivatives(shapes: Shapes, points: Float64, index: Index) -> Float64:
    """Derivative (9, p) of the signed distance of each pair by the parameters of its shape.

    With l = R^T (x - c) and g = dd/dl: dd/dc = -R g; a small rotation w in the local frame moves l by
    -w x l, so dd/dw = g x l; a half extent acts against the excess that carries the distance.
    """
    derivative = np.empty((PARAMETERS, len(points)))
    for block in _blocks(len(points)):
        derivative[:, block] = _derivatives(shapes, points[block], index[block])
    return derivative


def _derivatives(shapes: Shapes, points: Float64, index: Index) -> Float64:
    kinds, turns = shapes.kinds[index], _turns(shapes, index)
    local = _local(turns, shapes, points, index)
    excess = _excess(kinds, local, shapes, index)
    slope = np.maximum(excess, 0.0)
    outside = np.sqrt(_sum(slope * slope))
    inside = np.flatnonzero(outside == 0)
    outside[inside] = 1.0
    slope /= outside
    slope[excess[:, inside].argmax(axis=0), inside] = 1.0
    gradient = _local_gradient(kinds, local, slope)
    derivative = np.empty((PARAMETERS, len(points)))
    derivative[0:3] = -(turns * gradient).sum(axis=1)
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        derivative[3 + a] = gradient[b] * local[c] - gradient[c] * local[b]
    derivative[6:9] = -slope
    return derivative


def _turns(shapes: Shapes, index: Index) -> Float64:
    """Frames of the points' shapes, (3, 3, p): rows of coordinates are what NumPy is fast on."""
    return shapes.frames.transpose(1, 2, 0).take(index, axis=2)


def _local(turns: Float64, shapes: Shapes, points: Float64, index: Index) -> Float64:
    """Points (3, p) in the frames of their shapes."""
    offset = points.T - shapes.centers.T.take(index, axis=1)
    return _sum(turns * offset[:, None])


def _signed(excess: Float64) -> Float64:
    """Signed distance (p,) of points from how far they are beyond each face (k, p), which is overwritten."""
    depth = np.minimum(excess.max(axis=0), 0.0)
    np.maximum(excess, 0.0, out=excess)
    excess *= excess
    distance = np.sqrt(excess.sum(axis=0))
    distance += depth
    return distance


def _sum(rows: Float64) -> Float64:
    return rows[0] + rows[1] + rows[2]


_NEVER = -1e300


def _excess(kinds: NDArray[np.uint8], local: Float64, shapes: Shapes, index: Index) -> Float64:
    """How far points are beyond each face (3, p), in the row of the half extent that they are held against.

    A box has three, a cylinder radius and height in rows 0 and 1, a sphere its radius in row 0.
    """
    halves = shapes.halves.T.take(index, axis=1)
    excess = np.abs(local) - halves
    cylinder, sphere = kinds == _CYLINDER, kinds == _SPHERE
    if cylinder.any() or sphere.any():
        across = local[0] * local[0] + local[2] * local[2]
        radius = np.sqrt(across + np.where(sphere, local[1] * local[1], 0.0))
        excess[0] = np.where(cylinder | sphere, radius - halves[0], excess[0])
        excess[1] = np.where(sphere, _NEVER, excess[1])
        excess[2] = np.where(cylinder | sphere, _NEVER, excess[2])
    return excess


def _local_gradient(kinds: NDArray[np.uint8], local: Float64, slope: Float64) -> Float64:
    gradient = np.copysign(slope, local)
    cylinder, sphere = kinds == _CYLINDER, kinds == _SPHERE
    if cylinder.any() or sphere.any():
        across = local[0] * local[0] + local[2] * local[2]
        radius = np.sqrt(across + np.where(sphere, local[1] * local[1], 0.0))
        outward = np.where(sphere, 1.0, slope[0]) / np.maximum(radius, 1e-300)
        gradient[0] = np.where(cylinder | sphere, outward * local[0], gradient[0])
        gradient[1] = np.where(sphere, outward * local[1], gradient[1])
        gradient[2] = np.where(cylinder | sphere, outward * local[2], gradient[2])
    return gradient


# -------------------------------------------------------------------------------------------- parameters


def moved(shapes: Shapes, step: Float64) -> Shapes:
    """Shapes after a step (n, 9) in their parameters; the ties of spheres and cylinders are kept."""
    halves = shapes.halves + step[:, 6:9]
    sphere, cylinder = shapes.kinds == _SPHERE, shapes.kinds == _CYLINDER
    halves[sphere] = halves[sphere, :1]
    halves[cylinder, 2] = halves[cylinder, 0]
    frames = shapes.frames @ rotation_matrices(step[:, 3:6])
    return replace(shapes, centers=shapes.centers + step[:, 0:3], frames=frames, halves=halves)


def rotation_matrices(vectors: Float64) -> Float64:
    """Rotation matrices (n, 3, 3) of rotation vectors (n, 3), by Rodrigues' formula."""
    angle = np.linalg.norm(vectors, axis=1)
    x, y, z = (vectors / np.where(angle > 0, angle, 1.0)[:, None]).T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    sine, versine = np.sin(angle)[:, None, None], 1 - np.cos(angle)[:, None, None]
    return np.eye(3) + sine * cross + versine * (cross @ cross)


def right_handed(frame: Float64) -> Float64:
    """The nearest rotation to a (3, 3) frame of nearly orthogonal columns, keeping the first two."""
    first = frame[:, 0] / np.linalg.norm(frame[:, 0])
    second = frame[:, 1] - first * (first @ frame[:, 1])
    second /= np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)], axis=1)


# -------------------------------------------------------------------------------------------- the set


def is_sheet(shapes: Shapes) -> NDArray[np.bool_]:
    """Which shapes (n,) are boxes as thin as a plane may be."""
    smallest, middle, _ = np.sort(shapes.halves, axis=1).T
    return (shapes.kinds == Kind.BOX) & (smallest <= PLANE_THICKNESS_LIMIT * middle)


def are_of(shapes: Shapes, kinds: Sequence[str]) -> NDArray[np.bool_]:
    """Which shapes (n,) would be written as one of the `kinds`."""
    written = np.where(is_sheet(shapes), Kind.PLANE, shapes.kinds)
    return np.isin(written, [Kind[kind.upper()] for kind in kinds])


def to_primitives(shapes: Shapes, *, planes: bool = True) -> PrimitiveSet:
    """The primitive set, white; boxes as thin as a sheet become `planes`, their normal along local Y."""
    kinds, frames, halves = shapes.kinds.copy(), shapes.frames.copy(), shapes.halves.copy()
    if planes:
        for i in np.flatnonzero(is_sheet(shapes)):
            thin = int(np.argmin(halves[i]))
            order = [(thin + 2) % 3, thin, (thin + 1) % 3]  # an even permutation keeps the frame right-handed
            kinds[i], frames[i], halves[i] = Kind.PLANE, frames[i][:, order], halves[i, order]
    count = len(shapes)
    white = np.ones((count, 6, 3), np.float32)
    return PrimitiveSet(
        kinds=kinds,
        positions=shapes.centers.copy(),
        rotations=quaternions_from_matrices(frames),
        sizes=2 * halves,
        albedo=white,
        emission=np.zeros_like(white),
        names=tuple(f"{Kind(k).name.lower()}_{i}" for i, k in enumerate(kinds)),
    )
