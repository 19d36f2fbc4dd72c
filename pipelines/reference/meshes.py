"""A scene's triangles as Mitsuba shapes, around the origin that keeps float32 precise."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fit.scene import Float64, Instance, Mesh, Scene, TextureUse, transform_points
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
        _write(path, scene, mesh, material.base_color_texture or material.emission_texture, instance, origin)
        shape: dict[str, Any] = {
            "type": "ply",
            "filename": str(path),
            "bsdf": surfaces.bsdf(mesh.material, mesh.colors is not None),
        }
        emitter = surfaces.emission(mesh.material)
        if emitter is not None:
            shape["emitter"] = emitter
        shapes[f"instance_{number}"] = shape
        if emitter is not None and material.double_sided:
            other = folder / f"{number}_back.ply"
            _write(other, scene, mesh, material.emission_texture, instance, origin, back=lift)
            shapes[f"instance_{number}_back"] = {**shape, "filename": str(other)}
    return shapes


def _write(
    path: Path,
    scene: Scene,
    mesh: Mesh,
    use: TextureUse | None,
    instance: Instance,
    origin: Float64,
    back: float = 0.0,
) -> None:
    """Binary PLY; `back`: the other side of the faces, so far off them."""
    matrix = instance.world_from_local
    normals = mesh.normals @ _cofactor(matrix[:3, :3]).T
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
    if mesh.colors is not None:
        fields |= {"color_r": mesh.colors[:, 0], "color_g": mesh.colors[:, 1], "color_b": mesh.colors[:, 2]}
    vertices = np.zeros(len(points), [(name, "<f4") for name in fields])
    for name, values in fields.items():
        vertices[name] = values
    faces = np.zeros(len(triangles), [("count", "u1"), ("indices", "<i4", 3)])
    faces["count"], faces["indices"] = 3, triangles
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in fields]
    header += [f"element face {len(faces)}", "property list uchar int vertex_index", "end_header", ""]
    path.write_bytes("\n".join(header).encode() + vertices.tobytes() + faces.tobytes())


def _cofactor(m: Float64) -> Float64:
    """What carries normals through mirrors and uneven scales."""
    return np.stack([np.cross(m[1], m[2]), np.cross(m[2], m[0]), np.cross(m[0], m[1])])
