"""Cascades of probes that follow the viewer: who stays, who is updated when, and that they answer as one."""

import numpy as np
import pytest

from runtime import cascades
from runtime.cascades import Cascade, is_turn, lay_cascades
from runtime.ddgi import DdgiSettings
from runtime.probes import IRRADIANCE_SIZE, ProbeGrid
from runtime.sky import Sky

BOUNDS = (np.array([-2.0, -1.0, -3.0]), np.array([2.0, 3.0, 3.0]))
FROZEN = {
    "hysteresis": 1.0,
    "hysteresis_drop": 0.0,
    "change_altogether": 2.0,
    "relocation": 0.0,
    "settling_growth": 1e9,
}
"""Settings under which a probe keeps what its first frame saw."""

SKY = Sky.constant((1.0, 1.0, 1.0))


@pytest.fixture
def small_cascades(monkeypatch):
    monkeypatch.setattr(cascades, "CASCADE_COUNTS", (8, 4, 8))


def test_each_is_twice_as_wide_and_the_coarsest_holds_the_scene():
    found = lay_cascades(BOUNDS, 3, None, 8.0)
    assert [c.start.spacing / found[0].start.spacing for c in found] == [1, 2, 4]
    assert found[-1].start.spacing * 31 == pytest.approx(2 * 6.0)
    assert [c.first for c in found] == [0, 4096, 8192]
    assert {c.start.counts for c in found} == {(32, 4, 32)}


@pytest.mark.parametrize("count", [0, 9])
def test_a_number_that_cannot_be_is_refused(count):
    with pytest.raises(ValueError, match=f"cascades is {count}"):
        lay_cascades(BOUNDS, count, None, 8.0)


def test_no_two_coarse_ones_have_their_turn_together_and_each_has_it_half_as_often():
    turns = np.array([[is_turn(number, frame) for frame in range(32)] for number in range(5)])
    assert turns.sum(axis=1).tolist() == [32, 16, 8, 4, 2]
    assert turns[1:].sum(axis=0).max() == 1


def test_a_viewer_within_a_spacing_moves_nothing_and_one_beyond_moves_whole_spacings():
    cascade = Cascade(ProbeGrid((0.0, 0.0, 0.0), 0.5, (8, 4, 8)))
    centre = np.array([1.75, 0.75, 1.75])
    assert cascade.follow(centre)  # all probes are new
    assert not cascade.follow(centre + 0.49)
    assert cascade.follow(centre + np.array([1.3, 0, -0.6]))
    assert cascade.steps.tolist() == [2, 0, -1]
    assert cascade.grid.lower == (1.0, 0.0, -0.5)
    assert [corner.tolist() for corner in cascade.kept] == [[0, 0, 1], [6, 4, 8]]
    middle = cascade.grid.positions().mean(axis=0)
    assert not cascade.is_left(middle + 0.9)
    assert cascade.is_left(middle + np.array([1.6, 0, 0]))


def test_probes_that_stay_keep_their_light_to_the_bit(make_stage, make_room, small_cascades):
    """The viewer goes two spacings along x and one back along z: the others are new."""
    stage = make_stage("ddgi", make_room(0.2, emission=1.0), cascades=1, probe_spacing=0.3, **FROZEN)
    stage.viewer = np.zeros(3)
    before = probes_of(stage.run(3))
    stage.viewer = np.array([0.6, 0.0, -0.3])
    after = probes_of(stage.run(1))
    stayed = sorted(set(before) & set(after))
    assert len(before) == len(after) == 256
    assert len(stayed) == 6 * 4 * 7
    assert all(np.array_equal(before[node], after[node]) for node in stayed)
    assert all(after[node].max() > 0 for node in after)


def probes_of(stage) -> dict[tuple[int, int, int], np.ndarray]:
    """Of each probe, by its place in spacings from the middle of the world: the map that it keeps."""
    technique = stage.technique
    states = technique._states.read(np.float32, (len(technique.grid), 4))
    maps = technique._encoded.read(np.float32, (len(technique.grid), IRRADIANCE_SIZE**2 * 4))
    nodes = np.rint((states[:, :3] + stage.world.origin) / technique.grid.spacing - 0.5).astype(int)
    return {tuple(node): light for node, light in zip(nodes.tolist(), maps, strict=True)}


def test_all_of_them_answer_as_one(make_stage, make_room, inner_surface, small_cascades):
    """Glowing walls, seen by points in the finest cascade, in the coarser ones, and on their borders."""
    stage = make_stage("ddgi", make_room(0.2, emission=2.0), bounce=0.0, cascades=3, probe_spacing=0.15)
    stage.viewer = np.array([0.9, -0.9, 0.9])
    points, normals = inner_surface(300)
    np.testing.assert_allclose(stage.run(4).irradiance(points, normals), 2 * np.pi, rtol=0.02)


def test_coarse_ones_catch_up_with_a_viewer_who_jumps(make_stage, make_room, small_cascades):
    stage = make_stage("ddgi", make_room(0.2, emission=1.0), cascades=3, probe_spacing=0.05)
    stage.viewer = np.array([-1.0, -1.0, -1.0])
    stage.run(2)
    stage.viewer = np.array([1.0, 1.0, 1.0])
    stage.run(1)
    for cascade in stage.technique.cascades[:2]:
        middle = cascade.grid.positions().mean(axis=0)
        assert np.all(np.abs(middle - stage.viewer) < cascade.start.spacing)


def test_without_the_test_of_visibility_there_are_no_distances_and_leaks(
    make_stage, make_room, inner_surface, small_cascades
):
    """A closed room under a bright sky."""
    seen, blind = (
        make_stage("ddgi", make_room(0.2), cascades=1, probe_spacing=0.7, visible_cascades=visible, sky=SKY)
        for visible in (1.0, 0.0)
    )
    points, normals = inner_surface(300)
    light = [stage.run(4).irradiance(points, normals).mean() for stage in (seen, blind)]
    assert light[1] > 5 * light[0]
    assert seen.technique.memory - blind.technique.memory > 8 * 16 * 16 * 255


def test_their_number_is_checked_where_it_is_given():
    with pytest.raises(ValueError, match="visible_cascades"):
        DdgiSettings(visible_cascades=-1.0)
