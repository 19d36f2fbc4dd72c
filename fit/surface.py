"""The scene as one soup of world-space triangles, and the colour of any point on it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fit.backdrop import find_backdrops
from fit.scene import AlphaMode, Float64, Image, Material, Mesh, Scene, TextureUse, Wrap, transform_points

Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

TRANSPARENT_ALPHA = 0.5
"""A blended face of less mean alpha is seen through: it is no wall."""

_ALPHA_BARYCENTRICS = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4], [2, 2, 2]]) / 6.0
"""Where a face's mean alpha is sampled: its centre and half-way to each corner."""


@dataclass(frozen=True)
class Surface:
    """t triangles in world space, of non-zero area, in the order of the scene's instances.

    vertices (t, 3, 3) float64, counter-clockwise seen from the front, mirrored instances too;
    normals (t, 3) float64, unit, geometric, to the front; areas (t,) float64;
    instance, mesh, material (t,) int32: indices into the scene's tuples; triangle (t,) int32: row of
    the mesh's `triangles`; is_wall (t,) bool: False where the face is seen through (alpha-blended under
    alpha 0.5, or transmissive) or is of a backdrop, a face masked by alpha is a wall as a whole;
    double_sided (t,) bool.
    """

    vertices: Float64
    normals: Float64
    areas: Float64
    instance: Int32
    mesh: Int32
    material: Int32
    triangle: Int32
    is_wall: Bool
    double_sided: Bool

    def __len__(self) -> int:
        return len(self.areas)

    @cached_property
    def bounds(self) -> tuple[Float64, Float64]:
        """Corners (3,), (3,) of the box around all triangles; both zero when there is none."""
        if len(self) == 0:
            return np.zeros(3), np.zeros(3)
        corners = [self.vertices[:, k] for k in range(3)]
        return np.min([c.min(axis=0) for c in corners], axis=0), np.max(
            [c.max(axis=0) for c in corners], axis=0
        )

    @property
    def center(self) -> Float64:
        """Centre (3,) of the bounds."""
        lower, upper = self.bounds
        return (lower + upper) / 2

    @property
    def diagonal(self) -> float:
        """Length of the bounds' diagonal."""
        lower, upper = self.bounds
        return float(np.linalg.norm(upper - lower))

    def select(self, index: NDArray[np.generic]) -> Surface:
        """The triangles of an index array or a mask."""
        return Surface(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    def walls(self) -> Surface:
        """The triangles that stop light; the surface itself when all do."""
        return self if bool(self.is_wall.all()) else self.select(self.is_wall)


def from_triangles(vertices: Float64, *, double_sided: bool = False) -> Surface:
    """A surface of bare opaque triangles (t, 3, 3), as one instance; those of zero area are left out."""
    corners, normals, areas, kept = oriented(np.array(vertices, dtype=np.float64).reshape(-1, 3, 3))
    zeros = np.zeros(len(kept), np.int32)
    return Surface(
        corners,
        normals,
        areas,
        zeros,
        zeros,
        zeros,
        kept,
        np.ones(len(kept), bool),
        np.full(len(kept), double_sided),
    )


def from_scene(scene: Scene) -> Surface:
    """Every drawn triangle of the scene in world space; those of zero area are left out."""
    backdrops = find_backdrops(scene)
    parts = [_instance_surface(scene, i) for i in range(len(scene.instances))]
    if not parts:
        return from_triangles(np.zeros((0, 3, 3)))
    joined = {}
    for name in [f.name for f in fields(Surface)]:
        joined[name] = np.concatenate([getattr(part, name) for part in parts])
        for part in parts:  # gives each piece back as soon as it is copied: millions of triangles
            object.__setattr__(part, name, None)
    if backdrops:
        joined["is_wall"] &= ~np.isin(joined["instance"], backdrops)
    return Surface(**joined)


def _instance_surface(scene: Scene, index: int) -> Surface:
    instance = scene.instances[index]
    mesh = scene.meshes[instance.mesh]
    corners = transform_points(instance.world_from_local, mesh.positions)[_corner_rows(scene, index, mesh)]
    corners, normals, areas, kept = oriented(corners)
    material = _material(scene, mesh)
    return Surface(
        vertices=corners,
        normals=normals,
        areas=areas,
        instance=np.full(len(kept), index, np.int32),
        mesh=np.full(len(kept), instance.mesh, np.int32),
        material=np.full(len(kept), mesh.material, np.int32),
        triangle=kept,
        is_wall=_walls(scene, mesh, material, kept),
        double_sided=np.full(len(kept), material.double_sided),
    )


def _corner_rows(
    scene: Scene, instance: int, mesh: Mesh, triangles: Int32 | None = None
) -> NDArray[np.uint32]:
    """Vertex rows (k, 3) of a mesh's triangles in the order `Surface.vertices` has them.

    A mirroring transform turns the front of a triangle to its back; two corners change places to undo it.
    """
    rows = mesh.triangles if triangles is None else mesh.triangles[triangles]
    mirrored = np.linalg.det(scene.instances[instance].world_from_local[:3, :3]) < 0
    return rows[:, [0, 2, 1]] if mirrored else rows


def oriented(corners: Float64) -> tuple[Float64, Float64, Float64, Int32]:
    """Corners, unit normals, areas and rows of the triangles whose area is not zero."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double_areas = np.linalg.norm(cross, axis=1)
    kept = np.flatnonzero(double_areas > 0).astype(np.int32)
    if len(kept) < len(corners):
        corners, cross, double_areas = corners[kept], cross[kept], double_areas[kept]
    return corners, cross / double_areas[:, None], double_areas / 2, kept


def _material(scene: Scene, mesh: Mesh) -> Material:
    return scene.materials[mesh.material] if 0 <= mesh.material < len(scene.materials) else Material()


def _walls(scene: Scene, mesh: Mesh, material: Material, triangles: Int32) -> Bool:
    if material.transmission > 0:
        return np.zeros(len(triangles), bool)
    if material.alpha_mode is not AlphaMode.BLEND:
        return np.ones(len(triangles), bool)
    rows = mesh.triangles[triangles]
    alpha = np.zeros(len(triangles))
    for weights in _ALPHA_BARYCENTRICS:
        barycentric = np.broadcast_to(weights, (len(triangles), 3))
        alpha += _base_color(scene, mesh, material, rows, barycentric)[:, 3] / len(_ALPHA_BARYCENTRICS)
    return alpha >= TRANSPARENT_ALPHA


# ------------------------------------------------------------------------------------------------ colour


def colors(
    scene: Scene, surface: Surface, triangle: NDArray[np.integer], barycentric: Float64
) -> tuple[Float64, Float64, Float64]:
    """Colour of points on the surface, textures and vertex colours included.

    triangle (p,): rows of `surface`; barycentric (p, 3): weights of `surface.vertices[triangle]`.
    Returns linear albedo (p, 3), emission (p, 3) in W/m2/sr, and alpha (p,) before any cutoff.
    """
    albedo, emission, alpha = (
        np.empty((len(triangle), 3)),
        np.empty((len(triangle), 3)),
        np.empty(len(triangle)),
    )
    for instance, members in _groups(surface.instance[triangle]):
        mesh = scene.meshes[scene.instances[instance].mesh]
        material = _material(scene, mesh)
        rows = _corner_rows(scene, instance, mesh, surface.triangle[triangle[members]])
        base = _base_color(scene, mesh, material, rows, barycentric[members])
        albedo[members], alpha[members] = base[:, :3], base[:, 3]
        emission[members] = material.emission
        if material.emission_texture is not None and any(material.emission):
            texels = _texture(scene, mesh, material.emission_texture, rows, barycentric[members], srgb=True)
            emission[members] *= texels[:, :3]
    return albedo, emission, alpha


def _groups(labels: NDArray[np.integer]) -> Iterator[tuple[int, Int64]]:
    """Each distinct label, ascending, with the positions that hold it."""
    order = np.argsort(labels, kind="stable")
    values, starts = np.unique(labels[order], return_index=True)
    for value, members in zip(values, np.split(order, starts[1:]), strict=False):
        yield int(value), members


def _base_color(
    scene: Scene, mesh: Mesh, material: Material, rows: NDArray[np.uint32], barycentric: Float64
) -> Float64:
    color = np.tile(np.asarray(material.base_color, np.float64), (len(rows), 1))
    if material.base_color_texture is not None:
        color *= _texture(scene, mesh, material.base_color_texture, rows, barycentric, srgb=True)
    if mesh.colors is not None:
        color *= _interpolate(mesh.colors, rows, barycentric)
    return color


def _interpolate(values: Float64, rows: NDArray[np.uint32], barycentric: Float64) -> Float64:
    return np.einsum("pc,pck->pk", barycentric, values[rows])


def _texture(
    scene: Scene, mesh: Mesh, use: TextureUse, rows: NDArray[np.uint32], barycentric: Float64, *, srgb: bool
) -> Float64:
    if use.texcoord >= len(mesh.texcoords):
        uv = np.zeros((len(rows), 2))
    else:
        uv = _interpolate(mesh.texcoords[use.texcoord], rows, barycentric)
    uv = uv @ use.transform[:2, :2].T + use.transform[:2, 2]
    texture = scene.textures[use.texture]
    return sample_image(
        scene.images[texture.image], uv, texture.wrap_u, texture.wrap_v, texture.linear, srgb=srgb
    )


def sample_image(
    image: Image, uv: Float64, wrap_u: Wrap, wrap_v: Wrap, linear: bool = True, *, srgb: bool = True
) -> Float64:
    """Linear RGBA (p, 4) of an image at texture coordinates (p, 2), v downward, texels at half-integers.

    `linear` filters bilinearly, after decoding sRGB as the glTF specification asks; else the nearest texel.
    """
    height, width = image.pixels.shape[:2]
    x, y = uv[:, 0] * width, uv[:, 1] * height
    if not linear:
        return _texels(
            image, _wrapped(np.floor(x), width, wrap_u), _wrapped(np.floor(y), height, wrap_v), srgb
        )
    left, top = np.floor(x - 0.5), np.floor(y - 0.5)
    fraction_x, fraction_y = (x - 0.5 - left)[:, None], (y - 0.5 - top)[:, None]
    columns = [_wrapped(left + k, width, wrap_u) for k in (0, 1)]
    lines = [_wrapped(top + k, height, wrap_v) for k in (0, 1)]
    upper, lower = (
        (1 - fraction_x) * _texels(image, columns[0], line, srgb)
        + fraction_x * _texels(image, columns[1], line, srgb)
        for line in lines
    )
    return (1 - fraction_y) * upper + fraction_y * lower


def _wrapped(index: Float64, size: int, wrap: Wrap) -> Int64:
    if wrap is Wrap.CLAMP:
        return np.clip(index, 0, size - 1).astype(np.int64)
    if wrap is Wrap.MIRROR:
        folded = np.mod(index, 2 * size)
        return np.minimum(folded, 2 * size - 1 - folded).astype(np.int64)
    return np.mod(index, size).astype(np.int64)


def _texels(image: Image, x: Int64, y: Int64, srgb: bool) -> Float64:
    stored = image.pixels[y, x]
    texels = stored / 255.0
    if srgb:
        texels[:, :3] = _LINEAR_FROM_SRGB[stored[:, :3]]
    return texels


def _linear_from_srgb_table() -> Float64:
    """IEC 61966-2-1 decoding of each byte."""
    code = np.arange(256) / 255.0
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


_LINEAR_FROM_SRGB = _linear_from_srgb_table()
