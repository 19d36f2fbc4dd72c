"""The fitter's working form of primitives: solid boxes, spheres and cylinders without colour.

A plane is a thin box until the set is written out, so three distance functions are all that is optimised.
Every function takes *pairs*: shape `index[i]` seen from point `i`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from fit.primitives import PLANE_THICKNESS_LIMIT, Kind, PrimitiveSet
from fit.rotation import quaternions_from_matrices
from fit.scene import Float64

Index = NDArray[np.integer]

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


def pair_distances(shapes: Shapes, points: Float64, index: Index) -> Float64:
    """Exact signed distance (p,) from point i (p, 3) to shape `index[i]`."""
    local = _local(shapes, points, index)
    excess = _excess(shapes.kinds[index], local, shapes.halves[index])
    outside = np.sqrt(np.sum(np.maximum(excess, 0.0) ** 2, axis=1))
    return outside + np.minimum(excess.max(axis=1), 0.0)


def distances_to_one(shapes: Shapes, which: int, points: Float64) -> Float64:
    """Exact signed distance (p,) from all points to one shape."""
    local = (points - shapes.centers[which]) @ shapes.frames[which]
    kinds = np.broadcast_to(shapes.kinds[which], len(points))
    excess = _excess(kinds, local, np.broadcast_to(shapes.halves[which], local.shape))
    outside = np.sqrt(np.sum(np.maximum(excess, 0.0) ** 2, axis=1))
    return outside + np.minimum(excess.max(axis=1), 0.0)


def pair_derivatives(shapes: Shapes, points: Float64, index: Index) -> tuple[Float64, Float64]:
    """Signed distance (p,) and its derivative (p, 9) by the parameters of the pair's shape.

    With l = R^T (x - c) and g = dd/dl: dd/dc = -R g; a small rotation w in the local frame moves l by
    -w x l, so dd/dw = g x l; a half extent acts against the excess that carries the distance.
    """
    kinds, frames = shapes.kinds[index], shapes.frames[index]
    local = _local(shapes, points, index)
    excess = _excess(kinds, local, shapes.halves[index])
    positive = np.maximum(excess, 0.0)
    outside = np.sqrt(np.sum(positive**2, axis=1))
    deepest = np.zeros_like(excess)
    deepest[np.arange(len(excess)), excess.argmax(axis=1)] = 1.0
    is_outside = outside > 0
    slope = np.where(is_outside[:, None], positive / np.where(is_outside, outside, 1.0)[:, None], deepest)
    gradient = _local_gradient(kinds, local, slope)
    derivative = np.empty((len(points), PARAMETERS))
    derivative[:, 0:3] = -np.einsum("pij,pj->pi", frames, gradient)
    derivative[:, 3:6] = np.cross(gradient, local)
    derivative[:, 6:9] = -slope
    return outside + np.minimum(excess.max(axis=1), 0.0), derivative


def _local(shapes: Shapes, points: Float64, index: Index) -> Float64:
    return np.einsum("pij,pi->pj", shapes.frames[index], points - shapes.centers[index])


_NEVER = -1e300


def _excess(kinds: NDArray[np.uint8], local: Float64, halves: Float64) -> Float64:
    """How far a point is beyond each face direction, in the slot of the half extent that it is held against.

    A box has three, a cylinder radius and height in slots 0 and 1, a sphere its radius in slot 0.
    """
    excess = np.abs(local) - halves
    cylinder, sphere = kinds == Kind.CYLINDER, kinds == Kind.SPHERE
    if cylinder.any():
        excess[cylinder, 0] = np.hypot(local[cylinder, 0], local[cylinder, 2]) - halves[cylinder, 0]
        excess[cylinder, 2] = _NEVER
    if sphere.any():
        excess[sphere, 0] = np.linalg.norm(local[sphere], axis=1) - halves[sphere, 0]
        excess[sphere, 1:] = _NEVER
    return excess


def _local_gradient(kinds: NDArray[np.uint8], local: Float64, slope: Float64) -> Float64:
    gradient = slope * np.where(local < 0, -1.0, 1.0)
    cylinder, sphere = kinds == Kind.CYLINDER, kinds == Kind.SPHERE
    if cylinder.any():
        side = local[cylinder][:, [0, 2]]
        radius = np.maximum(np.linalg.norm(side, axis=1), 1e-300)
        gradient[np.ix_(cylinder, [0, 2])] = slope[cylinder, :1] * side / radius[:, None]
    if sphere.any():
        radius = np.maximum(np.linalg.norm(local[sphere], axis=1), 1e-300)
        gradient[sphere] = local[sphere] / radius[:, None]
    return gradient


# -------------------------------------------------------------------------------------------- parameters


def moved(shapes: Shapes, step: Float64) -> Shapes:
    """Shapes after a step (n, 9) in their parameters; the ties of spheres and cylinders are kept."""
    halves = shapes.halves + step[:, 6:9]
    sphere, cylinder = shapes.kinds == Kind.SPHERE, shapes.kinds == Kind.CYLINDER
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


def to_primitives(shapes: Shapes) -> PrimitiveSet:
    """The primitive set, white; boxes as thin as a sheet become planes, their normal along local Y."""
    kinds, frames, halves = shapes.kinds.copy(), shapes.frames.copy(), shapes.halves.copy()
    for i in np.flatnonzero(kinds == Kind.BOX):
        thin = int(np.argmin(halves[i]))
        if halves[i, thin] <= PLANE_THICKNESS_LIMIT * np.partition(halves[i], 1)[1]:
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
