"""Shared shading where it could go wrong: thin walls seen from both sides at once, a moving camera, a moved
object."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fit.primitives import PrimitiveSet, make_box
from runtime import pixel_shading
from runtime.camera import look_at
from runtime.encoder import Recorder
from runtime.lights import Illumination
from runtime.probes import ProbeGrid
from runtime.renderer import Renderer
from runtime.sdfddgi import SdfddgiSettings
from runtime.settings import RenderSettings, ShadingMode, ShadingSettings, ShadowSettings
from runtime.sky import Sky

SHARED = ShadingSettings(mode=ShadingMode.SHARED)
OUTDOORS = Illumination((), Sky.constant((1.0, 1.0, 1.0)))
GROUND = make_box((0, -1.6, 0), (9, 0.2, 9))


def _renderer(gpu, scene, primitives, size, spacing=1.0):
    grid = ProbeGrid((-4.5 * spacing, -1.4, -4.5 * spacing), spacing, (10, 5, 10))
    settings = RenderSettings(
        size=size,
        technique=SdfddgiSettings(grid=grid),
        shadows=ShadowSettings(map_size=256),
        shading=SHARED,
    )
    return Renderer(gpu, scene, primitives, settings, OUTDOORS)


def _whole(renderer):
    """Irradiance of a lookup for each pixel of the frame that was drawn last."""
    full = pixel_shading.FullShading(renderer.gpu, renderer.settings.size, renderer.technique)
    rec = Recorder(renderer.gpu)
    full.record(rec, renderer._shared())
    rec.submit()
    return full.irradiance.read()[..., :3]


def test_a_sealed_room_stays_black_next_to_the_day_outside(gpu, make_room, mesh_of_boxes):
    """From above a wall, with the roof cut off by the near plane: the walls of 1 cm are thinner than a pixel,
    a block of 4 x 4 holds floor from both sides of one, all in one plane. Still and while the camera moves,
    no light gets in."""
    room = PrimitiveSet.concatenate([make_room(0.01), GROUND])
    renderer = _renderer(gpu, mesh_of_boxes(room), room, (72, 72))
    for number in range(12):
        place = np.array([1.505 + 0.02 * max(number - 5, 0), 7.0, 0.02])
        renderer.set_camera(replace(look_at(place, place * [1, 0, 1] + [0, 0, -0.02], fov=38.0), znear=5.8))
        if number == 0:
            for _ in range(6):
                renderer.draw_frame(only_light=True)
        renderer.draw_frame()
        position, light = renderer.read_view("position"), renderer.shading.irradiance.read()[..., :3]
        is_surface = renderer.gbuffer.depth.read() > 0
        away = np.abs(position[..., [0, 2]]).max(-1)
        inside = is_surface & (away < 1.499) & (position[..., 1] < 1.3)
        outside = is_surface & (away > 1.52) & (position[..., 1] < -1.49)
        assert inside.sum() > 400 and outside.sum() > 400
        assert light[inside].max() == 0, f"{_whole(renderer)[inside].max()} by whole lookups"
        assert light[outside].min() > 0.1


def test_a_moving_camera_sees_what_whole_lookups_give(gpu, make_room, mesh_of_boxes):
    """In the middle of a move no pixel is black; at 80 x 60, where samples are far apart, the mean error is
    about 5 %."""
    room = PrimitiveSet.concatenate([make_room(0.2, opening=True), GROUND])
    renderer = _renderer(gpu, mesh_of_boxes(room), room, (80, 60), spacing=0.75)
    errors = []
    for number in range(24):
        place = np.array([-1.2 + 0.03 * number, 0.1, 0.9 - 0.02 * number])
        renderer.set_camera(look_at(place, np.array([1.2, -0.4 - 0.01 * number, -0.3]), fov=65.0))
        if number == 0:
            for _ in range(40):
                renderer.draw_frame(only_light=True)
        renderer.draw_frame()
        if number % 6 == 5:
            whole, light = _whole(renderer), renderer.shading.irradiance.read()[..., :3]
            is_surface = renderer.gbuffer.depth.read() > 0
            errors.append(np.abs(light - whole)[is_surface].mean() / whole[is_surface].mean())
            assert not np.any((light[is_surface] == 0) & (whole[is_surface] > 0))
    assert max(errors) < 0.07


@pytest.mark.slow
def test_a_moved_object_leaves_no_trail(gpu, mesh_of_boxes):
    """40 frames after a box was taken away the picture is that of a scene that never had it there."""

    def world(x):
        return PrimitiveSet.concatenate([GROUND, make_box((x, -1.0, 0), (1, 1, 1), albedo=[0.9, 0.1, 0.1])])

    scene = mesh_of_boxes(world(-1.0))
    camera = look_at(np.array([0.5, 2.0, 5.0]), np.array([0.0, -1.0, 0.0]), fov=45.0)
    pictures = []
    for start in (-1.0, 1.0):
        renderer = _renderer(gpu, scene, world(start), (64, 48))
        renderer.set_camera(camera)
        for frames, x in ((30, start), (40, 1.0)):
            moved = scene.instances[1].world_from_local.copy()
            moved[0, 3] = x
            renderer.move_instances({1: moved})
            renderer.set_primitives(world(x))
            for _ in range(frames):
                renderer.draw_frame()
        pictures.append(renderer.shading.irradiance.read()[..., :3])
    trail = np.abs(pictures[0] - pictures[1]).mean() / pictures[1].mean()
    assert trail < 0.02
