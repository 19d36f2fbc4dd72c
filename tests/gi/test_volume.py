"""The volume of probes that follows the viewer: who stays, who comes in, and what lies beyond it."""

import numpy as np
import pytest

from fit.primitives import PrimitiveSet, make_box
from runtime.lights import Sun
from runtime.probes import IRRADIANCE_SIZE
from runtime.sdfddgi import SdfddgiSettings
from runtime.sky import Sky

SKY, SUN = Sky.constant((1.0, 1.0, 1.0)), Sun((1.0, 0.6, 0.3), 10.0)
AROUND = {"probe_spacing": 0.5, "max_probes": 8, "volume": (6, 6, 6)}
"""A volume 2.5 m wide, in scenes that are wider."""


@pytest.fixture
def street(make_room):
    """A sealed room between two slabs 8 m long."""
    slabs = [make_box((0, y, 0), (8, 0.2, 2.4)) for y in (-1.0, 1.0)]
    return PrimitiveSet.concatenate([make_room(0.02, size=1.6), *slabs])


def slots_of(stage) -> dict[tuple[int, int, int], int]:
    """Slot of the probe at each node of the grid, counted in spacings from where it began."""
    volume = stage.technique._volume
    places = np.stack(np.unravel_index(np.arange(len(volume.start)), volume.start.counts[::-1]), axis=1)
    slots = np.mod(places[:, ::-1] + volume.turn, volume.counts)
    x, y, _ = volume.counts
    nodes = places[:, ::-1] + volume.steps
    return dict(zip(map(tuple, nodes.tolist()), (slots @ [1, x, x * y]).tolist(), strict=True))


def state_of(stage) -> list[np.ndarray]:
    """Everything that the probes keep, a row for each slot."""
    technique, probes = stage.technique, stage.technique.probes
    tiles = probes.atlas.read().view(np.uint16)
    width = IRRADIANCE_SIZE + 2
    columns = probes.atlas.size[0] // width
    atlas = [
        tiles[width * (k // columns) :, width * (k % columns) :][:width, :width].ravel()
        for k in range(technique.count)
    ]
    rows = (technique.count + 1, -1)
    buffers = [probes.records, probes.exact, technique._histories]
    return [*(buffer.read(np.uint32).reshape(rows)[:-1] for buffer in buffers), np.array(atlas)]


def test_it_covers_a_scene_that_fits_and_follows_the_viewer_in_others(make_stage, street):
    whole = make_stage("sdfddgi", street, probe_spacing=1.0).technique
    assert (whole.follows, whole.grid.spacing) == (False, 1.0)
    coarse = make_stage("sdfddgi", street, probe_spacing=0.5, max_probes=64, volume=None).technique
    assert coarse.grid.spacing > 0.5
    assert not coarse.follows
    small = make_stage("sdfddgi", street, **AROUND).technique
    assert (small.follows, small.grid.spacing, small.grid.counts) == (True, 0.5, (6, 6, 6))
    np.testing.assert_allclose(small.grid.centre, 0, atol=1e-9)
    assert SdfddgiSettings().volume == (22, 14, 32)
    with pytest.raises(ValueError, match="two probes on each axis"):
        SdfddgiSettings(volume=(1, 4, 4))


def test_probes_that_stay_keep_all_they_have_to_the_bit(make_stage, street):
    """Beside a stage whose viewer stands still; probes that came in hold what they would anywhere."""
    still, moved = (make_stage("sdfddgi", street, sky=SKY, bounce=0.0, **AROUND) for _ in range(2))
    for viewer in ((0.0, 0.0, 0.0), (0.6, 0.0, 0.0), (1.1, 0.0, -0.6)):
        still.viewer, moved.viewer = np.zeros(3), np.array(viewer)
        still.run(2)
        moved.run(2)
    assert moved.technique._volume.steps.tolist() == [2, 0, -1]
    old, new = slots_of(still), slots_of(moved)
    stayed = sorted(set(old) & set(new))
    assert len(stayed) == 4 * 6 * 5
    slots = [old[node] for node in stayed]
    assert slots == [new[node] for node in stayed]
    for before, after in zip(state_of(still), state_of(moved), strict=True):
        np.testing.assert_array_equal(before[slots], after[slots])
    assert np.any(state_of(moved)[1][slots] != 0)
    came = [new[node] for node in set(new) - set(old)]
    frames = state_of(moved)[2].view(np.float32)[came, 0]
    assert set(frames[frames > 0].tolist()) <= {2.0, 4.0}


@pytest.mark.parametrize("choice", [{}, {"probes_per_frame": 27, "bounce_share": 0.25}])
def test_a_sealed_room_stays_black_as_the_volume_passes_through(make_stage, street, inner_surface, choice):
    """Frame by frame: probes come into the room from outside, and leave it again; the answer is exactly 0."""
    points, normals = inner_surface(1000, size=1.6)
    stage = make_stage("sdfddgi", street, sky=SKY, lights=(SUN,), **AROUND, **choice)
    outside = np.array([[2.4, 0.0, 0.0], [-2.4, 0.0, 0.0], [0.0, 1.4, 0.0]])
    for x in [*np.linspace(-3, 3, 16), 0.0, 30.0, 0.0]:
        stage.viewer = np.array([x, 0.1 * x, 0.0])
        stage.run()
        assert np.all(stage.irradiance(points, normals) == 0)
        assert np.all(stage.irradiance(outside, [[0, 1, 0]] * 3).mean(axis=1) >= 0)
    assert stage.run(8).irradiance(outside[2:], [[0, 1, 0]]).mean() > 1.0


def test_the_open_sky_is_the_same_inside_on_the_border_and_beyond(make_stage):
    speck = PrimitiveSet.concatenate([make_box((x, 0.2, 0.3), (1e-3,) * 3) for x in (-4.0, 4.0)])
    stage = make_stage("sdfddgi", speck, sky=SKY, **AROUND)
    stage.viewer = np.array([0.7, 0.0, 0.0])
    stage.run(8)
    points = np.stack([np.linspace(-4, 4, 60), np.zeros(60), np.zeros(60)], axis=1)
    normals = np.random.default_rng(0).normal(size=(60, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(stage.irradiance(points, normals), np.pi, rtol=0.005)


def test_beyond_it_there_is_the_part_of_the_sky_that_is_free(make_stage):
    """Far off, under a long roof, half of the sky is hidden from a wall, and all from the floor."""
    roof = PrimitiveSet.concatenate(
        [make_box((0, 1.0, 0), (40, 0.2, 40)), make_box((0, -1.0, 0), (40, 0.2, 40), albedo=(0, 0, 0))]
    )
    stage = make_stage("sdfddgi", roof, sky=SKY, **AROUND)
    stage.viewer = np.array([-15.0, 0.0, 0.0])
    stage.run(4)
    places, normals = [[15, 1.11, 0], [15, -0.89, 0], [19.9, 0, 0]], [[0, 1, 0], [0, 1, 0], [1, 0, 0]]
    above, floor, rim = stage.irradiance(places, normals).mean(axis=1)
    assert above == pytest.approx(np.pi, rel=0.01)
    assert floor == 0
    assert rim > 0.5 * np.pi
