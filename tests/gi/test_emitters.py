"""What shines is drawn by its power: light is right for every kind of surface, small lamps are not noisy."""

from dataclasses import replace

import numpy as np
import pytest

from fit.primitives import (
    PrimitiveSet,
    make_box,
    make_cylinder,
    make_half_space,
    make_plane,
    make_sphere,
    pack_gpu,
    unpack_gpu,
)
from fit.scene import Instance, Material
from runtime.emitters import emitters_of, primitive_emitters
from runtime.lights import Illumination
from runtime.path_tracer import PathTracer
from runtime.probes import ProbeGrid
from runtime.twins import reference

PLACE, TILT, DARK = (0.1, 0.2, 0.0), (0.36, 0.48, 0.0, 0.8), (0.0, 0.0, 0.0)
A, B = (4.0, 1.0, 1.0), (1.0, 2.0, 5.0)

LAMPS = {
    "box": make_box(PLACE, (0.5, 0.3, 0.7), TILT, DARK, [A, DARK, B, A, DARK, B]),
    "sphere": make_sphere(PLACE, 0.3, DARK, A),
    "cylinder's side": make_cylinder(PLACE, 0.2, 0.7, TILT, DARK, [A, A, DARK, B, A, A]),
    "cylinder's caps": make_cylinder(PLACE, 0.4, 0.1, TILT, DARK, [DARK, DARK, A, B, DARK, DARK]),
    "plane": make_plane(PLACE, 0.6, 0.8, 0.02, TILT, DARK, [DARK, DARK, A, B, DARK, DARK]),
}

SMALL_LAMP = make_box((0.4, 1.45, 0.3), (0.15, 0.1, 0.15), albedo=DARK, emission=(200.0, 200.0, 200.0))
GRID = ProbeGrid((-1.0, -1.0, -1.0), 1.0, (3, 3, 3))


@pytest.fixture
def tracer(gpu, mesh_of_boxes):
    """Path tracer of a set of primitives in the dark."""
    return lambda primitives: PathTracer(gpu, mesh_of_boxes(make_box()), Illumination(), primitives)


def points_around(count: int):
    """Points 1 m from a lamp, looking past it by up to a radian."""
    rng = np.random.default_rng(3)
    ways = rng.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    normals = -ways + 0.5 * rng.uniform(-1, 1, (count, 3))
    return PLACE + ways, normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("name", LAMPS)
def test_light_of_each_kind_of_lamp_is_that_of_rays_that_meet_it_by_chance(tracer, name):
    lamp, (points, normals) = LAMPS[name], points_around(300)
    found = tracer(lamp).irradiance(points, normals, samples=128)
    stored = unpack_gpu(pack_gpu(lamp))
    chance = [
        reference.indirect_irradiance(stored, points, normals, samples=150, seed=seed) for seed in (1, 2)
    ]
    difference = found.value - sum(chance) / 2
    error = (chance[0] - chance[1]).std(axis=0) / 2 / np.sqrt(len(points))  # each channel tells other faces
    assert error.max() < 0.03 * found.value.mean()
    assert np.abs(difference.mean(axis=0) / error).max() < 4
    assert found.noise < 0.15


def test_a_ball_lights_as_its_closed_form_says(tracer):
    """E = pi L (r / d)^2 for a surface that faces a ball."""
    points, _ = points_around(500)
    found = tracer(LAMPS["sphere"]).irradiance(points, PLACE - points, samples=128)
    expected = np.pi * np.array(A) * 0.3**2
    np.testing.assert_allclose(found.value.mean(axis=0), expected, rtol=0.01)


def test_a_glowing_half_space_is_met_by_chance_beside_a_lamp_that_is_drawn(tracer):
    ground = make_half_space((0, -1, 0), albedo=DARK, emission=B)
    both = PrimitiveSet.concatenate([LAMPS["box"], ground])
    found = tracer(both).irradiance([(3.0, 0.0, 0.0)], [(0.0, -1.0, 0.0)], samples=64)
    assert found.value[0] == pytest.approx(np.pi * np.array(B), rel=0.02)


def test_shares_are_by_power_and_dark_surfaces_have_none():
    found = emitters_of([0, 2, 1, 0], [5, 1, 6, 1], [7, 8, 9, 10], [0, 1, 2, 3])
    assert (found.count, found.power) == (2, 8.0)
    assert found.records["surface"].tolist() == [8, 9]
    assert found.records["face"].tolist() == [1, 2]
    np.testing.assert_allclose(found.records["share"], [0.25, 1.0])
    assert emitters_of([0.0], [1.0], [0], [0]).count == 0


def test_round_surfaces_are_one_and_half_spaces_none():
    parts = [LAMPS["sphere"], LAMPS["cylinder's side"], make_half_space(emission=A)]
    lamps = PrimitiveSet.concatenate(parts)
    found = primitive_emitters(lamps, pack_gpu(lamps))
    assert list(zip(found.records["surface"], found.records["face"], strict=True)) == [(0, 0), (1, 0), (1, 3)]
    powers = np.diff(found.records["share"], prepend=0) * found.power
    expected = [6 * 4 * np.pi * 0.3**2, 6 * 2 * np.pi * 0.2 * 0.7, 8 * np.pi * 0.2**2]
    np.testing.assert_allclose(powers, expected, rtol=1e-3)


@pytest.mark.parametrize("scene_tracer", ["primitives", "triangles"])
def test_probes_find_a_small_lamp_in_every_frame(
    technique, make_stage, make_room, inner_surface, mesh_of_boxes, scene_tracer
):
    """64 rays of a probe meet it in one frame of a hundred; after eight frames the noise is small already."""
    if technique != "ddgi" and scene_tracer == "triangles":
        pytest.skip("it traces primitives alone")
    room, surface = PrimitiveSet.concatenate([make_room(0.2), SMALL_LAMP]), inner_surface(100)
    chosen = {"tracer": scene_tracer} if technique == "ddgi" else {}
    scene = None
    if scene_tracer == "triangles":
        scene = lit_scene(mesh_of_boxes, make_room(0.2))
    found = [
        make_stage(
            technique, room, grid=GRID, bounce=0.0, scene=scene, seed=seed, rays_per_probe=64, **chosen
        )
        .run(8)
        .irradiance(*surface)
        for seed in (0, 1)
    ]
    assert np.abs(found[0] - found[1]).mean() < 0.06 * np.mean(found)
    many = make_stage(technique, room, grid=GRID, bounce=0.0, scene=scene, rays_per_probe=512, **chosen)
    assert np.mean(found) == pytest.approx(many.run(12).irradiance(*surface).mean(), rel=0.03)


def lit_scene(mesh_of_boxes, room):
    """The room's mesh with the small lamp's."""
    lamp = mesh_of_boxes(SMALL_LAMP).instances[0].world_from_local
    scene = mesh_of_boxes(room)
    glowing = Material(base_color=(0, 0, 0, 1), emission=(200.0, 200.0, 200.0))
    return replace(
        scene,
        meshes=(*scene.meshes, replace(scene.meshes[0], material=1)),
        materials=(*scene.materials, glowing),
        instances=(*scene.instances, Instance(1, -1, lamp)),
    )
