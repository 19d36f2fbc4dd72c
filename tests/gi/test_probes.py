"""Where probes stand, what they store, and what no probe sees."""

import numpy as np
import pytest

from fit import sdf
from fit.primitives import PrimitiveSet, make_box, make_half_space, make_sphere
from fit.scene import Camera, Scene
from runtime.lights import Sun
from runtime.no_gi import NoGi
from runtime.probes import ProbeGrid
from runtime.renderer import Renderer
from runtime.sdfddgi import SdfddgiSettings
from runtime.settings import RenderSettings
from runtime.sky import Sky
from runtime.technique import Gather, create
from runtime.world import World


def test_grid_covers_its_bounds_within_its_budget():
    grid = ProbeGrid.around(([-10, 0, -4], [10, 6, 4]), max_probes=2000)
    assert len(grid) <= 2000
    positions = grid.positions()
    assert positions.shape == (len(grid), 3)
    assert np.all(positions.min(axis=0) <= [-10, 0, -4])
    assert np.all(positions.max(axis=0) >= [10, 6, 4])
    assert np.ptp(np.diff(np.unique(positions[:, 0].round(9)))) < 1e-6
    coarse = ProbeGrid.around(([0, 0, 0], [3, 3, 3]), spacing=1.5)
    assert coarse.spacing == 1.5
    assert coarse.counts == (3, 3, 3)
    with pytest.raises(ValueError, match="max_probes is 7"):
        ProbeGrid.around(([0, 0, 0], [3, 3, 3]), max_probes=7)


@pytest.mark.parametrize("spacing", [0.5, 1.0])
def test_probes_stand_free(make_stage, spacing):
    """No probe that is on stands inside a primitive, nearer than the clearance where there is room, or far
    away.
    """
    rng = np.random.default_rng(2)
    blocks = [make_box(rng.uniform(-2, 2, 3), rng.uniform(0.1, 1.2, 3)) for _ in range(12)]
    scene = PrimitiveSet.concatenate([*blocks, make_sphere((0, 0, 0), 0.7), make_half_space((0, -2, 0))])
    count = round(6 / spacing)
    grid = ProbeGrid((-3.0, -3.0, -3.0), spacing, (count, count, count))
    stage = make_stage("sdfddgi", scene, grid=grid).run()
    places, is_on = stage.technique.probes.read_records()
    world = places[is_on] + stage.world.origin
    distance = sdf.union_distance(scene, world)[0]
    assert distance.min() >= 1.9 * stage.world.start_margin
    assert np.mean(distance > 0.9 * SdfddgiSettings().clearance * spacing) > 0.95
    moved = np.linalg.norm(world - grid.positions()[is_on], axis=1)
    assert moved.max() <= 0.7 * spacing + 1e-3
    deep = sdf.union_distance(scene, grid.positions())[0] < -0.46 * spacing
    assert deep.any()
    assert not is_on[deep].any()


def test_probes_next_to_a_wall_stand_near_it(make_stage, make_room):
    """A room's light varies most near its walls: the first layer of probes comes close to them."""
    grid = ProbeGrid((-1.2, -1.2, -1.2), 0.8, (4, 4, 4))
    stage = make_stage("sdfddgi", make_room(0.2), grid=grid).run()
    places, is_on = stage.technique.probes.read_records()
    outer = np.abs(grid.positions()).max(axis=1) > 1.0
    gap = 1.5 - np.abs(places[is_on & outer] + stage.world.origin).max(axis=1)
    np.testing.assert_allclose(gap, SdfddgiSettings().clearance * 0.8, atol=1e-3)


def test_a_probe_alone_between_two_walls_stays_between_them(make_stage, make_room):
    grid = ProbeGrid((-3.6, -3.6, -3.6), 4.0, (3, 3, 3))
    stage = make_stage("sdfddgi", make_room(0.2), grid=grid).run()
    places, is_on = stage.technique.probes.read_records()
    inside = is_on & (np.abs(places + stage.world.origin).max(axis=1) < 1.5)
    np.testing.assert_allclose(places[inside] + stage.world.origin, [[0.4, 0.4, 0.4]], atol=1e-4)


def test_a_new_solid_switches_its_probes_off_and_their_light_returns(make_stage, make_room, inner_surface):
    room = make_room(0.2, emission=1.0)
    grid = ProbeGrid((-1.0, -1.0, -1.0), 1.0, (3, 3, 3))
    stage = make_stage("sdfddgi", room, grid=grid).run(30)
    before = stage.technique.probes.read_records()[1].sum()
    stage.world.update(PrimitiveSet.concatenate([room, make_box((1, 0, 0), (0.95, 2.9, 2.9))]))
    during = stage.run(2).technique.probes.read_records()[1].sum()
    assert during < before
    stage.world.update(room)
    after = stage.run(100)
    assert after.technique.probes.read_records()[1].sum() == before
    np.testing.assert_allclose(after.irradiance(*inner_surface(200)).mean(), 2 * np.pi, rtol=0.02)


def test_a_point_that_sees_no_probe_asks_the_next_ring(make_stage, make_room):
    """The eight probes around the middle are shut into little black cubes; those of the next ring are not."""
    corners = 0.4 * np.stack(np.meshgrid(*[[-1, 1]] * 3), axis=-1).reshape(-1, 3)
    cubes = [make_box(corner, (0.1, 0.1, 0.1), albedo=(0, 0, 0)) for corner in corners]
    scene = PrimitiveSet.concatenate([make_room(0.2, emission=1.0, albedo=0.0), *cubes])
    grid = ProbeGrid((-1.2, -1.2, -1.2), 0.8, (4, 4, 4))
    stage = make_stage("sdfddgi", scene, grid=grid, relocation=0.0, attraction=0.0).run(20)
    is_on = stage.technique.probes.read_records()[1].reshape(4, 4, 4)
    assert not is_on[1:3, 1:3, 1:3].any()
    assert is_on.sum() == 64 - 8
    irradiance = stage.irradiance(np.zeros((6, 3)), np.concatenate([np.eye(3), -np.eye(3)]))
    np.testing.assert_allclose(irradiance, np.pi, rtol=0.1)  # the cubes hide a few per cent of the walls


def test_thin_wall_bounces_each_side_in_its_own_colour(make_stage):
    """A wall red here and white there, 2 cm thick, under a white sky: each side bounces its own colour."""
    wall = make_box(
        (0, 0, 0),
        (0.02, 6, 6),
        albedo=[(0.8, 0.1, 0.1), (0.8, 0.8, 0.8)] + [(0, 0, 0)] * 4,
    )
    grid = ProbeGrid((-1.5, -1.0, -1.0), 1.0, (4, 3, 3))
    stage = make_stage("sdfddgi", wall, sky=Sky.constant((1, 1, 1)), grid=grid).run(40)
    points = np.array([[0.4, 0.0, 0.0], [-0.4, 0.0, 0.0]])
    facing_the_wall = np.array([[-1.0, 0, 0], [1.0, 0, 0]])
    red_side, white_side = stage.irradiance(points, facing_the_wall)
    # Sky past the wall's rim adds a little white to both.
    assert red_side[1] / red_side[0] < 0.35
    np.testing.assert_allclose(white_side, white_side[0], rtol=0.02)


def test_turning_the_camera_changes_nothing(gpu, make_room, inner_surface):
    """Through the renderer, as a viewer turns round: the light at fixed points stays within 2 %."""
    points, normals = inner_surface(300, opening=True)
    settings = RenderSettings(
        size=(16, 16), technique=SdfddgiSettings(grid=ProbeGrid((-1.0, -1.0, -1.0), 1.0, (3, 3, 3)))
    )
    from runtime.lights import Illumination

    light = Illumination(lights=(Sun((1.0, 0.6, 0.3), 10.0),), sky=Sky.constant((1, 1, 1)))
    renderer = Renderer(gpu, Scene(source=__file__), make_room(0.2, opening=True), settings, light)
    gather = Gather(gpu, renderer.world, renderer.technique)
    seen = []
    for turn in (1.0, -1.0):
        pose = np.diag([turn, 1.0, turn, 1.0])
        renderer.set_camera(Camera("eye", pose, yfov=1.0))
        for _ in range(200):
            renderer.draw_frame(only_light=True)
        seen.append(gather.irradiance(points, normals).mean(axis=1))
    changed = np.abs(seen[1] - seen[0]) / seen[0].mean()
    assert np.percentile(changed, 95) <= 0.02


def test_no_gi_is_black_and_has_no_settings(gpu):
    world = World(gpu, None, make_box())
    technique = create("none", gpu, world)
    assert isinstance(technique, NoGi)
    assert np.all(Gather(gpu, world, technique).irradiance(np.ones((5, 3)), np.ones((5, 3))) == 0)
    with pytest.raises(ValueError, match="no settings"):
        create("none", gpu, world, SdfddgiSettings())
    with pytest.raises(ValueError, match="there are sdfddgi, ddgi, none"):
        create("vxgi", gpu, world)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"rays_per_probe": 100}, "multiple of 64"),
        ({"bounce": 1.5}, "between 0 and 1"),
        ({"history_frames": 0.5}, "at least 1"),
    ],
)
def test_settings_that_make_no_sense(values, message):
    with pytest.raises(ValueError, match=message):
        SdfddgiSettings(**values)
