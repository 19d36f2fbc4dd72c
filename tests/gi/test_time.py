"""What light does over time: it rests when nothing changes, arrives when something does, and leaves no
trail.
"""

import numpy as np
import pytest

from fit.primitives import PrimitiveSet, make_box, make_sphere
from runtime.lights import Sun
from runtime.probes import ProbeGrid
from runtime.sky import Sky

GRID = ProbeGrid((-1.0, -1.0, -1.0), 1.0, (3, 3, 3))
LAMP = make_box((0.0, 1.45, 0.0), (1.5, 0.1, 1.5), albedo=(0, 0, 0), emission=(5, 5, 5))
DARK_LAMP = make_box((0.0, 1.45, 0.0), (1.5, 0.1, 1.5), albedo=(0, 0, 0))
SUN = Sun((1.0, 0.6, 0.3), 10.0)


@pytest.fixture(scope="session")
def lit_room(make_room):
    """The open room with a lamp, a block and a ball in it."""
    block = make_box(
        (0.5, -1.0, -0.4), (0.8, 1.0, 0.8), (0, np.sin(0.2), 0, np.cos(0.2)), albedo=(0.7, 0.2, 0.2)
    )
    ball = make_sphere((-0.6, -1.0, 0.4), 0.5, albedo=(0.3, 0.7, 0.3))
    return PrimitiveSet.concatenate([make_room(0.2, opening=True), LAMP, block, ball])


def mean_over(stage, surface) -> float:
    return float(stage.irradiance(*surface).mean())


def test_still(technique, make_stage, lit_room, inner_surface, many_rays):
    """After 256 frames little moves, and what stands there is right: it is that of 4,096 rays a probe."""
    surface = inner_surface(500, opening=True)
    still = make_stage(technique, lit_room, sky=Sky.constant((1, 1, 1)), lights=(SUN,), grid=GRID).run(256)
    frames = np.array([still.run().irradiance(*surface).mean(axis=1) for _ in range(64)])
    seen = frames.mean(axis=0) > 0.01 * frames.mean()
    wobble = frames.std(axis=0)[seen] / frames.mean(axis=0)[seen]
    assert np.percentile(wobble, 95) <= 0.005
    many = make_stage(
        technique, lit_room, sky=Sky.constant((1, 1, 1)), lights=(SUN,), grid=GRID, **many_rays[technique]
    ).run(14)
    truth = np.mean([mean_over(many.run(), surface) for _ in range(4)])
    assert frames[-1].mean() == pytest.approx(truth, rel=0.02)


def test_a_lamp_that_comes_on_after_rest_arrives(technique, make_stage, make_room, inner_surface):
    surface = inner_surface(300)
    room = make_room(0.2)
    stage = make_stage(technique, PrimitiveSet.concatenate([room, DARK_LAMP]), grid=GRID).run(300)
    assert mean_over(stage, surface) == 0
    stage.world.update(PrimitiveSet.concatenate([room, LAMP]))
    late = mean_over(stage.run(60), surface)
    fresh = make_stage(technique, PrimitiveSet.concatenate([room, LAMP]), grid=GRID).run(200)
    assert late == pytest.approx(mean_over(fresh, surface), rel=0.05)


@pytest.mark.parametrize(("bounce", "frames"), [(0.0, 12), (1.0, 40)])
def test_step_on(technique, make_stage, make_room, inner_surface, bounce, frames):
    """90 % of the first bounce within 12 frames, of all bounces within 40."""
    surface = inner_surface(300, opening=True)
    stage = make_stage(technique, make_room(0.2, opening=True), grid=GRID, bounce=bounce).run(60)
    assert mean_over(stage, surface) == 0
    stage.set_sky(Sky.constant((1, 1, 1)))
    stage.set_lights(SUN)
    early = mean_over(stage.run(frames), surface)
    assert early == pytest.approx(mean_over(stage.run(250), surface), rel=0.1)


def test_step_off_ends_in_darkness(technique, make_stage, make_room, inner_surface):
    """At most a thousandth is left after 60 frames, and nothing at all after 300."""
    surface = inner_surface(300, opening=True)
    room = make_room(0.2, opening=True)
    stage = make_stage(technique, room, sky=Sky.constant((1, 1, 1)), lights=(SUN,), grid=GRID).run(300)
    lit = mean_over(stage, surface)
    stage.set_sky(Sky())
    stage.set_lights()
    assert mean_over(stage.run(60), surface) <= 1e-3 * lit
    assert np.all(stage.run(240).irradiance(*surface) == 0)


def test_dim_light_scales_linearly(technique, make_stage, make_room, inner_surface):
    surface = inner_surface(300, opening=True)
    room = make_room(0.2, opening=True)
    bright, dim = (
        make_stage(
            technique,
            room,
            sky=Sky.constant((scale, scale, scale)),
            lights=(Sun(SUN.direction, 10.0 * scale),),
            grid=GRID,
        )
        .run(60)
        .irradiance(*surface)
        for scale in (1.0, 1e-4)
    )
    assert dim.mean() / 1e-4 == pytest.approx(bright.mean(), rel=0.01)
    seen = bright.mean(axis=1) > 0.01 * bright.mean()
    np.testing.assert_allclose(dim[seen] / 1e-4 / bright[seen], 1, atol=0.01)


def test_a_moved_object_leaves_no_trail(technique, make_stage, make_room, inner_surface):
    """A glowing ball moves across the room; 40 frames later the light is that of a room where it always
    was.
    """
    points, normals = inner_surface(400)
    room = make_room(0.2)

    def with_ball(x: float) -> PrimitiveSet:
        ball = make_box((x, 0.1, 0.0), (0.7, 0.7, 0.7), albedo=(0.8, 0.8, 0.8), emission=(0.5, 0.5, 0.5))
        return PrimitiveSet.concatenate([room, LAMP, ball])

    def light(stage) -> np.ndarray:
        """Over a few frames: what is measured is the trail, not the noise of a frame."""
        return np.mean([stage.run().irradiance(points, normals) for _ in range(12)], axis=0)

    stage = make_stage(technique, with_ball(-0.8), grid=GRID, rays_per_probe=512).run(40)
    for x in np.linspace(-0.8, 0.8, 6):
        stage.world.update(with_ball(float(x)))
        stage.run()
    late = light(stage.run(39))
    rest = light(make_stage(technique, with_ball(0.8), grid=GRID, rays_per_probe=512).run(80))
    trail = np.abs(late - rest).mean(axis=1)
    assert np.percentile(trail, 95) <= 0.02 * rest.mean()


def test_same_seed_same_light(technique, make_stage, lit_room, inner_surface):
    """To the bit, also after a reset; another seed differs."""
    surface = inner_surface(200, opening=True)
    sky = Sky.gradient((1, 1, 1), (0.5, 0.4, 0.3), (0, 1, 0))

    def run(seed: int) -> np.ndarray:
        stage = make_stage(technique, lit_room, sky=sky, lights=(SUN,), grid=GRID, seed=seed)
        return stage.run(10).irradiance(*surface)

    first = run(0)
    np.testing.assert_array_equal(first, run(0))
    assert np.any(first != run(1))


def test_no_nan_in_a_hostile_scene(technique, make_stage, inner_surface):
    """Needles, sheets, overlaps, a primitive around everything, probes inside solids, points inside
    solids.
    """
    rng = np.random.default_rng(3)
    parts = [make_box((0, 0, 0), (30, 1e-4, 30)), make_box((0, -5, 0), (40, 2, 40), emission=(1e4, 0, 1e-6))]
    for _ in range(20):
        parts.append(make_box(rng.uniform(-2, 2, 3), 10.0 ** rng.uniform(-4, 0.5, 3)))
    hostile = PrimitiveSet.concatenate(parts)
    stage = make_stage(technique, hostile, sky=Sky.constant((1, 1, 1)), lights=(SUN,), grid=GRID).run(20)
    points = rng.uniform(-3, 3, (3000, 3))
    normals = rng.normal(size=(3000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    irradiance = stage.irradiance(points, normals)
    assert np.all(np.isfinite(irradiance))
    assert np.all(irradiance >= 0)
    assert irradiance.mean() > 0
