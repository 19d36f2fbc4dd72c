"""A scene's triangles as Mitsuba shapes, around the origin that keeps float32 precise."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fit.scene import Float64, Instance, Mesh, Scene, TextureUse, normal_matrix, transform_points
from pipelines.reference.surfaces import Surfaces

_LIFT = 1e-5
"""Of the scene's size: how far the second side of a double-sided lamp stands off the first."""


def mesh_shapes(scene: Scene, surfaces: Surfaces, origin: Float64, folder: Path) -> dict[str, Any]:
    """A shape for each drawn instance; its triangles go through a PLY file in `folder`.

    Transmissive surfaces are left out, as everywhere. A lamp whose material is double-sided shines both ways.
    """
    lower, upper = scene.bounds()
    lift = _LIFT * float(np.linalg.norm(upper - lower))
    shapes: dict[str, Any] = {}
    for number, instance in enumerate(scene.instances):
        mesh = scene.meshes[instance.mesh]
        material = surfaces.material(mesh.material)
        if len(mesh.triangles) == 0 or material.transmission > 0:
            continue
        path = folder / f"{number}.ply"
        use, colors = surfaces.coordinates(mesh.material), surfaces.vertex_colors(mesh)
        _write(path, mesh, use, colors, instance, origin)
        shape: dict[str, Any] = {
            "type": "ply",
            "filename": str(path),
            "bsdf": surfaces.bsdf(mesh.material, colors is not None),
        }
        emitter = surfaces.emission(mesh.material)
        if emitter is not None:
            shape["emitter"] = emitter
        shapes[f"instance_{number}"] = shape
        if emitter is not None and material.double_sided:
            other = folder / f"{number}_back.ply"
            _write(other, mesh, use, colors, instance, origin, back=lift)
            shapes[f"instance_{number}_back"] = {**shape, "filename": str(other)}
    return shapes


def _write(
    path: Path,
    mesh: Mesh,
    use: TextureUse | None,
    colors: Float64 | None,
    instance: Instance,
    origin: Float64,
    back: float = 0.0,
) -> None:
    """Binary PLY with linear `colors` (n, 3); `back`: the other side of the faces, so far off them."""
    matrix = instance.world_from_local
    normals = mesh.normals @ normal_matrix(matrix[:3, :3]).T
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    triangles = mesh.triangles
    if np.linalg.det(matrix[:3, :3]) < 0:
        triangles = triangles[:, ::-1]
    points = transform_points(matrix, mesh.positions) - origin
    if back > 0:
        normals, triangles = -normals, triangles[:, ::-1]
        points = points + back * normals
    fields = {"x": points[:, 0], "y": points[:, 1], "z": points[:, 2]}
    fields |= {"nx": normals[:, 0], "ny": normals[:, 1], "nz": normals[:, 2]}
    if use is not None and use.texcoord < len(mesh.texcoords):
        uv = mesh.texcoords[use.texcoord] @ use.transform[:2, :2].T + use.transform[:2, 2]
        fields |= {"u": uv[:, 0], "v": uv[:, 1]}
    if colors is not None:
        fields |= {"r": colors[:, 0], "g": colors[:, 1], "b": colors[:, 2]}  # together: vertex_color
    vertices = np.zeros(len(points), [(name, "<f4") for name in fields])
    for name, values in fields.items():
        vertices[name] = values
    faces = np.zeros(len(triangles), [("count", "u1"), ("indices", "<i4", 3)])
    faces["count"], faces["indices"] = 3, triangles
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in fields]
    header += [f"element face {len(faces)}", "property list uchar int vertex_index", "end_header", ""]
    path.write_bytes("\n".join(header).encode() + vertices.tobytes() + faces.tobytes())
