"""Light under an even sky, and the colour of faces that shut openings."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh

from fit.air import find_air
from fit.color import color
from fit.glow import find_glow
from fit.light import EvenLight, cosine_directions
from fit.openings import reflected_shares
from fit.primitives import PrimitiveSet, make_box
from fit.scene import Material, Scene
from fit.spaces import Air
from fit.surface import from_scene, from_triangles
from fit.targets import Seen, see_surface
from pipelines.reference.triangulate import triangulate
from runtime.lights import Illumination, Sun
from runtime.path_tracer import PathTracer
from runtime.sky import Sky

ALBEDO = 0.6

Box = tuple[tuple[float, float, float], tuple[float, float, float]]

GALLERY: list[Box] = [
    ((0, -0.25, 0), (12, 0.5, 12)),  # the floor of gallery and court
    ((0, 2, -5.75), (12, 4, 0.5)),
    ((0, 4.25, -3), (12, 0.5, 6)),
    ((-5.75, 2, -2.75), (0.5, 4, 5.5)),
    ((5.75, 2, -2.75), (0.5, 4, 5.5)),
]
"""A dark gallery of 11 x 4 x 5.5 m; its front, at z = 0, is left open."""

PIERS: list[Box] = [((x, 2, 0.15), (2, 4, 0.3)) for x in (-5, -1, 3)]
"""Half of that front; between them, and beside the last, openings of the other half."""

FRONT: Box = ((0, 2, 0.15), (12, 4, 0.3))


def boxes(places: list[Box]) -> PrimitiveSet:
    return PrimitiveSet.concatenate([make_box(center, size) for center, size in places])


@pytest.fixture(scope="module")
def gallery(mesh_of_boxes: Any) -> tuple[Scene, Air, Seen]:
    """The gallery with its piers, of one albedo."""
    material = Material(base_color=(ALBEDO, ALBEDO, ALBEDO, 1.0))
    scene: Scene = mesh_of_boxes(boxes(GALLERY + PIERS), material)
    air = find_air(from_scene(scene), scene, resolution=80)
    return scene, air, see_surface(air, 12_000, 0)


def test_a_sphere_with_a_hole_is_as_bright_as_an_integrating_sphere() -> None:
    """All of its inside sees the hole alike: B = rho f / (1 - rho (1 - f)) for a hole of the share f."""
    ball = trimesh.creation.icosphere(5)
    triangles = ball.triangles[ball.triangles_center[:, 1] < 0.5]
    air = find_air(from_triangles(triangles, double_sided=True), resolution=60)
    seen = see_surface(air, 8000, 0)
    light = EvenLight.of(air, seen, np.full(len(seen), ALBEDO))
    inside = np.einsum("pk,pk->p", seen.normals, seen.samples.points) < 0
    hole = 0.25
    expected = ALBEDO * hole / (1 - ALBEDO * (1 - hole))
    assert light.radiance[inside].mean() == pytest.approx(expected, rel=0.04)
    assert light.radiance[~inside].mean() == pytest.approx(ALBEDO, rel=1e-6)


def test_directions_follow_the_cosine() -> None:
    normals = np.tile([0.0, 0.6, 0.8], (20_000, 1))
    directions = cosine_directions(normals, 0)
    cosine = np.einsum("pk,pk->p", directions, normals)
    assert cosine.min() >= 0
    assert (cosine.mean(), (cosine**2).mean()) == pytest.approx((2 / 3, 1 / 2), abs=0.01)


def test_a_slab_across_an_arcade_is_as_dark_as_its_arches(gallery: tuple[Scene, Air, Seen]) -> None:
    scene, air, seen = gallery
    shut = color(boxes([*GALLERY, FRONT]), scene, air, seen, find_glow(scene, air))
    towards_court, towards_gallery = shut.albedo[-1, 4:6, 0]
    # Half of it is wall; the gallery sends back some of what falls into it, less than the wall would.
    assert 0.52 * ALBEDO < towards_court < 0.75 * ALBEDO
    # From inside, the openings are brighter than any wall could be.
    assert towards_gallery == pytest.approx(ALBEDO, abs=1e-3)
    np.testing.assert_allclose(shut.albedo[0, 2], ALBEDO, atol=1e-3)  # the floor


def test_a_court_before_a_shut_arcade_gets_the_light_of_an_open_one(
    gpu: Any, gallery: tuple[Scene, Air, Seen]
) -> None:
    """Path traced in sun and sky; a slab in the wall's own colour makes the court a quarter too bright."""
    scene, air, seen = gallery
    light = Illumination((Sun((0.3, 0.6, 0.8), 12.0),), Sky.constant((0.4, 0.5, 0.7)))
    x, z = np.meshgrid(np.linspace(-4.5, 4.5, 16), np.linspace(0.6, 4, 16))
    points = np.stack([x.ravel(), np.full(x.size, 1e-3), z.ravel()], axis=1)
    normals = np.tile([0.0, 1.0, 0.0], (x.size, 1))

    def irradiance(of: Scene) -> float:
        return float(PathTracer(gpu, of, light).irradiance(points, normals, samples=64).value.mean())

    dimmed = color(boxes([*GALLERY, FRONT]), scene, air, seen, find_glow(scene, air))
    plain = boxes([*GALLERY, FRONT]).with_uniform_color((ALBEDO, ALBEDO, ALBEDO))
    truth = irradiance(scene)
    assert irradiance(triangulate(plain)) > 1.25 * truth
    assert irradiance(triangulate(dimmed)) == pytest.approx(truth, rel=0.06)


def test_faces_that_shut_nothing_keep_all_their_albedo(gallery: tuple[Scene, Air, Seen]) -> None:
    _, air, seen = gallery
    light = EvenLight.of(air, seen, np.full(len(seen), ALBEDO))
    gray = boxes(GALLERY + PIERS).with_uniform_color((ALBEDO, ALBEDO, ALBEDO))
    np.testing.assert_allclose(reflected_shares(gray, light), 1.0, atol=1e-3)


def test_nothing_changes_where_no_sky_shines() -> None:
    """A sealed room, of which the inside alone is air."""
    room = trimesh.creation.box((4, 3, 4))
    room.invert()
    air = find_air(from_triangles(room.triangles), resolution=40, seeds=[(0.0, 0.0, 0.0)])
    seen = see_surface(air, 1000, 0)
    light = EvenLight.of(air, seen, np.full(len(seen), ALBEDO))
    assert not light.radiance.any()
    assert (reflected_shares(make_box((0, 0, 0), (1, 1, 1)), light) == 1).all()
