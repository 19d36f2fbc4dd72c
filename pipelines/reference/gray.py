"""Scenes and sets with an albedo of 0.5 everywhere: what is left of an error then is the geometry's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fit.primitives import PrimitiveSet
from fit.scene import AlphaMode, Image, Material, Mesh, Scene, Texture

ALBEDO = 0.5


def gray_scene(scene: Scene) -> Scene:
    """The scene with one albedo; cut-outs and emission stay."""
    images, textures = list(scene.images), list(scene.textures)
    materials = [_gray_material(material, images, textures) for material in scene.materials]
    return replace(
        scene,
        materials=(*materials, _painted(Material())),
        meshes=tuple(_gray_mesh(mesh, len(materials)) for mesh in scene.meshes),
        images=tuple(images),
        textures=tuple(textures),
    )


def gray_set(primitives: PrimitiveSet) -> PrimitiveSet:
    """The set with one albedo; emission stays."""
    return replace(primitives, albedo=np.full_like(primitives.albedo, ALBEDO))


def _painted(material: Material) -> Material:
    return replace(material, base_color=(ALBEDO, ALBEDO, ALBEDO, material.base_color[3]))


def _gray_material(material: Material, images: list[Image], textures: list[Texture]) -> Material:
    """A picture that cuts holes keeps its alpha, as a new white one: its own may also be a lamp's."""
    use = material.base_color_texture
    if use is None:
        return _painted(material)
    if material.alpha_mode is AlphaMode.OPAQUE:
        return replace(_painted(material), base_color_texture=None)
    texture = textures[use.texture]
    pixels = images[texture.image].pixels.copy()
    pixels[..., :3] = 255
    images.append(Image(f"{images[texture.image].name}, white", pixels))
    textures.append(replace(texture, image=len(images) - 1))
    return replace(_painted(material), base_color_texture=replace(use, texture=len(textures) - 1))


def _gray_mesh(mesh: Mesh, materials: int) -> Mesh:
    """`materials` is the place of the one that meshes without a material get."""
    colors = mesh.colors
    if colors is not None:
        colors = np.concatenate([np.ones_like(colors[:, :3]), colors[:, 3:]], axis=1)
    return replace(
        mesh, colors=colors, material=mesh.material if 0 <= mesh.material < materials else materials
    )
