"""Rooms under the sun: what is closed stays black, what is not does not."""

import numpy as np
import pytest

from fit.primitives import PrimitiveSet, make_box
from runtime.lights import Illumination, Sun
from runtime.renderer import Renderer
from runtime.settings import RenderSettings, ShadowSettings
from runtime.sky import Sky
from runtime.technique import Gather
from runtime.twins import reference

SUN = (1.0, 0.6, 0.3)
SUN_IRRADIANCE = 10.0
OFFSET = (0.1, 0.37, 0.71)
LAMP = make_box((0.0, 1.47, 0.0), (1.0, 0.06, 1.0), albedo=(0, 0, 0), emission=(5, 5, 5))
FRAMES = 12

BESIDE_THE_LAMP = (0.69, 0.82, 0.34)
TOO_BRIGHT = "a probe close to the lamp counts for its whole cell: mean E is 84 % too high"

ONE_PROBE = pytest.param(
    4.0,
    0.3,
    marks=pytest.mark.xfail(
        strict=True, reason="one probe, in a corner, stands for the whole room: mean E is 35 % too low"
    ),
)


def white_sky(directions):
    return np.ones((len(directions), 3))


def turned(primitives: PrimitiveSet, points, normals, angle: float):
    """Everything turned by an angle about a slanted axis."""
    axis = np.array([1.0, 2.0, 0.5]) / np.linalg.norm([1.0, 2.0, 0.5])
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(4)
    matrix[:3, :3] = np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew
    return primitives.transformed(matrix), points @ matrix[:3, :3].T, normals @ matrix[:3, :3].T


@pytest.fixture(scope="session")
def open_mean(make_room, inner_surface) -> float:
    """Mean indirect E over the inner surface of the open room, by the path tracer; 2 % noise at most."""
    points, normals = inner_surface(2000, opening=True)
    sun = reference.SunLight(SUN, (SUN_IRRADIANCE,) * 3)
    return float(
        reference.indirect_irradiance(
            make_room(0.2, opening=True), points, normals, sky=white_sky, suns=(sun,), samples=24
        ).mean()
    )


def outdoors():
    return {"sky": Sky.constant((1.0, 1.0, 1.0)), "lights": (Sun(SUN, SUN_IRRADIANCE),)}


def assert_black(irradiance, open_mean: float) -> None:
    assert np.all(np.isfinite(irradiance))
    seen = irradiance.mean(axis=1)
    assert seen.mean() <= 0.001 * open_mean
    assert np.percentile(seen, 99.9) <= 0.01 * open_mean


@pytest.mark.parametrize("walls", [0.01, 0.04, 0.2])
@pytest.mark.parametrize("spacing", [4.0, 1.0])
def test_sealed_room_is_black(
    technique, make_stage, make_room, inner_surface, grid_over, open_mean, walls, spacing
):
    grid = grid_over(spacing, offset=OFFSET)
    stage = make_stage(technique, make_room(walls), grid=grid, **outdoors()).run(FRAMES)
    assert_black(stage.irradiance(*inner_surface(10_000)), open_mean)


def test_sealed_room_is_black_when_turned(
    technique, make_stage, make_room, inner_surface, grid_over, open_mean
):
    room, points, normals = turned(make_room(0.01), *inner_surface(10_000), angle=0.7)
    stage = make_stage(technique, room, grid=grid_over(1.0, size=5.0), **outdoors()).run(FRAMES)
    assert_black(stage.irradiance(points, normals), open_mean)


def test_sealed_room_is_black_under_reflective_shadow_maps(
    technique, gpu, gi_of, settings_of, make_room, inner_surface, grid_over, open_mean, mesh_of_boxes
):
    """With the room's mesh, so that probes read its sunlit outside where they may; the open room tells that
    they do."""
    means = {}
    for opening in (False, True):
        room = make_room(0.01, opening=opening)
        settings = RenderSettings(
            size=(8, 8),
            gi=gi_of(technique),
            technique=settings_of[technique](grid=grid_over(1.0, offset=OFFSET)),
            shadows=ShadowSettings(map_size=256),
        )
        light = Illumination((Sun(SUN, SUN_IRRADIANCE),), Sky.constant((1.0, 1.0, 1.0)))
        renderer = Renderer(gpu, mesh_of_boxes(room), room, settings, light)
        for _ in range(FRAMES):
            renderer.draw_frame(only_light=True)
        gather = Gather(gpu, renderer.world, renderer.technique)
        means[opening] = gather.irradiance(*inner_surface(10_000, opening=opening))
    assert_black(means[False], open_mean)
    assert means[True].mean() == pytest.approx(open_mean, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("walls", [0.01, 0.04, 0.2])
@pytest.mark.parametrize("spacing", [0.25, 0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("turn", range(8))
def test_sealed_room_is_black_everywhere(
    technique, make_stage, make_room, inner_surface, grid_over, open_mean, walls, spacing, turn
):
    """The whole matrix of walls, spacings and turns, two of the sixteen grid offsets to each turn."""
    room, points, normals = turned(make_room(walls), *inner_surface(10_000), angle=turn * np.pi / 8)
    for offset in np.random.default_rng(turn).random((2, 3)):
        grid = grid_over(spacing, size=4.0, offset=tuple(offset))
        stage = make_stage(technique, room, grid=grid, **outdoors()).run(8)
        assert_black(stage.irradiance(points, normals), open_mean)


@pytest.mark.parametrize("walls", [0.01, 0.2])
def test_light_stays_in_the_room(technique, make_stage, make_room, inner_surface, grid_over, walls):
    """The sealed room reversed: a lamp inside, black outside."""
    points, normals = inner_surface(4000)
    outside = points - normals * walls
    room = PrimitiveSet.concatenate([make_room(walls), LAMP])
    stage = make_stage(technique, room, grid=grid_over(1.0, offset=OFFSET)).run(FRAMES)
    inside_mean = stage.irradiance(points, normals).mean()
    assert inside_mean > 0.1
    assert_black(stage.irradiance(outside, -normals), inside_mean)


@pytest.mark.parametrize(
    ("spacing", "offset", "tolerance"),
    [
        (4.0, OFFSET, 0.3),
        (2.0, OFFSET, 0.3),
        (1.0, OFFSET, 0.3),
        pytest.param(1.0, BESIDE_THE_LAMP, 0.3, marks=pytest.mark.xfail(strict=True, reason=TOO_BRIGHT)),
        (0.5, OFFSET, 0.1),
    ],
)
def test_room_with_a_lamp_is_lit(
    technique, make_stage, make_room, inner_surface, grid_over, spacing, offset, tolerance
):
    """The sealed room's twin: a technique that is black everywhere passes that one and fails this one."""
    points, normals = inner_surface(1500)
    under_lamp = (points[:, 1] > 1.499) & (np.abs(points[:, [0, 2]]).max(axis=1) < 0.5)
    points, normals = points[~under_lamp], normals[~under_lamp]
    room = PrimitiveSet.concatenate([make_room(0.2), LAMP])
    expected = reference.indirect_irradiance(room, points, normals, samples=32).mean()
    stage = make_stage(technique, room, grid=grid_over(spacing, size=3.0, offset=offset)).run(25)
    assert stage.irradiance(points, normals).mean() == pytest.approx(expected, rel=tolerance)


@pytest.mark.parametrize(("spacing", "tolerance"), [ONE_PROBE, (1.0, 0.3), (0.5, 0.1)])
def test_open_room_is_lit(
    technique, make_stage, make_room, inner_surface, grid_over, open_mean, spacing, tolerance
):
    room, surface = make_room(0.2, opening=True), inner_surface(1500, opening=True)
    stage = make_stage(technique, room, grid=grid_over(spacing, size=3.0, offset=OFFSET), **outdoors()).run(
        25
    )
    assert stage.irradiance(*surface).mean() == pytest.approx(open_mean, rel=tolerance)
