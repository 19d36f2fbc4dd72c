"""DDGI, held to what its sources promise: right on the whole, leaking where walls are thin for its probes."""

import numpy as np
import pytest

from fit.encoding import decode_albedo, encode_albedo
from fit.primitives import make_box, make_sphere
from runtime.ddgi import DISTANCE_SIZE, Ddgi, DdgiSettings
from runtime.device import Gpu
from runtime.lights import Sun
from runtime.probes import ProbeGrid
from runtime.sky import Sky
from runtime.twins.octahedral import oct_texel_direction
from runtime.world import World

SUN = Sun((1.0, 0.6, 0.3), 10.0)
MIDDLE = ProbeGrid((-1.0, -1.0, -1.0), 1.0, (3, 3, 3))

AT_ONCE = 1e9
"""A `settling_growth` by which hysteresis is in force from the second frame on."""


def states_of(stage) -> np.ndarray:
    """Positions and states (n, 4) of the probes."""
    return stage.technique._states.read(np.float32, (len(stage.technique.grid), 4))


def test_gradient_sky_within_the_filters_error(make_stage):
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(400, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = rng.uniform(-1.9, 1.9, (400, 3))
    speck = make_box((0.3, 0.4, 0.5), (1e-3, 1e-3, 1e-3), albedo=(0, 0, 0))
    sky = Sky.gradient((1, 1, 1), (0.8, 0.6, 0.4), (0, 1, 0))
    stage = make_stage("ddgi", speck, sky=sky, grid=ProbeGrid((-2.0, -2.0, -2.0), 2.0, (3, 3, 3))).run(24)
    expected = np.pi * (1 + 2 / 3 * np.array([0.8, 0.6, 0.4]) * normals[:, 1:2])
    ratio = stage.irradiance(points, normals) / expected
    np.testing.assert_allclose(ratio, 1, atol=0.06)
    assert ratio.mean() == pytest.approx(1, abs=0.005)


@pytest.mark.parametrize(("albedo", "frames"), [(0.2, 30), (0.8, 60)])
def test_closed_box_of_glowing_walls(make_stage, make_room, inner_surface, albedo, frames):
    """With little hysteresis the bounces are summed within the frames of a test."""
    stage = make_stage("ddgi", make_room(0.2, albedo=albedo, emission=2.0), grid=MIDDLE, hysteresis=0.3).run(
        frames
    )
    stored = float(decode_albedo(encode_albedo(np.full((1, 3), albedo)))[0, 0])
    expected = np.pi * 2.0 / (1 - stored)
    np.testing.assert_allclose(stage.irradiance(*inner_surface(300)) / expected, 1.0, atol=0.02)


def test_new_probes_take_few_frames_to_settle(make_stage, make_room, inner_surface):
    """Half of the light is bounces; a hysteresis of 0.97 alone has seen 45 % of those by frame 40."""
    late, sooner = (
        make_stage("ddgi", make_room(0.2, albedo=0.5, emission=2.0), grid=MIDDLE, **settling)
        .run(40)
        .irradiance(*inner_surface(300))
        .mean()
        for settling in ({"settling_growth": AT_ONCE}, {})
    )
    expected = np.pi * 2.0 / (1 - 0.5)
    assert late < 0.8 * expected
    assert sooner == pytest.approx(expected, rel=0.02)


def test_thick_walls_keep_light_out_and_thin_ones_do_not(make_stage, make_room, inner_surface, grid_over):
    """Chebyshev's test needs walls that are thick beside the spread of distances in a texel."""
    surface = inner_surface(3000)
    light = {"sky": Sky.constant((1, 1, 1)), "lights": (SUN,)}
    opening = make_stage(
        "ddgi", make_room(0.2, opening=True), grid=grid_over(0.5, offset=(0.1, 0.37, 0.71)), **light
    )
    bright = opening.run(6).irradiance(*inner_surface(3000, opening=True)).mean()
    thick = make_stage("ddgi", make_room(0.2), grid=grid_over(0.5, offset=(0.1, 0.37, 0.71)), **light)
    assert thick.run(6).irradiance(*surface).mean() <= 0.002 * bright
    thin = make_stage("ddgi", make_room(0.01), grid=grid_over(1.0, offset=(0.1, 0.37, 0.71)), **light)
    assert thin.run(6).irradiance(*surface).mean() > 0.02 * bright


def test_distances_are_those_to_the_walls(make_stage, make_room):
    """A probe in the middle of a cube sees its walls at 1.5 m over the direction's largest component."""
    stage = make_stage(
        "ddgi", make_room(0.2), grid=ProbeGrid((0, 0, 0), 3.0, (1, 1, 1)), rays_per_probe=1024
    ).run(40)
    moments = stage.technique._moments.read(np.float32, (DISTANCE_SIZE**2, 2)) * stage.technique.farthest
    texel = np.stack(np.divmod(np.arange(DISTANCE_SIZE**2), DISTANCE_SIZE)[::-1], axis=1).astype(np.uint32)
    direction = oct_texel_direction(texel, np.full(len(texel), DISTANCE_SIZE))
    expected = 1.5 / np.abs(direction).max(axis=1)
    np.testing.assert_allclose(moments[:, 0], expected, rtol=0.12)
    assert moments[:, 0].mean() == pytest.approx(expected.mean(), rel=0.03)


def test_probes_leave_walls_and_those_that_cannot_are_off(make_stage):
    """Of three probes the first stands free, the second just inside a wall, the third deep in a block."""
    wall = make_box((1.0, 0, 0), (0.3, 8, 8))
    block = make_sphere((3.0, 0, 0), 1.5)
    parts = type(wall).concatenate([wall, block])
    grid = ProbeGrid((-1.0, 0, 0), 2.0, (3, 1, 1))
    stage = make_stage("ddgi", parts, grid=grid).run(12)
    free, moved, stuck = states_of(stage)
    np.testing.assert_allclose(free[:3] + stage.world.origin, (-1, 0, 0), atol=1e-5)
    assert free[3] == moved[3] == 1
    assert abs(moved[0] + stage.world.origin[0] - 1.0) > 0.15 + 0.1
    assert stuck[3] == 0


def test_probes_over_a_room_are_brought_in_from_behind_its_walls(make_stage, make_room, inner_surface):
    """The grid's outermost probes stand a hand's breadth outside; without them every corner would be dark."""
    grid = ProbeGrid((-1.75, -1.75, -1.75), 3.5 / 4, (5, 5, 5))
    left, stage = (
        make_stage("ddgi", make_room(0.2, emission=2.0), grid=grid, bounce=0.0, lean_inward=lean).run(10)
        for lean in (False, True)
    )
    outermost = [np.abs(states_of(s)[:, :3] + s.world.origin).max() for s in (left, stage)]
    assert outermost[0] > 1.7
    assert outermost[1] < 1.5
    np.testing.assert_allclose(stage.irradiance(*inner_surface(300)), 2 * np.pi, rtol=0.01)


@pytest.mark.parametrize("sleep", [False, True])
def test_a_probe_that_leaves_a_wall_in_the_last_frame_is_on(make_stage, sleep):
    wall = make_box((1.0, 0, 0), (0.3, 8, 8))
    grid = ProbeGrid((-1.0, 0, 0), 2.0, (2, 1, 1))
    stage = make_stage("ddgi", wall, grid=grid, relocation_frames=1, sleep=sleep).run(3)
    moved = states_of(stage)[1]
    assert abs(moved[0] + stage.world.origin[0] - 1.0) > 0.15
    assert moved[3] == 1


def test_a_change_is_told_by_the_root_that_is_stored(make_stage, make_room, inner_surface):
    """Ten times the light is less than twice its fifth root: a change, but not altogether one."""
    surface = inner_surface(300)
    found = []
    for change in (0.3, 0.4):  # 1 - 10 ** (-1 / 5) is 0.37
        stage = make_stage(
            "ddgi",
            make_room(0.2, emission=1.0),
            grid=MIDDLE,
            bounce=0.0,
            change_altogether=change,
            settling_growth=AT_ONCE,
        ).run(5)
        stage.world.update(make_room(0.2, emission=10.0))
        found.append(stage.run(1).irradiance(*surface).mean() / (np.pi * 10))
    assert found[0] == pytest.approx(1, rel=0.05)
    assert found[1] < 0.5


def test_probes_far_from_surfaces_sleep_when_asked_to(make_stage):
    block = make_box((0, 0, 0), (1, 1, 1))
    grid = ProbeGrid((-0.8, -0.8, -0.8), 0.7, (8, 1, 1))
    awake = states_of(make_stage("ddgi", block, grid=grid).run())[:, 3]
    asleep = states_of(make_stage("ddgi", block, grid=grid, sleep=True).run())[:, 3]
    assert awake.tolist() == [1] * 8
    assert asleep[-1] == 0.5
    assert asleep[1] == 1


def test_a_clear_change_arrives_sooner_than_hysteresis_lets_it(make_stage, make_room, inner_surface):
    surface = inner_surface(300)
    room = make_room(0.2, emission=1.0)  # what changes "altogether" does so in the stored fifth root
    late, sooner = (
        make_stage(
            "ddgi", room, grid=MIDDLE, bounce=0.0, change_altogether=limit, settling_growth=AT_ONCE
        ).run(5)
        for limit in (2.0, 0.8)
    )
    for stage in (late, sooner):
        stage.world.update(make_room(0.2, emission=1e4))
        stage.run(3)
    expected = np.pi * 1e4
    assert sooner.irradiance(*surface).mean() == pytest.approx(expected, rel=0.05)
    assert late.irradiance(*surface).mean() < 0.5 * expected


@pytest.mark.parametrize(
    "wrong", [{"rays_per_probe": 100}, {"hysteresis": 1.5}, {"bounce": -1}], ids=lambda w: next(iter(w))
)
def test_settings_out_of_range_are_refused_by_name(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        DdgiSettings(**wrong)


def test_memory_counts_all_buffers(gpu: Gpu):
    world = World(gpu, None, make_box((0, 0, 0), (1, 1, 1)))
    few, many = (
        Ddgi(gpu, world, DdgiSettings(grid=MIDDLE, rays_per_probe=rays)).memory for rays in (64, 128)
    )
    assert many - few == 16 * 64 * len(MIDDLE)
