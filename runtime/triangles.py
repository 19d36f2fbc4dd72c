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
from runtime.meshes import BLEND_CUTOFF
from runtime.resources import Buffer
from runtime.structs import GpuStruct, f32, u32, vec2f, vec3f, vec4f
from runtime.textures import mipmaps
from runtime.twins.normal import normal_pack

Int64 = NDArray[np.int64]

TRIANGLES_A_LEAF = 4
NO_IMAGE = 0xFFFFFFFF

MARGIN = 1e-5
"""Of the scene's diagonal: how far off a surface rays start."""

WRAPS = {Wrap.REPEAT: 0, Wrap.MIRROR: 1, Wrap.CLAMP: 2}


class TriangleInfo(GpuStruct):
    first_leaf: u32
    margin: f32


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
        need, limit = 48 * len(corners) * 2, gpu.limits["max-storage-buffer-binding-size"]
        if need > limit:
            raise ValueError(
                f"{scene.source}: {len(corners)} triangles take {need >> 20} MiB, "
                f"a buffer binds {limit >> 20}: simplify the meshes"
            )
        diagonal = float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0))) or 1.0
        order, nodes = build_tree(corners)
        faces = np.zeros((len(order), 3, 4), np.float32)
        kept = order >= 0  # the tree is complete: what fills its last leaves are triangles without area
        own = corners[order[kept]]
        faces[kept, 0, :3] = own[:, 0]
        faces[kept, 1, :3], faces[kept, 2, :3] = own[:, 1] - own[:, 0], own[:, 2] - own[:, 0]
        faces[kept, 0, 3] = materials[order[kept]].astype(np.uint32).view(np.float32)
        sorted_records = np.zeros((len(order), 3), TriangleCorner.dtype)
        sorted_records[kept] = records[order[kept]]
        images = _Images(scene, texel_bytes)
        table = _material_records((*scene.materials, Material()), images)
        self.notes = images.notes
        info = TriangleInfo.pack(first_leaf=len(nodes) // 2, margin=MARGIN * diagonal)
        self._buffers = {
            "triangle_info": Buffer(gpu, info, "uniform", label="triangle info"),
            "triangle_nodes": Buffer(gpu, nodes, label="triangle nodes"),
            "triangle_faces": Buffer(gpu, faces, label="triangle faces"),
            "triangle_corners": Buffer(gpu, sorted_records, label="triangle corners"),
            "triangle_materials": Buffer(gpu, table, label="triangle materials"),
            "triangle_images": Buffer(gpu, images.records(), label="triangle images"),
            "triangle_texels": Buffer(gpu, images.texels(), label="triangle texels"),
        }

    def bindings(self) -> Mapping[str, Any]:
        """Group 1 of every kernel that traces triangles."""
        return self._buffers

    @property
    def memory(self) -> int:
        """Bytes on the GPU."""
        return sum(buffer.size for buffer in self._buffers.values())


def build_tree(corners: Float64) -> tuple[Int64, NDArray[np.float32]]:
    """A complete binary tree over triangles (t, 3, 3): their order in its leaves, -1 where a leaf has room
    left, and the boxes (nodes, 2, 4) from the root on, the children of node i being 2 i + 1 and 2 i + 2.

    Each node is cut at the median along the longest side of its centres' box, all nodes of a level at once.
    """
    leaves = 1 << max(int(np.ceil(np.log2(max(len(corners), 1) / TRIANGLES_A_LEAF))), 0)
    room = leaves * TRIANGLES_A_LEAF
    centers = np.full((room, 3), np.inf)
    centers[: len(corners)] = corners.mean(axis=1)
    order = np.arange(room)
    order[len(corners) :] = -1
    size = room
    while size > TRIANGLES_A_LEAF:
        groups = centers[order].reshape(-1, size, 3)
        groups[order.reshape(-1, size) < 0] = np.inf
        finite = np.where(np.isfinite(groups), groups, np.nan)
        with np.errstate(all="ignore"):
            extent = np.nan_to_num(_span(finite))
        axis = extent.argmax(axis=1)
        along = np.take_along_axis(groups, axis[:, None, None], axis=2)[..., 0]
        # Empty places sort last, so that the left half is full.
        rank = np.argsort(along, axis=1, kind="stable")
        order = np.take_along_axis(order.reshape(-1, size), rank, axis=1).reshape(-1)
        size //= 2
    return order, _boxes(corners, order, leaves)


def _span(groups: Float64) -> Float64:
    """Extent (n, 3) of groups (n, size, 3) with NaN for nothing."""
    low = np.where(np.isnan(groups), np.inf, groups).min(axis=1)
    high = np.where(np.isnan(groups), -np.inf, groups).max(axis=1)
    return np.maximum(high - low, 0)


def _boxes(corners: Float64, order: Int64, leaves: int) -> NDArray[np.float32]:
    lower, upper = np.full((2 * leaves - 1, 3), np.inf), np.full((2 * leaves - 1, 3), -np.inf)
    low = np.full((len(order), 3), np.inf)
    high = np.full((len(order), 3), -np.inf)
    kept = order >= 0
    low[kept], high[kept] = corners[order[kept]].min(axis=1), corners[order[kept]].max(axis=1)
    lower[leaves - 1 :] = low.reshape(leaves, -1, 3).min(axis=1)
    upper[leaves - 1 :] = high.reshape(leaves, -1, 3).max(axis=1)
    first = leaves - 1
    while first > 0:
        parents = slice((first - 1) // 2, first)
        children = slice(first, 2 * first + 1)
        lower[parents] = lower[children].reshape(-1, 2, 3).min(axis=1)
        upper[parents] = upper[children].reshape(-1, 2, 3).max(axis=1)
        first = (first - 1) // 2
    boxes = np.zeros((2 * leaves - 1, 2, 4), np.float32)
    # Outward by a rounding of float32; a box of nothing is missed by every ray.
    pad = 1e-6 * float(np.abs(corners).max() + 1e-30)
    boxes[:, 0, :3] = np.where(np.isfinite(lower), lower - pad, 3e38)
    boxes[:, 1, :3] = np.where(np.isfinite(upper), upper + pad, 3e38)
    return boxes


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
