"""Primitive sets as USD text (.usda), for looking at and working on them in other tools; write only.

Geometry is Cube, Sphere and Cylinder where one colour covers it, else a Mesh with a colour for each face.
Colours are `primvars:displayColor`, linear; all six albedos and emissions of a primitive stand beside them as
`sdfprim:albedo` and `sdfprim:emission`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fit.export.files import write_atomically
from fit.export.gltf import half_space_size, kind_name, node_name
from fit.export.unit_meshes import HALF_SPACE, UNIT_MESHES
from fit.primitives import PrimitiveSet

_HEADER = """#usda 1.0
(
    defaultPrim = "Primitives"
    metersPerUnit = 1
    upAxis = "Y"
)

def Xform "Primitives"
{
"""

_GPRIMS = {
    "box": 'def Cube "{}"\n    {{\n        double size = 1\n',
    "plane": 'def Cube "{}"\n    {{\n        double size = 1\n',
    "sphere": 'def Sphere "{}"\n    {{\n        double radius = 0.5\n',
    "cylinder": 'def Cylinder "{}"\n    {{\n        double radius = 0.5\n        double height = 1\n'
    '        uniform token axis = "Y"\n',
}


def write_usda(primitives: PrimitiveSet, path: Path) -> None:
    """Write the set; the same set gives the same bytes.

    Raises:
        ValueError: the set is invalid.
    """
    primitives.validate()
    quad = half_space_size(primitives)
    body = "\n".join(_prim(primitives, i, quad) for i in range(len(primitives)))
    write_atomically(path, f"{_HEADER}{body}}}\n".encode())


def _prim(primitives: PrimitiveSet, i: int, quad: float) -> str:
    kind = kind_name(primitives, i)
    albedo, emission = primitives.albedo[i], primitives.emission[i]
    size = np.array([quad, 1.0, quad]) if kind == HALF_SPACE else primitives.sizes[i]
    x, y, z, w = primitives.rotations[i].tolist()
    label = primitives.names[i] if primitives.names else ""
    one_color = kind != HALF_SPACE and bool(np.all(albedo == albedo[0]))
    head = _GPRIMS[kind].format(node_name(kind, i)) if one_color else _mesh(kind, node_name(kind, i))
    colors = albedo[:1] if one_color else _triangle_colors(kind, albedo)
    lines = [
        f"        float3[] extent = {_tuples(_extent(kind))}",
        f"        color3f[] primvars:displayColor = {_tuples(colors)} (",
        f'            interpolation = "{"constant" if one_color else "uniform"}"',
        "        )",
        f"        double3 xformOp:translate = {_tuple(primitives.positions[i])}",
        f"        quatd xformOp:orient = {_tuple((w, x, y, z))}",
        f"        double3 xformOp:scale = {_tuple(size)}",
        '        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient", "xformOp:scale"]',
        f'        custom token sdfprim:kind = "{kind}"',
        f"        custom string sdfprim:name = {json.dumps(label)}",
        f"        custom color3f[] sdfprim:albedo = {_tuples(albedo)}",
        f"        custom color3f[] sdfprim:emission = {_tuples(emission)}",
    ]
    return f"    {head}" + "\n".join(lines) + "\n    }\n"


def _mesh(kind: str, name: str) -> str:
    unit = UNIT_MESHES[kind]
    counts = ", ".join(["3"] * len(unit.triangles))
    indices = ", ".join(str(i) for i in unit.triangles.ravel().tolist())
    return (
        f'def Mesh "{name}"\n    {{\n'
        f"        point3f[] points = {_tuples(unit.positions)}\n"
        f"        int[] faceVertexCounts = [{counts}]\n"
        f"        int[] faceVertexIndices = [{indices}]\n"
        f"        normal3f[] normals = {_tuples(unit.normals)} (\n"
        '            interpolation = "vertex"\n        )\n'
        '        uniform token subdivisionScheme = "none"\n'
    )


def _extent(kind: str) -> NDArray[np.float32]:
    """Corners (2, 3) of the box around a kind's unit mesh."""
    points = UNIT_MESHES[kind].positions
    return np.stack([points.min(axis=0), points.max(axis=0)])


def _triangle_colors(kind: str, albedo: NDArray[np.float32]) -> NDArray[np.float32]:
    """The colour (t, 3) of each triangle of a kind's unit mesh."""
    return np.repeat(albedo, np.diff(UNIT_MESHES[kind].starts), axis=0)


def _tuple(values: Iterable[float]) -> str:
    """Shortest text that reads back to the same number."""
    return f"({', '.join(repr(float(v)) for v in values)})"


def _tuples(rows: Iterable[Iterable[float]]) -> str:
    return f"[{', '.join(_tuple(row) for row in rows)}]"
