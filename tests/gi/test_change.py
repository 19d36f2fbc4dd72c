"""Light that follows what changes: primitives that appear, vanish and move, lamps that move and dim, balls by
the hundred.
"""

from dataclasses import replace

import numpy as np
import pytest

from fit import export, gltf, motion
from fit.primitives import PrimitiveSet, make_box, make_sphere
from runtime.lights import Point, Sun
from runtime.probes import ProbeGrid
from runtime.sky import Sky

GRID = ProbeGrid((-1.0, -1.0, -1.0), 1.0, (3, 3, 3))
DOOR = make_box((1.6, 0.0, 0.0), (0.2, 2.2, 1.2))
WHITE = Sky.constant((1.0, 1.0, 1.0))

STEP_FRAMES, DARK_FRAMES, TRAIL_FRAMES = 60, 300, 40
"""Frames after which a thousandth may be left, nothing may be, and 2 % of a trail may be."""


def lamp(emission: float, x: float = 0.0) -> PrimitiveSet:
    return make_sphere((x, 1.0, 0.0), 0.3, albedo=(0, 0, 0), emission=[emission] * 3)


def together(*sets: PrimitiveSet) -> PrimitiveSet:
    return PrimitiveSet.concatenate(sets)


def mean_over(stage, surface) -> float:
    return float(stage.irradiance(*surface).mean())


def fades(stage, surface, lit: float) -> None:
    """At most a thousandth is left after 60 frames, and nothing at all after 300."""
    assert mean_over(stage.run(STEP_FRAMES), surface) <= 1e-3 * lit
    assert np.all(stage.run(DARK_FRAMES - STEP_FRAMES).irradiance(*surface) == 0)


def test_a_lamp_that_vanishes_leaves_no_light(technique, make_stage, make_room, inner_surface):
    """The set has one primitive less from one frame to the next; the room's walls stay."""
    if technique == "ddgi":
        pytest.skip("a hysteresis of 0.97 takes over 60 frames")
    surface, room = inner_surface(200), make_room(0.2)
    stage = make_stage(technique, together(room, lamp(5.0)), grid=GRID).run(60)
    lit = mean_over(stage, surface)
    assert lit > 0.1
    stage.world.update(room)
    fades(stage, surface, lit)


def test_a_door_that_appears_shuts_the_light_out(technique, make_stage, make_room, inner_surface):
    if technique == "ddgi":
        pytest.skip("a hysteresis of 0.97 takes over 60 frames")
    surface, room = inner_surface(200, opening=True), make_room(0.2, opening=True)
    stage = make_stage(technique, room, sky=WHITE, lights=(Sun((1.0, 0.6, 0.3), 10.0),), grid=GRID).run(40)
    lit = mean_over(stage, surface)
    stage.world.update(together(room, DOOR))
    fades(stage, surface, lit)
    stage.world.update(room)
    assert mean_over(stage.run(TRAIL_FRAMES), surface) == pytest.approx(lit, rel=0.1)


def test_emission_that_changes_is_followed(technique, make_stage, make_room, inner_surface):
    """Brighter, dimmer, out: light is proportional to what the lamp emits now."""
    if technique == "ddgi":
        pytest.skip("a hysteresis of 0.97 takes over 40 frames")
    surface, room = inner_surface(200), make_room(0.2)

    def light(stage, frames: int) -> float:
        """Over the last twelve frames: what is measured is the change, not the noise of a frame."""
        stage.run(frames - 12)
        return float(np.mean([mean_over(stage.run(), surface) for _ in range(12)]))

    stage = make_stage(technique, together(room, lamp(2.0)), grid=GRID)
    lit = light(stage, 60)
    stage.world.update(together(room, lamp(10.0)))
    bright = light(stage, TRAIL_FRAMES)
    assert bright == pytest.approx(5 * lit, rel=0.05)
    stage.world.update(together(room, lamp(0.5)))
    assert mean_over(stage.run(TRAIL_FRAMES), surface) == pytest.approx(0.25 * lit, abs=0.02 * bright)
    stage.world.update(together(room, lamp(0.0)))
    fades(stage, surface, bright)


@pytest.mark.slow
def test_a_point_light_that_moves_leaves_no_trail(technique, make_stage, make_room, inner_surface):
    """40 frames after its last step the light is that of a lamp that was always there; means of 12 frames."""
    if technique == "ddgi":
        pytest.skip("a hysteresis of 0.97 leaves one")
    surface, room = inner_surface(200), make_room(0.2)

    def light(stage) -> np.ndarray:
        return np.mean([stage.run().irradiance(*surface) for _ in range(12)], axis=0)

    stage = make_stage(technique, room, lights=(Point((-1.0, 0.0, 0.2), 5.0),), grid=GRID, rays_per_probe=512)
    stage.run(20)
    for x in np.linspace(-1.0, 1.0, 6):
        stage.set_lights(Point((float(x), 0.0, 0.2), 5.0))
        stage.run()
    late = light(stage.run(TRAIL_FRAMES - 1))
    rest = make_stage(technique, room, lights=(Point((1.0, 0.0, 0.2), 5.0),), grid=GRID, rays_per_probe=512)
    rest = light(rest.run(60))
    assert np.percentile(np.abs(late - rest).mean(axis=1), 95) <= 0.02 * rest.mean()


def test_no_light_of_what_moves_outside_gets_in(technique, make_stage, make_room, inner_surface):
    """A lamp flies round a closed room with walls of 1 cm, a block wanders within: black in every frame."""
    if technique == "ddgi":
        pytest.skip("thin walls leak")
    surface, room = inner_surface(300), make_room(0.01)
    grid = ProbeGrid((-2.1, -2.1, -2.1), 1.05, (5, 5, 5))
    stage = make_stage(technique, together(room, lamp(0.0)), grid=grid)
    for angle in np.linspace(0.2, 2 * np.pi, 5, endpoint=False):
        ball = make_sphere((3 * np.cos(angle), 0, 3 * np.sin(angle)), 0.5, emission=(20, 20, 20))
        block = make_box((0.9 * np.sin(angle), -0.5, 0.0), (0.6, 1.0, 0.6))
        stage.world.update(together(room, ball, block))
        assert np.all(stage.run().irradiance(*surface) == 0)


@pytest.fixture(scope="module")
def court(bundled_assets):
    """The court of a hundred bouncing balls: its scene, and its primitives at a time."""
    scene = gltf.load(bundled_assets / "ball_court.glb")
    rest = export.read(bundled_assets / "ball_court.npz")
    return lambda seconds: motion.posed_primitives(rest, scene, seconds)


@pytest.fixture(scope="module")
def court_floor():
    """Points on the floor and on the west wall of the court, and their normals."""
    rng = np.random.default_rng(5)
    floor, wall = rng.uniform(-3.9, 3.9, (150, 3)), rng.uniform(-3.9, 3.9, (50, 3))
    floor[:, 1], wall[:, 0], wall[:, 1] = 0.0, -4.0, rng.uniform(0.1, 2.3, 50)
    return np.concatenate([floor, wall]), np.repeat([[0.0, 1, 0], [1.0, 0, 0]], (150, 50), axis=0)


@pytest.mark.slow
def test_a_hundred_balls_leave_no_trail(make_stage, court, court_floor):
    """Sixty frames a second. While they bounce, light lags by at most 10 % of its mean; 40 frames after they
    have stopped, by at most 2 %, noise of a frame included in neither."""
    grid = ProbeGrid((-3.6, 0.3, -3.6), 1.8, (5, 2, 5))
    options = {"sky": WHITE, "lights": (Sun((0.5, 0.9, 0.3), 6.0),), "grid": grid, "rays_per_probe": 128}

    def light(stage) -> np.ndarray:
        return np.mean([stage.run().irradiance(*court_floor) for _ in range(4)], axis=0)

    stage = make_stage("sdfddgi", court(0.0), **options).run(24)
    for frame in range(30):
        stage.world.update(court(frame / 60))
        stage.run()
    moving = stage.irradiance(*court_floor)
    late = light(stage.run(TRAIL_FRAMES - 1))
    rest = light(make_stage("sdfddgi", court(29 / 60), **options).run(60))
    lag, trail = (np.abs((e - rest).mean(axis=1)).mean() / rest.mean() for e in (moving, late))
    assert trail <= 0.02
    assert lag <= 0.1


def test_balls_out_of_the_set_cast_no_shadow(make_stage, court, court_floor):
    """A ball that a scale of nothing takes away is gone from the set, and light fills its place."""
    full = court(0.0)
    gone = full.select(np.array(full.nodes) < 0)
    assert (len(full), len(gone)) == (105, 5)
    grid = ProbeGrid((-3.6, 0.3, -3.6), 1.8, (5, 2, 5))
    stage = make_stage("sdfddgi", full, sky=WHITE, grid=grid).run(30)
    shaded = mean_over(stage, court_floor)
    stage.world.update(gone)
    empty = mean_over(stage.run(TRAIL_FRAMES), court_floor)
    fresh = mean_over(make_stage("sdfddgi", gone, sky=WHITE, grid=grid).run(60), court_floor)
    assert empty == pytest.approx(fresh, rel=0.02)
    assert empty > 1.05 * shaded
    stage.world.update(replace(full))
    assert mean_over(stage.run(TRAIL_FRAMES), court_floor) == pytest.approx(shaded, rel=0.03)
