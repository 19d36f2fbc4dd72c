"""DDGI through the scene's triangles: what it would see with ray tracing hardware."""

import numpy as np
import pytest

from fit.primitives import PrimitiveSet, make_box
from fit.scene import Material
from runtime.lights import Sun
from runtime.probes import ProbeGrid
from runtime.sky import Sky

OUTDOORS = {"sky": Sky.constant((1, 1, 1)), "lights": (Sun((1.0, 0.6, 0.3), 10.0),)}

OFFSET = (0.1, 0.37, 0.71)
"""Of the probes, in spacings, so that none stands on a wall's face."""


def test_it_lights_a_mesh_of_boxes_as_the_boxes(
    make_stage, make_room, inner_surface, mesh_of_boxes, grid_over
):
    room, surface = make_room(0.2, opening=True), inner_surface(300, opening=True)
    boxes, mesh = (
        make_stage(
            "ddgi",
            room,
            scene=mesh_of_boxes(room),
            tracer=tracer,
            grid=grid_over(0.6, offset=OFFSET),
            **OUTDOORS,
        ).run(8)
        for tracer in ("primitives", "triangles")
    )
    expected = boxes.irradiance(*surface)
    assert expected.mean() > 0.1
    np.testing.assert_allclose(mesh.irradiance(*surface).mean(), expected.mean(), rtol=0.02)


def test_it_sees_the_mesh_and_not_the_primitives(make_stage, make_room, inner_surface, mesh_of_boxes):
    """Walls that glow in the mesh alone."""
    glowing = mesh_of_boxes(make_room(0.2), Material(base_color=(0, 0, 0, 1), emission=(2.0, 1.0, 0.5)))
    stage = make_stage(
        "ddgi",
        make_room(0.2),
        scene=glowing,
        tracer="triangles",
        grid=ProbeGrid((-1.0, -1.0, -1.0), 1.0, (3, 3, 3)),
    ).run(4)
    found = stage.irradiance(*inner_surface(200))
    np.testing.assert_allclose(
        found, np.broadcast_to(np.pi * np.array([2.0, 1.0, 0.5]), found.shape), rtol=0.01
    )


@pytest.mark.parametrize("double_sided", [False, True])
def test_probes_that_see_many_backs_are_off(make_stage, mesh_of_boxes, double_sided):
    """One stands free, one just inside a wall, one deep in a block, whose faces show backs or do not."""
    parts = PrimitiveSet.concatenate([make_box((1, 0, 0), (0.3, 8, 8)), make_box((3.2, 0, 0), (3, 3, 3))])
    scene = mesh_of_boxes(parts, Material(double_sided=double_sided))
    grid = ProbeGrid((-1.0, 0, 0), 2.0, (3, 1, 1))
    stage = make_stage("ddgi", parts, scene=scene, tracer="triangles", grid=grid).run(12)
    states = stage.technique._states.read(np.float32, (3, 4))
    assert states[:, 3].tolist() == ([1, 1, 1] if double_sided else [1, 1, 0])
    if not double_sided:
        assert abs(states[1, 0] + stage.world.origin[0] - 1.0) > 0.15 + 0.1


def test_instances_that_move_are_seen_where_they_are(make_stage, mesh_of_boxes):
    """A lamp over a point goes away, and comes back."""
    lamp = make_box((0, 1, 0), (2, 0.1, 2))
    scene = mesh_of_boxes(lamp, Material(base_color=(0, 0, 0, 1), emission=(1, 1, 1)))
    grid = ProbeGrid((-0.5, -0.5, -0.5), 1.0, (2, 2, 2))
    stage = make_stage("ddgi", lamp, scene=scene, tracer="triangles", grid=grid, hysteresis=0.0)
    found = []
    for height in (0.0, 50.0, 0.0):
        matrix = scene.instances[0].world_from_local.copy()
        matrix[1, 3] += height
        stage.technique.tracer.move({0: matrix})
        found.append(stage.run(2).irradiance([(0, 0, 0)], [(0, 1, 0)]).mean())
    assert found[0] > 1.0
    assert found[1] < 0.02
    assert found[2] == pytest.approx(found[0], rel=0.1)


def test_a_tracer_that_cannot_be_is_refused(make_stage):
    block = make_box((0, 0, 0), (1, 1, 1))
    with pytest.raises(ValueError, match="no tracer 'voxels'; there are primitives, triangles"):
        make_stage("ddgi", block, tracer="voxels")
    with pytest.raises(ValueError, match="needs a scene's meshes"):
        make_stage("ddgi", block, tracer="triangles")
