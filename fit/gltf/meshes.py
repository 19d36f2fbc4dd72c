"""Posed primitives -> `Mesh`: triangles that touch no bad number, normals of unit length."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.gltf.errors import GltfError
from fit.gltf.normals import face_normals, repair_normals, unit_or_up
from fit.gltf.notes import Notes
from fit.gltf.primitives import Primitive
from fit.scene import Mesh

Float64 = NDArray[np.float64]


def to_mesh(file: str, primitive: Primitive, material: int, notes: Notes) -> Mesh:
    """Mend a primitive and make it a mesh; what was mended is counted.

    Triangles of zero area stay: they have no surface, but they count as triangles of the file.

    Raises:
        GltfError: none of its positions is finite.
    """
    primitive = _drop_non_finite(file, primitive, notes)
    primitive = replace(
        primitive,
        texcoords=tuple(_finite(values, "texture coordinates", notes) for values in primitive.texcoords),
        colors=None if primitive.colors is None else _finite(primitive.colors, "vertex colours", notes),
    )
    if primitive.normals is None:
        primitive = _flat_shaded(primitive, notes)
    else:
        normals, mended = repair_normals(primitive.normals, primitive.positions, primitive.triangles)
        primitive = replace(primitive, normals=normals)
        notes.repair("normals without direction replaced", mended)
        _, areas = face_normals(primitive.positions, primitive.triangles)
        notes.repair("triangles of zero area kept", int(np.count_nonzero(areas == 0)))
    assert primitive.normals is not None
    return Mesh(
        name=primitive.name,
        positions=primitive.positions,
        normals=primitive.normals,
        triangles=np.ascontiguousarray(primitive.triangles),
        material=material,
        texcoords=primitive.texcoords,
        colors=primitive.colors,
    )


def _drop_non_finite(file: str, primitive: Primitive, notes: Notes) -> Primitive:
    """Without the vertices at NaN or infinity and the triangles that touch them."""
    finite = np.all(np.isfinite(primitive.positions), axis=1)
    if finite.all():
        return primitive
    if not finite.any():
        what = "every position is NaN or infinite; export the file again"
        raise GltfError(file, f"{primitive.place}.attributes.POSITION", what)
    kept = finite[primitive.triangles].all(axis=1)
    notes.repair("vertices at NaN or infinity dropped", int(np.count_nonzero(~finite)))
    notes.repair("triangles at NaN or infinity dropped", int(np.count_nonzero(~kept)))
    renumbered = (np.cumsum(finite) - 1).astype(np.uint32)
    return _select_vertices(primitive, np.flatnonzero(finite), renumbered[primitive.triangles[kept]])


def _flat_shaded(primitive: Primitive, notes: Notes) -> Primitive:
    """With a normal for each triangle, and so with corners of its own (glTF 2.0, section 3.7.2.1)."""
    unit, areas = face_normals(primitive.positions, primitive.triangles)
    notes.repair("triangles of zero area kept", int(np.count_nonzero(areas == 0)))
    notes.repair("meshes whose missing normals were computed")
    corners = primitive.triangles.reshape(-1)
    own = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
    return replace(
        _select_vertices(primitive, corners, own), normals=np.repeat(unit_or_up(unit)[0], 3, axis=0)
    )


def _select_vertices(
    primitive: Primitive, vertices: NDArray[np.integer], triangles: NDArray[np.uint32]
) -> Primitive:
    return replace(
        primitive,
        positions=primitive.positions[vertices],
        normals=None if primitive.normals is None else primitive.normals[vertices],
        texcoords=tuple(values[vertices] for values in primitive.texcoords),
        colors=None if primitive.colors is None else primitive.colors[vertices],
        triangles=triangles,
    )


def _finite(values: Float64, what: str, notes: Notes) -> Float64:
    bad = ~np.isfinite(values)
    if not bad.any():
        return values
    notes.repair(f"non-finite {what} set to 0", int(np.count_nonzero(bad.any(axis=1))))
    return np.where(bad, 0.0, values)
