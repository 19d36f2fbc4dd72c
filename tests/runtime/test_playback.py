"""Meshes, lamps and primitives that move, vanish and appear between frames."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fit import gltf, motion
from fit.export import read
from fit.primitives import PrimitiveSet, make_box
from fit.scene import Animation, Curve, Instance, Light, LightKind, Motion, Node
from runtime.camera import look_at
from runtime.lights import Illumination, Point, Sun, file_lights
from runtime.playback import Playback
from runtime.renderer import Renderer
from runtime.settings import RenderSettings, ShadowSettings

CAMERA = look_at(np.array([0.0, 4.0, 4.0]), np.array([0.0, 0.0, 0.0]), fov=60.0)
SIZE = (48, 32)


def slide(node, *positions):
    times = np.arange(len(positions), dtype=float)
    curve = Curve(times, np.array(positions, float))
    return Motion(
        node, curve, Curve(np.zeros(1), np.array([[0, 0, 0, 1.0]])), Curve(np.zeros(1), np.ones((1, 3)))
    )


@pytest.fixture
def stage(builder):
    """A floor, and a red block with a lamp over it on a node that slides 2 m along x in a second."""
    builder.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8), base_color=(0.5, 0.5, 0.5, 1))
    builder.box((0, 0.5, 0), (1, 1, 1), base_color=(0.8, 0.1, 0.1, 1))
    scene = builder.scene()
    node = Node("carrier", -1, np.eye(4), np.eye(4))
    lamp = np.eye(4)
    lamp[:3, 3] = (0, 3, 0)
    above = Node("lamp", 0, lamp, lamp)
    instances = (scene.instances[0], Instance(scene.instances[1].mesh, 0, np.eye(4)))
    light = Light("lamp", LightKind.POINT, (1, 1, 1), 50.0, lamp, node=1)
    scene = replace(
        scene,
        nodes=(node, above),
        instances=instances,
        lights=(light,),
        animations=(Animation("slide", (slide(0, (0, 0, 0), (2, 0, 0)),)),),
    )
    block = replace(make_box((0, 0.5, 0)), nodes=(0,))
    return scene, PrimitiveSet.concatenate([make_box((0, -0.1, 0), (8, 0.2, 8)), block])


@pytest.fixture
def renderer(gpu, stage):
    scene, primitives = stage
    settings = RenderSettings(size=SIZE, gi="none", shadows=ShadowSettings(map_size=256))
    light = Illumination((*file_lights(scene), Sun((0.1, 1, 0.1), 1.0)))
    return Renderer(gpu, scene, primitives, settings, light)


def red(renderer) -> np.ndarray:
    """Columns of the red block's pixels."""
    albedo = renderer.render(CAMERA, only=("albedo",)).images["albedo"]
    return np.nonzero(albedo[..., 0] > 3 * albedo[..., 1])[1]


def test_everything_on_a_node_moves_together(renderer):
    before = red(renderer)
    renderer.set_time(1.0)
    after = red(renderer)
    assert len(after) > 20 and after.mean() > before.mean() + 5
    lamp = next(light for light in renderer.illumination.lights if isinstance(light, Point))
    assert lamp.position == pytest.approx((2, 3, 0))
    assert renderer.illumination.lights[1] == Sun((0.1, 1, 0.1), 1.0)
    assert renderer.world.primitives.positions[:, 0].tolist() == [0, 2]
    renderer.set_time(0.0)
    assert red(renderer).mean() == before.mean()
    assert renderer.world.primitives.positions[:, 0].tolist() == [0, 0]


def test_meshes_vanish_and_appear(renderer):
    assert len(red(renderer)) > 20
    renderer.show_instances({1: False})
    assert len(red(renderer)) == 0
    renderer.set_time(1.0)
    assert len(red(renderer)) == 0
    renderer.show_instances({1: True})
    assert len(red(renderer)) > 20
    _, upper = renderer.meshes.bounds()
    assert upper[1] == pytest.approx(1.0)


def test_a_material_may_glow_from_one_frame_to_the_next(renderer):
    material = renderer.scene.meshes[1].material
    renderer.set_emission(material, (0.0, 7.0, 0.0))
    assert renderer.render(CAMERA, only=("emission",)).images["emission"].max(axis=(0, 1)).tolist() == [
        0,
        7,
        0,
    ]
    renderer.set_emission(material, (0.0, 0.0, 0.0))
    assert not renderer.render(CAMERA, only=("emission",)).images["emission"].any()


def test_of_two_equal_lamps_each_moves_with_its_own_node(stage):
    scene, _ = stage
    still = replace(scene.lights[0], node=-1)
    playback = Playback(replace(scene, lights=(still, scene.lights[0])))
    lamps = file_lights(playback.scene)
    for seconds, x in ((0.5, 1.0), (1.0, 2.0)):
        lamps = playback.lights(lamps, seconds)
        assert [lamp.position[0] for lamp in lamps] == pytest.approx([0.0, x])


def test_balls_of_the_bundled_court_and_their_primitives_stay_together(bundled_assets: Path):
    scene = gltf.load(bundled_assets / "ball_court.glb")
    primitives = read(bundled_assets / "ball_court.npz")
    playback = Playback(scene)
    for seconds in (0.3, 1.1):
        instances = playback.instances(seconds)
        moved = playback.primitives(primitives, seconds)
        places = {scene.instances[i].node: matrix[:3, 3] for i, matrix in instances.items()}
        assert len(places) == 100
        for node, position in zip(moved.nodes, moved.positions, strict=True):
            assert node < 0 or np.allclose(places[node], position)
        assert moved.positions[:, 1].min() < 0.2 < 0.8 < moved.positions[:, 1].max()
    assert motion.duration(scene) == pytest.approx(1.6)
