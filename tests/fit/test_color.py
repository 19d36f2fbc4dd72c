"""Colours of primitives: which part of the surface counts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fit.air import find_air
from fit.color import color
from fit.glow import find_glow
from fit.primitives import PrimitiveSet, make_plane
from fit.scene import AlphaMode, Image, Instance, Material, Mesh, Scene, Texture, TextureUse
from fit.surface import from_scene
from fit.targets import see_surface


def colored(material: Material, pixels: np.ndarray) -> PrimitiveSet:
    """A sheet of 2 x 2 m with a texture, as the plane that stands for it."""
    corners = np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]], np.float64)
    uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float64)
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    mesh = Mesh("sheet", corners, np.tile([0.0, 1.0, 0.0], (4, 1)), triangles, 0, (uv,))
    scene = Scene(
        Path("built.gltf"),
        meshes=(mesh,),
        materials=(material,),
        textures=(Texture(0, linear=False),),
        images=(Image("image", pixels),),
        instances=(Instance(0, -1, np.eye(4)),),
    )
    air = find_air(from_scene(scene), scene, resolution=40)
    seen = see_surface(air, 8000, 0)
    return color(make_plane((0, 0, 0), 2, 2, 0.01), scene, air, seen, find_glow(scene, air))


@pytest.mark.parametrize("mode", [AlphaMode.MASK, AlphaMode.BLEND, AlphaMode.OPAQUE])
def test_a_cut_out_hole_has_no_colour(mode: AlphaMode) -> None:
    """Half of the texels are green leaf, the other half holes, red where nobody sees it."""
    pixels = np.zeros((8, 8, 4), np.uint8)
    leaf = np.indices((8, 8)).sum(axis=0) % 2 == 0
    pixels[leaf], pixels[~leaf] = (0, 255, 0, 255), (255, 0, 0, 10)
    texture = TextureUse(0)
    material = Material(
        base_color_texture=texture, alpha_mode=mode, emission=(2.0, 2.0, 2.0), double_sided=True
    )
    sheet = colored(material, pixels)
    if mode is AlphaMode.OPAQUE:
        np.testing.assert_allclose(sheet.albedo[0, 2], (0.5, 0.5, 0), atol=0.03)
        np.testing.assert_allclose(sheet.emission[0, 2], (2, 2, 2), atol=1e-6)
    else:
        np.testing.assert_allclose(sheet.albedo[0, 2:4], [(0, 1, 0)] * 2, atol=1e-6)
        np.testing.assert_allclose(sheet.emission[0, 2:4], np.ones((2, 3)), atol=0.06)
