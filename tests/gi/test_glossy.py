"""Reflections: a mirror shows what it should, roughness blurs it, and no energy is made or lost."""

import numpy as np
import pytest

from fit.primitives import PrimitiveSet, make_box
from fit.scene import Instance, Material, Mesh, Scene
from runtime.camera import look_at
from runtime.ddgi import DdgiSettings
from runtime.lights import Illumination
from runtime.probes import ProbeGrid
from runtime.renderer import Renderer
from runtime.settings import RenderSettings, ShadowSettings
from runtime.sky import Sky

SIZE = (64, 48)
FLOOR = make_box((0, -0.05, 0), (40, 0.1, 40), albedo=(0, 0, 0))
LAMP = make_box((0, 1.5, -3.05), (1.0, 1.0, 0.1), albedo=(0, 0, 0), emission=(4.0, 2.0, 1.0))
CAMERA = look_at(np.array([0.0, 1.5, 3.0]), np.array([0.0, 0.0, -0.5]), 50)
"""The floor mirrors the lamp at z = 0, in the middle of the picture: 1.5 m of height on 3 m of depth."""


def stage(roughness: float, metalness: float = 1.0) -> tuple[Scene, PrimitiveSet]:
    """A floor and a square lamp that faces the viewer."""
    square = np.array([(-0.5, -0.5, 0), (0.5, -0.5, 0), (0.5, 0.5, 0), (-0.5, 0.5, 0)])
    triangles = np.array([(0, 1, 2), (0, 2, 3)], np.uint32)

    def mesh(corners: np.ndarray, normal: tuple[float, float, float], material: int) -> Mesh:
        return Mesh("square", corners, np.tile(np.array(normal, float), (4, 1)), triangles, material)

    floor = Material(base_color=(1, 1, 1, 1), roughness=roughness, metallic=metalness)
    lamp = Material(base_color=(0, 0, 0, 1), emission=(4.0, 2.0, 1.0), metallic=0.0)
    flat = square[:, [0, 2, 1]] * (40, 1, -40)
    scene = Scene(
        source="mirror.glb",
        meshes=(mesh(flat, (0, 1, 0), 0), mesh(square + np.array((0, 1.5, -3.0)), (0, 0, 1), 1)),
        materials=(floor, lamp),
        instances=(Instance(0, -1, np.eye(4)), Instance(1, -1, np.eye(4))),
    )
    return scene, PrimitiveSet.concatenate([FLOOR, LAMP])


def picture(gpu, roughness, *, metalness=1.0, sky=None, glossy=True, tracer="primitives") -> np.ndarray:
    scene, primitives = stage(roughness, metalness)
    technique = DdgiSettings(grid=ProbeGrid((-2.0, 0.2, -3.0), 2.0, (3, 2, 3)), tracer=tracer, hysteresis=0.5)
    settings = RenderSettings(
        SIZE, gi="ddgi", technique=technique, glossy=glossy, shadows=ShadowSettings(map_size=64)
    )
    renderer = Renderer(gpu, scene, primitives, settings, Illumination(sky=sky or Sky()))
    return renderer.render(CAMERA, frames=1, settle=4).images["final"]


@pytest.mark.parametrize("tracer", ["primitives", "triangles"])
def test_a_perfect_mirror_shows_the_lamp_as_it_is(gpu, tracer):
    seen = picture(gpu, 0.0, tracer=tracer)
    np.testing.assert_allclose(seen[SIZE[1] // 2 + 2, SIZE[0] // 2], (4, 2, 1), rtol=0.01)
    assert np.all(seen[-2, 2] == 0)  # the floor beside it mirrors the black sky


def test_without_reflections_a_metal_is_as_diffuse_as_all_else(gpu):
    assert picture(gpu, 0.0, glossy=False)[SIZE[1] // 2 + 2, SIZE[0] // 2].max() < 1.0


def test_roughness_blurs_and_keeps_what_is_sent_on(gpu):
    """The lamp's mirror image gets wider and darker; in the picture's middle it never gets brighter."""
    pictures = [picture(gpu, roughness)[..., 0] for roughness in (0.0, 0.3, 0.45)]
    floor = np.s_[SIZE[1] // 2 - 6 :, :]
    brightest = [image[floor].max() for image in pictures]
    spread = [np.count_nonzero(image[floor] > 0.1 * image[floor].max()) for image in pictures]
    assert brightest[0] >= brightest[1] > brightest[2]
    assert spread[0] < spread[1] < spread[2]


@pytest.mark.parametrize(("roughness", "error"), [(0.0, 0.001), (0.15, 0.03), (0.6, 0.12), (1.0, 0.03)])
def test_under_a_white_sky_a_white_metal_cannot_be_told_from_it(gpu, roughness, error):
    """In between, the probes' half sphere reaches below the horizon."""
    sky = Sky.constant((2.0, 2.0, 2.0))
    floor = picture(gpu, roughness, sky=sky)[-8:, 4:-4]
    np.testing.assert_allclose(floor, 2.0, rtol=error)


def test_glass_over_white_neither_gains_nor_loses(gpu):
    """A white dielectric: what is not mirrored is diffuse."""
    sky = Sky.constant((2.0, 2.0, 2.0))
    floor = picture(gpu, 0.2, metalness=0.0, sky=sky)[-8:, 4:-4]
    np.testing.assert_allclose(floor, 2.0, rtol=0.05)


def test_its_texture_is_a_view(gpu):
    scene, primitives = stage(0.0)
    settings = RenderSettings(SIZE, gi="none", glossy=True, shadows=ShadowSettings(map_size=64))
    renderer = Renderer(gpu, scene, primitives, settings, Illumination())
    assert "glossy/mirror" in renderer.all_views()
    mirror = renderer.render(CAMERA, only=("glossy/mirror",)).images["glossy/mirror"]
    assert mirror.shape == (SIZE[1] // 2, SIZE[0] // 2, 3)
    assert mirror.max() == pytest.approx(4.0, rel=0.01)
