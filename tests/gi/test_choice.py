"""The choice of probes that are updated in a frame: within its budget, by weight, and nobody starves."""

from itertools import pairwise

import numpy as np
import pytest

from fit.encoding import decode_albedo, encode_albedo
from fit.primitives import PrimitiveSet, make_box
from runtime.camera import frustum_planes, look_at
from runtime.probes import ProbeGrid
from runtime.sdfddgi import ProbeHistory, SdfddgiSettings
from runtime.sdfddgi_settings import BALANCED

GRID = ProbeGrid((-2.5, -2.5, -2.5), 1.0, (6, 6, 6))
EIGHTH = {"grid": GRID, "probes_per_frame": 27, "fresh_factor": 1, "bounce": 0.0}


@pytest.fixture
def make_hall(make_stage):
    """A nearly empty hall of 216 probes, of which some are updated in a frame."""

    def make(**settings):
        return make_stage("sdfddgi", make_box((0.2, 0.3, 0.4), (1.3, 1.3, 1.3)), **{**EIGHTH, **settings})

    return make


def watch(stage, frames: int) -> np.ndarray:
    """Which probes are chosen in each frame: (frames, n)."""
    seen = np.zeros((frames, stage.technique.count), bool)
    for row in seen:
        row[stage.run().technique.choice.read()] = True
    return seen


def waits(chosen: np.ndarray) -> np.ndarray:
    """The longest time (n,) between two turns of each probe, the ends of the record included."""
    ends = np.ones((1, chosen.shape[1]), bool)
    rows = np.concatenate([ends, chosen, ends])
    return np.array([max(b - a for a, b in pairwise(np.flatnonzero(column))) for column in rows.T])


def is_seen(stage, camera) -> np.ndarray:
    """Which probes the widened view of the camera holds."""
    planes = frustum_planes(stage.clip_from_local)
    places = stage.technique.probes.read_records()[0]
    return np.all(places @ planes[:, :3].T + planes[:, 3] >= -GRID.spacing, axis=1)


def test_frustum_planes_hold_what_the_camera_sees(make_hall):
    stage = make_hall().look(look_at((0, 0, 3.5), (0, 0, 0), fov=60, near=0.5), (100, 100))
    planes = frustum_planes(stage.clip_from_local)
    seen = np.array([[0.0, 0, 0, 1], [1.9, 0, 0, 1], [2.1, 0, 0, 1], [0, -2.1, 0, 1], [0, 0, 3.2, 1]])
    seen[:, :3] -= stage.world.origin
    assert (seen @ planes.T >= 0).all(axis=1).tolist() == [True, True, False, False, False]
    np.testing.assert_allclose(seen[0] @ planes.T, [1.75, 1.75, 1.75, 1.75, 3.0], atol=1e-9)


def test_the_budget_holds_and_goes_to_those_whose_turn_is_nearest(make_hall):
    stage = make_hall().look(look_at((0, 0, 0), (0, 0, -1)))
    is_on = stage.technique.place()[1]
    for _ in range(12):
        chosen = stage.run().technique.choice.read()
        keys = stage.technique.choice._keys.read(np.uint32, (216,))
        assert np.all(keys[~is_on] == 0)
        assert 25 <= len(chosen) <= 27  # of two with the same key, neither may fit
        assert keys[chosen].min() > np.delete(keys, chosen).max()


@pytest.mark.parametrize("budget", [1, 300])
def test_a_budget_may_be_one_probe_or_more_than_there_are(make_hall, budget):
    stage = make_hall(probes_per_frame=budget)
    is_on = stage.technique.place()[1]
    assert len(stage.run(2).technique.choice.read()) == min(budget, is_on.sum())


def test_no_probe_waits_longer_than_its_limit_while_the_camera_stands(make_hall):
    camera = look_at((0, 0, 2.4), (0, 0, 0), fov=70)
    stage = make_hall().look(camera)
    is_on = stage.technique.place()[1]
    longest = waits(watch(stage.run(16), 64))
    seen = is_seen(stage, camera)
    assert 0.1 < seen[is_on].mean() < 0.9
    assert longest[is_on & seen].max() <= 8
    assert longest[is_on & ~seen].max() <= 16


def test_nor_while_it_turns(make_hall):
    """A probe that has come into view waits no longer than those that were there."""
    stage = make_hall().look(look_at((0, 0, 0), (0, 0, -1)))
    is_on = stage.technique.place()[1]
    stage.run(16)
    waited, in_view = np.zeros(216), np.zeros(216)
    for frame in range(60):
        angle = 0.15 * frame
        camera = look_at((0, 0, 0), (np.sin(angle), 0.2, -np.cos(angle)), fov=60)
        stage.look(camera)
        chosen = watch(stage, 1)[0]
        waited = np.where(chosen, 0, waited + 1)
        in_view = np.where(is_seen(stage, camera) & ~chosen, in_view + 1, 0)
        assert waited[is_on].max() <= 16
        assert in_view[is_on].max() <= 8


def test_those_near_the_viewer_and_before_him_are_chosen_more_often(make_hall):
    stage = make_hall(half_distance=1.0, longest_wait_seen=40, longest_wait_unseen=40)
    stage.look(look_at((0.0, 0.0, -1.0), (0, 0, -2)))
    is_on = stage.technique.place()[1]
    turns = watch(stage.run(10), 90).sum(axis=0)
    way = GRID.positions() - [0.0, 0.0, -1.0]
    away, ahead = np.linalg.norm(way, axis=1), -way[:, 2] / np.linalg.norm(way, axis=1)
    near, far = is_on & (away < 2.0), is_on & (away > 3.0)
    assert turns[near & (ahead > 0.3)].mean() > 2 * turns[far].mean()
    beside = is_on & (away < 3.0)
    assert turns[beside & (ahead > 0.6)].mean() > 1.2 * turns[beside & (ahead < -0.6)].mean()
    assert turns[is_on].min() >= 2


def test_an_eighth_in_each_frame_ends_in_the_same_light(make_stage, make_room, inner_surface):
    """Glowing walls of albedo 0.5, E = pi Le / (1 - rho): all bounces arrive, with fewer rays too."""
    room = make_room(0.2, albedo=0.5, emission=2.0)
    few = {"probes_per_frame": 1, "bounce_share": 0.25}
    stage = make_stage("sdfddgi", room, grid=ProbeGrid((-0.8, -0.8, -0.8), 1.6, (2, 2, 2)), **few).run(160)
    stored = float(decode_albedo(encode_albedo(np.full((1, 3), 0.5)))[0, 0])
    np.testing.assert_allclose(stage.irradiance(*inner_surface(200)), 2 * np.pi / (1 - stored), rtol=0.02)


@pytest.mark.parametrize("share", [0.5, 0.25])
def test_fewer_rays_for_bounces_give_the_same_mean(make_stage, make_room, inner_surface, share):
    """Under a lamp on the ceiling, so that the light is anything but even."""
    lamp = make_box((0.0, 1.47, 0.0), (1.0, 0.06, 1.0), albedo=(0, 0, 0), emission=(5, 5, 5))
    room = PrimitiveSet.concatenate([make_room(0.2, albedo=0.5), lamp])
    grid, surface = ProbeGrid((-0.8, -0.8, -0.8), 1.6, (2, 2, 2)), inner_surface(200)
    all_rays, some = (
        make_stage("sdfddgi", room, grid=grid, rays_per_probe=256, bounce_share=bounce_share)
        .run(60)
        .irradiance(*surface)
        .mean()
        for bounce_share in (1.0, share)
    )
    assert some == pytest.approx(all_rays, rel=0.01)


def test_same_seed_same_choice(make_hall):
    camera = look_at((0, 0, 0), (0, 0, -1))
    first, again, other = (watch(make_hall(seed=seed).look(camera), 12) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert np.any(first != other)


def test_probes_without_light_come_first(make_stage):
    """A volume moves by a spacing: the layer that came in has its turn at once."""
    around = {"probe_spacing": 1.0, "max_probes": 8, "volume": (6, 6, 6), "probes_per_frame": 40}
    scene = make_box((0.2, 0.3, 0.4), (40.0, 1e-3, 1e-3))
    stage = make_stage("sdfddgi", scene, **around)
    stage.viewer = np.zeros(3)
    stage.run(8)
    steps = stage.technique._volume.steps.copy()
    stage.viewer = np.array([1.2, 0.0, 0.0])
    stage.run()
    assert (stage.technique._volume.steps - steps).tolist() == [1, 0, 0]
    updates = stage.technique._histories.read(ProbeHistory.dtype, (217,))[:-1]["updates"]
    is_on = stage.technique.probes.read_records()[1]
    came = is_on & (np.arange(216) % 6 == (int(stage.technique._volume.turn[0]) - 1) % 6)
    assert came.sum() > 30
    assert set(updates[came].tolist()) == {1}
    assert set(stage.technique.choice.read()) >= set(np.flatnonzero(came).tolist())
    assert updates[is_on & ~came].sum() > 200


def test_the_balanced_settings_update_an_eighth_of_the_papers_probes():
    assert BALANCED.max_probes == np.prod(BALANCED.volume) == 9856
    assert BALANCED.max_probes / 8 <= BALANCED.probes_per_frame < 1.01 * BALANCED.max_probes / 8
    assert BALANCED.rays_per_probe == 64


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"probes_per_frame": 0}, "probes_per_frame is 0"),
        ({"probes_per_frame": 70000}, "between 1 and 65535"),
    ],
)
def test_a_budget_that_cannot_be_is_refused(make_hall, settings, message):
    with pytest.raises(ValueError, match=message):
        make_hall(**settings)


@pytest.mark.parametrize(
    "settings",
    [{"bounce_share": 0.3}, {"longest_wait_seen": 20}, {"half_distance": 0.0}, {"behind": 2.0}],
)
def test_settings_that_cannot_be_are_refused(settings):
    with pytest.raises(ValueError, match=next(iter(settings))):
        SdfddgiSettings(**settings)
