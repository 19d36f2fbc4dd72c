"""A primitive set as triangles, for tracers that know nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fit.export.unit_meshes import UnitMesh, unit_box, unit_cylinder, unit_quad, unit_sphere
from fit.primitives import FACES, Kind, PrimitiveSet
from fit.rotation import matrices_from_quaternions
from fit.scene import Instance, Material, Mesh, Scene
from pipelines.reference.solids import primitive_bounds

SEGMENTS = 96
"""Of a circle: chords lie at most 0.05 % of the radius inside of it."""

HALF_SPACE_REACH = 10.0
"""Of the diagonal of the finite primitives: the tracer's margins grow with the triangles' extent."""


def triangulate(primitives: PrimitiveSet) -> Scene:
    """The set as a scene: boxes, planes and half-spaces exactly, spheres and cylinders by `SEGMENTS`."""
    units = {
        Kind.SPHERE: unit_sphere(SEGMENTS, SEGMENTS // 2),
        Kind.CYLINDER: unit_cylinder(SEGMENTS),
        Kind.BOX: unit_box(),
        Kind.PLANE: unit_box(),
    }
    lower, upper = primitive_bounds(primitives)
    quad, reach = unit_quad(), HALF_SPACE_REACH * float(np.linalg.norm(upper - lower))
    meshes: list[Mesh] = []
    materials: list[Material] = []
    instances: list[Instance] = []
    for i, kind in enumerate(primitives.kinds):
        endless = bool(primitives.is_half_space[i])
        unit = quad if endless else units[Kind(kind)]
        place = np.eye(4)
        size = np.array([2 * reach, 1.0, 2 * reach]) if endless else primitives.sizes[i]
        place[:3, :3] = matrices_from_quaternions(primitives.rotations[i][None])[0] * size
        place[:3, 3] = primitives.positions[i]
        for face in range(len(FACES)):
            if unit.starts[face + 1] > unit.starts[face]:
                meshes.append(_face(unit, face, len(materials)))
                materials.append(_material(primitives, i, face))
                instances.append(Instance(len(meshes) - 1, -1, place))
    return Scene(
        source=Path("primitives"),
        meshes=tuple(meshes),
        materials=tuple(materials),
        instances=tuple(instances),
    )


def _face(unit: UnitMesh, face: int, material: int) -> Mesh:
    triangles = unit.triangles[unit.starts[face] : unit.starts[face + 1]]
    return Mesh(
        f"{unit.name} {FACES[face]}",
        unit.positions.astype(np.float64),
        unit.normals.astype(np.float64),
        triangles.astype(np.uint32),
        material,
    )


def _material(primitives: PrimitiveSet, i: int, face: int) -> Material:
    r, g, b = (float(value) for value in primitives.albedo[i, face])
    red, green, blue = (float(value) for value in primitives.emission[i, face])
    return Material(base_color=(r, g, b, 1.0), emission=(red, green, blue))
