"""The scene's triangles on the GPU as rays find them: a tree of boxes, surfaces, all texels in one buffer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.scene import (
    AlphaMode,
    Float64,
    Material,
    Mesh,
    Scene,
    TextureUse,
    Wrap,
    normal_matrix,
    transform_points,
)
from runtime.device import Gpu
from runtime.emitters import Emitters, emitters_of
from runtime.meshes import BLEND_CUTOFF
from runtime.resources import Buffer
from runtime.structs import GpuStruct, f32, u32, vec2f, vec3f, vec4f
from runtime.textures import mipmaps
from runtime.triangle_tree import build_tree
from runtime.twins.normal import normal_pack

NO_IMAGE = 0xFFFFFFFF

MARGIN = 1e-5
"""Of the scene's diagonal: how far off a surface rays start."""

WRAPS = {Wrap.REPEAT: 0, Wrap.MIRROR: 1, Wrap.CLAMP: 2}


class TriangleInfo(GpuStruct):
    margin: f32
    emitter_count: u32
    emitter_power: f32


class TriangleCorner(GpuStruct):
    normal: u32
    color: u32
    base_uv: vec2f
    emission_uv: vec2f


class TriangleMaterial(GpuStruct):
    base_color: vec4f
    emission: vec3f
    alpha_cutoff: f32
    base_image: u32
    emission_image: u32
    is_double_sided: u32


class TriangleImage(GpuStruct):
    first: u32
    width: u32
    height: u32
    wrap_u: u32
    wrap_v: u32
    is_linear: u32


class Triangles:
    """What `triangles/bindings.wgsl` binds, in local space: world minus `origin`.

    Transmissive surfaces are left out. Images are halved until all texels fit into `texel_bytes`; `notes`
    says so.

    Raises:
        ValueError: there is no triangle, or too many for a buffer.
    """

    def __init__(self, gpu: Gpu, scene: Scene, origin: Float64, texel_bytes: int = 96 << 20) -> None:
        self.gpu, self.origin = gpu, np.asarray(origin, np.float64)
        corners, records, materials = _collect(scene, self.origin)
        if len(corners) == 0:
            raise ValueError(f"{scene.source}: the scene draws no triangle that light meets")
        need, limit = 72 * len(corners), gpu.limits["max-storage-buffer-binding-size"]
        if need > limit:
            raise ValueError(
                f"{scene.source}: {len(corners)} triangles take {need >> 20} MiB, "
                f"a buffer binds {limit >> 20}: simplify the meshes"
            )
        diagonal = float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0))) or 1.0
        order, nodes = build_tree(corners)
        own = corners[order]
        faces = np.zeros((len(order), 3, 4), np.float32)
        faces[:, 0, :3] = own[:, 0]
        faces[:, 1, :3], faces[:, 2, :3] = own[:, 1] - own[:, 0], own[:, 2] - own[:, 0]
        faces[:, 0, 3] = materials[order].view(np.float32)
        images = _Images(scene, texel_bytes)
        table = _material_records((*scene.materials, Material()), images)
        self.notes = images.notes
        shining = _emitters(own, table["emission"].sum(axis=1)[materials[order]])
        info = TriangleInfo.pack(
            margin=MARGIN * diagonal, emitter_count=shining.count, emitter_power=shining.power
        )
        self._buffers = {
            "triangle_info": Buffer(gpu, info, "uniform", label="triangle info"),
            "triangle_nodes": Buffer(gpu, nodes, label="triangle nodes"),
            "triangle_faces": Buffer(gpu, faces, label="triangle faces"),
            "triangle_corners": Buffer(gpu, records[order], label="triangle corners"),
            "triangle_materials": Buffer(gpu, table, label="triangle materials"),
            "triangle_images": Buffer(gpu, images.records(), label="triangle images"),
            "triangle_texels": Buffer(gpu, images.texels(), label="triangle texels"),
            "emitters": Buffer(gpu, shining.records, label="emitters"),
        }

    def bindings(self) -> Mapping[str, Any]:
        """Group 1 of every kernel that traces triangles."""
        return self._buffers

    @property
    def memory(self) -> int:
        """Bytes on the GPU."""
        return sum(buffer.size for buffer in self._buffers.values())


def _collect(scene: Scene, origin: Float64) -> tuple[Float64, np.ndarray, NDArray[np.uint32]]:
    """Corners (t, 3, 3), their records (t, 3) and materials (t,) of everything drawn."""
    corners, records, materials = [np.zeros((0, 3, 3))], [np.zeros((0, 3), TriangleCorner.dtype)], []
    for instance in scene.instances:
        mesh = scene.meshes[instance.mesh]
        row = mesh.material if 0 <= mesh.material < len(scene.materials) else len(scene.materials)
        material = scene.materials[row] if row < len(scene.materials) else Material()
        if len(mesh.triangles) == 0 or material.transmission > 0:
            continue
        matrix = instance.world_from_local
        triangles = mesh.triangles if np.linalg.det(matrix[:3, :3]) > 0 else mesh.triangles[:, ::-1]
        corners.append((transform_points(matrix, mesh.positions) - origin)[triangles])
        records.append(_corner_records(mesh, material, matrix)[triangles])
        materials.append(np.full(len(triangles), row, np.uint32))
    return (
        np.concatenate(corners),
        np.concatenate(records),
        np.concatenate([*materials, np.zeros(0, np.uint32)]),
    )


def _corner_records(mesh: Mesh, material: Material, matrix: Float64) -> np.ndarray:
    normals = mesh.normals @ normal_matrix(matrix[:3, :3]).T
    normals /= np.maximum(np.abs(normals).max(axis=1, keepdims=True), 1e-300)
    colors = np.ones((len(mesh.positions), 4)) if mesh.colors is None else mesh.colors
    codes = np.rint(np.clip(colors, 0, 1) * 255).astype(np.uint32)
    return TriangleCorner.pack_array(
        len(mesh.positions),
        normal=normal_pack(np.where(np.abs(normals).sum(axis=1, keepdims=True) > 0, normals, (0, 1, 0))),
        color=codes[:, 0] | codes[:, 1] << 8 | codes[:, 2] << 16 | codes[:, 3] << 24,
        base_uv=_texcoords(mesh, material.base_color_texture),
        emission_uv=_texcoords(mesh, material.emission_texture),
    )


def _texcoords(mesh: Mesh, use: TextureUse | None) -> Float64:
    if use is None or use.texcoord >= len(mesh.texcoords):
        return np.zeros((len(mesh.positions), 2))
    return mesh.texcoords[use.texcoord] @ use.transform[:2, :2].T + use.transform[:2, 2]


def _emitters(corners: Float64, strength: NDArray[np.floating]) -> Emitters:
    """Of triangles (t, 3, 3) with the sums of their emission's channels (t,), textures left aside."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    rows = np.arange(len(corners))
    return emitters_of(strength, np.linalg.norm(normals, axis=1) / 2, rows, np.zeros_like(rows))


def _material_records(materials: Sequence[Material], images: _Images) -> np.ndarray:
    cutoffs = {AlphaMode.OPAQUE: 0.0, AlphaMode.BLEND: BLEND_CUTOFF}
    return TriangleMaterial.pack_array(
        len(materials),
        base_color=[m.base_color for m in materials],
        emission=[m.emission for m in materials],
        alpha_cutoff=[cutoffs.get(m.alpha_mode, m.alpha_cutoff) for m in materials],
        base_image=[images.row(m.base_color_texture) for m in materials],
        emission_image=[images.row(m.emission_texture if any(m.emission) else None) for m in materials],
        is_double_sided=[int(m.double_sided) for m in materials],
    )


class _Images:
    """All images that materials use, halved until they fit."""

    def __init__(self, scene: Scene, texel_bytes: int) -> None:
        self._scene = scene
        uses = [
            use
            for m in scene.materials
            for use in (m.base_color_texture, m.emission_texture if any(m.emission) else None)
            if use is not None
        ]
        self._textures = sorted({use.texture for use in uses})
        used = sorted({scene.textures[t].image for t in self._textures})
        levels = {i: [scene.images[i].pixels] for i in used}
        full = 4 * sum(level[0].shape[0] * level[0].shape[1] for level in levels.values())
        if full > texel_bytes:
            levels = {i: mipmaps(scene.images[i].pixels, srgb=True) for i in used}
        largest = max((max(level[0].shape[:2]) for level in levels.values()), default=1)
        while (
            4 * sum(int(np.prod(self._fitting(level, largest).shape[:2])) for level in levels.values())
            > texel_bytes
        ):
            largest //= 2
        self._pixels = {i: self._fitting(level, largest) for i, level in levels.items()}
        self.notes = (f"images are halved to {largest} texels a side",) if full > texel_bytes else ()

    @staticmethod
    def _fitting(levels: list[NDArray[np.uint8]], largest: int) -> NDArray[np.uint8]:
        return next((level for level in levels if max(level.shape[:2]) <= largest), levels[-1])

    def row(self, use: TextureUse | None) -> int:
        return NO_IMAGE if use is None else self._textures.index(use.texture)

    def records(self) -> np.ndarray:
        first, at = {}, 0
        for image, pixels in self._pixels.items():
            first[image] = at
            at += pixels.shape[0] * pixels.shape[1]
        if not self._textures:
            return np.zeros(1, TriangleImage.dtype)
        textures = [self._scene.textures[number] for number in self._textures]
        return TriangleImage.pack_array(
            len(textures),
            first=[first[t.image] for t in textures],
            width=[self._pixels[t.image].shape[1] for t in textures],
            height=[self._pixels[t.image].shape[0] for t in textures],
            wrap_u=[WRAPS[t.wrap_u] for t in textures],
            wrap_v=[WRAPS[t.wrap_v] for t in textures],
            is_linear=[int(t.linear) for t in textures],
        )

    def texels(self) -> NDArray[np.uint8]:
        parts = [np.ascontiguousarray(pixels).reshape(-1) for pixels in self._pixels.values()]
        return np.concatenate([*parts, np.zeros(4, np.uint8)])
