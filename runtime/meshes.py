"""The scene's triangles on the GPU: one vertex and one index buffer, instances, materials, and how to draw
them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fit.scene import AlphaMode, Float64, Material, Mesh, Scene, TextureUse
from runtime.device import Gpu
from runtime.kernel import RasterKernel, Resource
from runtime.resources import Buffer, Sampler, Texture
from runtime.structs import GpuStruct, f32, mat4x4f, vec3f, vec4f
from runtime.textures import TextureLibrary

VERTEX = np.dtype(
    [
        ("position", "<f4", 3),
        ("normal", "<f4", 3),
        ("base_color_uv", "<f4", 2),
        ("emission_uv", "<f4", 2),
        ("roughness_uv", "<f4", 2),
        ("color", "<f2", 4),
    ]
)
"""One vertex; texture coordinates have the material's set and KHR_texture_transform applied."""

BLEND_CUTOFF = 0.5
"""A blended surface is drawn as an opaque one where its alpha reaches this, and is left out elsewhere."""


class Instance(GpuStruct):
    local_from_mesh: mat4x4f
    previous_local_from_mesh: mat4x4f


class SurfaceMaterial(GpuStruct):
    base_color: vec4f
    emission: vec3f
    alpha_cutoff: f32
    roughness: f32
    metallic: f32


@dataclass(frozen=True)
class Draw:
    """All instances of one mesh."""

    material: int
    index_count: int
    first_index: int
    base_vertex: int
    first_instance: int
    instance_count: int


class SceneMeshes:
    """Everything that a raster pass needs of a scene.

    Each mesh is stored around its own centre, and each instance's matrix leads from there to local space
    (world minus `origin`) in one float64 product, so that float32 is precise however far from its origin a
    file was modelled. Transmissive surfaces are left out, as `fit` leaves them out; `notes` says so.
    """

    def __init__(self, gpu: Gpu, scene: Scene, origin: Float64, max_texture_size: int) -> None:
        self.origin = np.asarray(origin, np.float64)
        self._scene = scene
        self._centers = [_center(mesh) for mesh in scene.meshes]
        self._order, self.draws = _plan(scene)
        self._textures = TextureLibrary(gpu, scene, max_texture_size)
        self._materials = [_resources(gpu, self._textures, _material(scene, k)) for k in _used(self.draws)]
        self._material_rows = {material: row for row, material in enumerate(_used(self.draws))}
        self._rows = {index: row for row, index in enumerate(self._order)}
        self._boxes = _boxes(scene, self._order)
        self._upload_geometry(gpu)
        self._placements = np.array([scene.instances[i].world_from_local for i in self._order]).reshape(
            -1, 4, 4
        )
        self._visible = np.ones(len(self._order), bool)
        self._previous = self._shown = self._placements
        room = max(len(self._order), 1) * Instance.dtype.itemsize
        self._instances = Buffer(gpu, room, "storage", label="instances")
        self._write_instances()
        self.notes = (*_material_notes(scene), *self._textures.notes)

    @property
    def triangle_count(self) -> int:
        """Triangles that one pass draws."""
        return sum(draw.index_count // 3 * draw.instance_count for draw in self.draws)

    @property
    def bytes(self) -> int:
        """GPU memory of triangles, instances and textures."""
        buffers = (self._vertices, self._indices, self._instances)
        return sum(buffer.size for buffer in buffers) + self._textures.bytes

    def bounds(self) -> tuple[Float64, Float64] | None:
        """Corners of the world-space box around the boxes of all drawn instances; None when nothing is
        drawn."""
        if not self._visible.any():
            return None
        center, half = self._boxes
        linear = self._placements[:, :3, :3]
        middle = np.einsum("nij,nj->ni", linear, center) + self._placements[:, :3, 3]
        reach = np.einsum("nij,nj->ni", np.abs(linear), half)
        seen = self._visible
        return (middle - reach)[seen].min(axis=0), (middle + reach)[seen].max(axis=0)

    def move(self, instances: dict[int, Float64]) -> None:
        """Places instances (index into `scene.instances` -> world_from_local) for the next frame.

        Raises:
            KeyError: an index that is not drawn.
        """
        placements = self._placements.copy()
        for index, world_from_local in instances.items():
            placements[self._rows[index]] = world_from_local
        self._placements = placements
        self._show()

    def show(self, visible: Mapping[int, bool]) -> None:
        """Lets instances (index into `scene.instances`) vanish or appear for the next frame.

        Raises:
            KeyError: an index that is not drawn.
        """
        for index, is_visible in visible.items():
            self._visible[self._rows[index]] = is_visible
        self._show()

    def placements(self, instances: Iterable[int]) -> dict[int, Float64]:
        """world_from_local of instances as they are drawn: one that has vanished is shrunk to a point."""
        return {index: self._shown[self._rows[index]] for index in instances}

    def set_emission(self, material: int, emission: tuple[float, float, float]) -> None:
        """Replaces what a material emits, W/m2/sr, before its texture.

        Raises:
            KeyError: nothing that is drawn has that material.
        """
        buffer = self._materials[self._material_rows[material]]["material"]
        assert isinstance(buffer, Buffer)
        buffer.write(_surface_record(replace(_material(self._scene, material), emission=emission)))

    def end_frame(self) -> None:
        """Makes this frame's placements the previous ones."""
        if self._previous is not self._shown:
            self._previous = self._shown
            self._write_instances()

    def _show(self) -> None:
        """Places what is visible; the rest shrinks to a point, of which nothing is drawn."""
        shown = self._placements
        if not self._visible.all():
            shown = shown.copy()
            shown[~self._visible, :3, :3] = 0.0
        self._shown = shown
        self._write_instances()

    def draw(
        self,
        render_pass: Any,
        kernel: RasterKernel,
        shared: Sequence[dict[str, Resource]] = (),
        **bindings: Resource,
    ) -> None:
        """Draws every triangle with a kernel that imports `primary/surface`."""
        render_pass.set_vertex_buffer(0, self._vertices.wgpu_buffer)
        render_pass.set_index_buffer(self._indices.wgpu_buffer, "uint32")
        bound: int | None = None
        for draw in self.draws:
            if draw.material != bound:
                material = self._materials[self._material_rows[draw.material]]
                kernel.bind(render_pass, *shared, {**material, "instances": self._instances}, **bindings)
                bound = draw.material
            render_pass.draw_indexed(
                draw.index_count, draw.instance_count, draw.first_index, draw.base_vertex, draw.first_instance
            )

    def _upload_geometry(self, gpu: Gpu) -> None:
        used = _used_meshes(self._scene)
        vertices = [_vertices(self._scene, k, self._centers[k]) for k in used]
        indices = [self._scene.meshes[k].triangles.astype(np.uint32).ravel() for k in used]
        all_vertices = np.concatenate(vertices or [np.zeros(1, VERTEX)])
        all_indices = np.concatenate(indices or [np.zeros(3, np.uint32)])
        _check_size(gpu, self._scene, all_vertices, "vertices")
        _check_size(gpu, self._scene, all_indices, "indices")
        self._vertices = Buffer(gpu, all_vertices, "vertex", label="vertices")
        self._indices = Buffer(gpu, all_indices, "index", label="indices")

    def _write_instances(self) -> None:
        if not self._order:
            return
        records = Instance.pack_array(
            len(self._order),
            local_from_mesh=self._local(self._shown),
            previous_local_from_mesh=self._local(self._previous),
        )
        self._instances.write(records)

    def _local(self, placements: Float64) -> Float64:
        """Mesh-centred positions to local space, (n, 4, 4)."""
        centers = np.array([self._centers[self._scene.instances[i].mesh] for i in self._order])
        local = placements.copy()
        local[:, :3, 3] += np.einsum("nij,nj->ni", placements[:, :3, :3], centers) - self.origin
        return local


def _is_drawn(scene: Scene, mesh: int) -> bool:
    return (
        len(scene.meshes[mesh].triangles) > 0
        and _material(scene, scene.meshes[mesh].material).transmission == 0
    )


def _used_meshes(scene: Scene) -> list[int]:
    return [k for k in sorted({instance.mesh for instance in scene.instances}) if _is_drawn(scene, k)]


def _plan(scene: Scene) -> tuple[list[int], list[Draw]]:
    """Scene instances in the order of the instance buffer, and the draws, those of one material together."""
    by_mesh: dict[int, list[int]] = {k: [] for k in _used_meshes(scene)}
    for index, instance in enumerate(scene.instances):
        if instance.mesh in by_mesh:
            by_mesh[instance.mesh].append(index)
    order: list[int] = []
    draws: list[Draw] = []
    first_index = base_vertex = 0
    for k, members in by_mesh.items():
        mesh = scene.meshes[k]
        count = mesh.triangles.size
        draws.append(Draw(mesh.material, count, first_index, base_vertex, len(order), len(members)))
        order += members
        first_index += count
        base_vertex += len(mesh.positions)
    return order, sorted(draws, key=lambda draw: draw.material)


def _used(draws: Sequence[Draw]) -> list[int]:
    return sorted({draw.material for draw in draws})


def _material(scene: Scene, index: int) -> Material:
    return scene.materials[index] if 0 <= index < len(scene.materials) else Material()


def _center(mesh: Mesh) -> Float64:
    if len(mesh.positions) == 0:
        return np.zeros(3)
    return (mesh.positions.min(axis=0) + mesh.positions.max(axis=0)) / 2


def _vertices(scene: Scene, index: int, center: Float64) -> np.ndarray:
    mesh = scene.meshes[index]
    material = _material(scene, mesh.material)
    vertices = np.zeros(len(mesh.positions), VERTEX)
    vertices["position"] = mesh.positions - center
    vertices["normal"] = mesh.normals
    vertices["base_color_uv"] = _texcoords(mesh, material.base_color_texture)
    vertices["emission_uv"] = _texcoords(mesh, material.emission_texture)
    vertices["roughness_uv"] = _texcoords(mesh, material.metallic_roughness_texture)
    vertices["color"] = 1.0 if mesh.colors is None else mesh.colors
    return vertices


def _texcoords(mesh: Mesh, use: TextureUse | None) -> Float64:
    if use is None or use.texcoord >= len(mesh.texcoords):
        base = np.zeros((len(mesh.positions), 2))
    else:
        base = mesh.texcoords[use.texcoord]
    return base if use is None else base @ use.transform[:2, :2].T + use.transform[:2, 2]


def _resources(
    gpu: Gpu, textures: TextureLibrary, material: Material
) -> dict[str, Buffer | Texture | Sampler]:
    """What `primary/surface` binds for a material."""
    base_color, base_color_sampler = textures.get(material.base_color_texture, srgb=True)
    emission, emission_sampler = textures.get(material.emission_texture, srgb=True)
    roughness, roughness_sampler = textures.get(material.metallic_roughness_texture, srgb=False)
    return {
        "material": Buffer(gpu, _surface_record(material), "uniform", label=material.name),
        "base_color_texture": base_color,
        "base_color_sampler": base_color_sampler,
        "emission_texture": emission,
        "emission_sampler": emission_sampler,
        "roughness_texture": roughness,
        "roughness_sampler": roughness_sampler,
    }


def _surface_record(material: Material) -> np.ndarray:
    cutoff = {AlphaMode.OPAQUE: -1.0, AlphaMode.MASK: material.alpha_cutoff, AlphaMode.BLEND: BLEND_CUTOFF}
    return SurfaceMaterial.pack(
        base_color=material.base_color,
        emission=material.emission,
        alpha_cutoff=cutoff[material.alpha_mode],
        roughness=material.roughness,
        metallic=material.metallic,
    )


def _boxes(scene: Scene, instances: Sequence[int]) -> tuple[Float64, Float64]:
    """Centres and half extents (n, 3) of instances' boxes in their meshes' own space."""
    lower = [mesh.positions.min(axis=0, initial=np.inf) for mesh in scene.meshes]
    upper = [mesh.positions.max(axis=0, initial=-np.inf) for mesh in scene.meshes]
    used = [scene.instances[index].mesh for index in instances]
    low, high = np.array(lower).reshape(-1, 3)[used], np.array(upper).reshape(-1, 3)[used]
    return (low + high) / 2, (high - low) / 2


def _material_notes(scene: Scene) -> tuple[str, ...]:
    clear = sum(material.transmission > 0 for material in scene.materials)
    unlit = sum(material.unlit for material in scene.materials)
    return (
        *((f"{clear} transmissive materials are not drawn",) * (clear > 0)),
        *((f"{unlit} unlit materials are lit like any other",) * (unlit > 0)),
    )


def _check_size(gpu: Gpu, scene: Scene, buffer: np.ndarray, what: str) -> None:
    limit = gpu.limits["max-buffer-size"]
    if buffer.nbytes > limit:
        raise ValueError(
            f"{scene.source}: {what} take {buffer.nbytes >> 20} MiB, a GPU buffer holds {limit >> 20}: "
            "simplify the meshes, or draw copies of one mesh as instances"
        )
