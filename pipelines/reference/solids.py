"""A primitive set as Mitsuba shapes, exactly: rectangles, spheres, cylinders, disks, face by face."""

from __future__ import annotations

from typing import Any

import numpy as np

from fit.primitives import Kind, PrimitiveSet
from fit.scene import Float64

_FACES = [(axis, sign) for axis in range(3) for sign in (1, -1)]
"""Faces in the order of their colours: +x, -x, +y, -y, +z, -z."""

_SIDE, _TOP, _BOTTOM = 0, 2, 3
"""Colours that a cylinder's side and ends take."""


_HALF_SPACE_REACH = 1e3
"""Of the diagonal of the finite primitives."""


def primitive_bounds(primitives: PrimitiveSet) -> tuple[Float64, Float64]:
    """Of the finite primitives; two metres about 0 where there are none."""
    if primitives.is_half_space.all():
        return np.full(3, -1.0), np.full(3, 1.0)
    return primitives.bounds()


def primitive_shapes(mi: Any, primitives: PrimitiveSet, origin: Float64) -> dict[str, Any]:
    """Shapes of all primitives; half-spaces are squares."""
    turns = primitives.rotation_matrices()
    lower, upper = primitive_bounds(primitives)
    reach = _HALF_SPACE_REACH * float(np.linalg.norm(upper - lower))
    shapes: dict[str, Any] = {}
    for i, kind in enumerate(primitives.kinds):
        center, turn, half = primitives.positions[i] - origin, turns[i], primitives.sizes[i] / 2
        if primitives.is_half_space[i]:
            pieces = [(_square(mi, center, turn, np.array([reach, 0.0, reach]), 1, 1), _TOP)]
        elif kind == Kind.SPHERE:
            pieces = [({"type": "sphere", "center": center.tolist(), "radius": float(half[0])}, 0)]
        elif kind == Kind.CYLINDER:
            pieces = _cylinder(mi, center, turn, half)
        else:
            pieces = [
                (_square(mi, center, turn, half, axis, sign), face)
                for face, (axis, sign) in enumerate(_FACES)
            ]
        for number, (shape, face) in enumerate(pieces):
            shapes[f"primitive_{i}_{number}"] = shape | _surface(primitives, i, face)
    return shapes


def _square(mi: Any, center: Float64, turn: Float64, half: Float64, axis: int, sign: int) -> dict[str, Any]:
    """One face of a box: Mitsuba's rectangle spans [-1, 1] in x and y and looks along z."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    if sign < 0:
        first, second = second, first
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1] = turn[:, first] * half[first], turn[:, second] * half[second]
    matrix[:3, 2] = sign * turn[:, axis]
    matrix[:3, 3] = center + sign * half[axis] * turn[:, axis]
    return {"type": "rectangle", "to_world": mi.ScalarTransform4f(matrix)}


def _cylinder(mi: Any, center: Float64, turn: Float64, half: Float64) -> list[tuple[dict[str, Any], int]]:
    top, bottom = center + half[1] * turn[:, 1], center - half[1] * turn[:, 1]
    side = {"type": "cylinder", "p0": bottom.tolist(), "p1": top.tolist(), "radius": float(half[0])}
    ends = []
    for place, sign, face in ((top, 1, _TOP), (bottom, -1, _BOTTOM)):
        matrix = np.eye(4)
        matrix[:3, 0], matrix[:3, 1] = turn[:, 2] * half[0], turn[:, 0] * half[0] * sign
        matrix[:3, 2], matrix[:3, 3] = sign * turn[:, 1], place
        ends.append(({"type": "disk", "to_world": mi.ScalarTransform4f(matrix)}, face))
    return [(side, _SIDE), *ends]


def _surface(primitives: PrimitiveSet, index: int, face: int) -> dict[str, Any]:
    albedo = primitives.albedo[index, face].astype(np.float64).tolist()
    emission = primitives.emission[index, face].astype(np.float64)
    diffuse = {"type": "diffuse", "reflectance": {"type": "rgb", "value": albedo}}
    surface: dict[str, Any] = {"bsdf": {"type": "twosided", "bsdf": diffuse}}
    if emission.any():
        surface["emitter"] = {"type": "area", "radiance": {"type": "rgb", "value": emission.tolist()}}
    return surface
