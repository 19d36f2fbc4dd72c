"""Which lights are on, how the file's are read, and where their tiles stand."""

from __future__ import annotations

import numpy as np
import pytest

from fit import scene as model
from fit.scene import LightKind
from runtime.lights import (
    Illumination,
    Point,
    Spot,
    Sun,
    choose_illumination,
    file_lights,
    light_records,
    plan_tiles,
    untiled_notes,
)
from runtime.settings import ShadowSettings
from runtime.sky import Sky

BOUNDS = (np.array([-2.0, 0.0, -3.0]), np.array([4.0, 5.0, 3.0]))
ORIGIN = np.array([1.0, 2.5, 0.0])


@pytest.fixture
def lit_scene(builder):
    """A directional light straight down, a spot along +X and a point, as a file stores them."""
    down = np.array([[1.0, 0, 0, 0], [0, 0, 1, 5], [0, -1, 0, 0], [0, 0, 0, 1]])
    along_x = np.array([[0.0, 0, -2, 1], [0, 2, 0, 2], [2, 0, 0, 3], [0, 0, 0, 1]])
    builder.parts["lights"] += [
        model.Light("sun", LightKind.DIRECTIONAL, (1, 0.5, 0.25), 8.0, down),
        model.Light("spot", LightKind.SPOT, (1, 1, 1), 20.0, along_x, 6.0, 0.1, 0.4),
        model.Light("point", LightKind.POINT, (0, 1, 0), 3.0, along_x),
    ]
    builder.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    return builder.scene()


def test_lux_and_candela_are_read_as_watts(lit_scene):
    sun, spot, point = file_lights(lit_scene)
    assert sun == Sun((0.0, 1.0, 0.0), (8.0, 4.0, 2.0))
    assert spot == Spot((1.0, 2.0, 3.0), (1.0, 0.0, 0.0), (20.0,) * 3, 0.1, 0.4, 6.0)
    assert point == Point((1.0, 2.0, 3.0), (0.0, 3.0, 0.0))


def test_a_given_sun_or_sky_switches_the_files_lights_off(lit_scene):
    sun, sky = Sun((0, 1, 0), 1.0), Sky.constant((1, 1, 1))
    assert choose_illumination(lit_scene).lights == file_lights(lit_scene)
    assert choose_illumination(lit_scene, sun).lights == (sun,)
    assert choose_illumination(lit_scene, sky=sky).lights == ()
    assert "3 lights of the file are off" in choose_illumination(lit_scene, sky=sky).notes
    both = choose_illumination(lit_scene, sun, keep_file_lights=True)
    assert both.lights == (sun, *file_lights(lit_scene)) and both.notes == ()


def test_a_dark_file_gets_a_default_and_a_note(builder):
    builder.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    illumination = choose_illumination(builder.scene())
    assert isinstance(illumination.lights[0], Sun) and not illumination.sky.is_black
    assert illumination.notes == ("the file has no light: a default sun and sky are on",)
    assert len(illumination.describe()) == 2


def test_a_glowing_file_gets_none(builder):
    builder.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), emission=(1.0, 0, 0))
    assert choose_illumination(builder.scene()) == Illumination()


def test_a_sun_without_direction_is_refused():
    with pytest.raises(ValueError, match="not 0,0,0"):
        Sun((0, 0, 0), 1.0)


def test_tiles_hold_the_whole_scene_and_do_not_overlap():
    """Every corner of the bounds lands inside its light's tile; suns take full tiles, spots half ones."""
    spots = [Spot((0, 4.5, z), (0.2, -1, 0), 1.0, 0.1, 0.7) for z in (-1.0, 0.0, 1.0)]
    lights = [Sun((0.3, 1, 0.2), 1.0), Point((0, 1, 0), 1.0), *spots, Sun((0, 1, 0), 1.0)]
    tiles, (width, height) = plan_tiles(lights, BOUNDS, ORIGIN, ShadowSettings(map_size=64))
    assert [tile.light for tile in tiles] == [0, 5, 2, 3, 4]
    assert (width, height) == (64, 192)
    covered = np.zeros((height, width), int)
    for tile in tiles:
        x, y = tile.corner
        covered[y : y + tile.size, x : x + tile.size] += 1
    assert covered.max() == 1 and covered.sum() == 2 * 64**2 + 3 * 32**2
    corners = np.array([[BOUNDS[(k >> a) & 1][a] for a in range(3)] for k in range(8)]) - ORIGIN
    for tile in tiles[:2]:
        clip = np.c_[corners, np.ones(8)] @ tile.clip_from_local.T
        assert np.abs(clip[:, :2]).max() < 1 and clip[:, 2].min() > 0 and clip[:, 2].max() < 1
        assert np.abs(clip[:, :2]).max() > 0.99, "the view is tight"
    seen = tiles[2].clip_from_local @ np.append(np.array([0.2, 3.5, -1.0]) - ORIGIN, 1)
    np.testing.assert_allclose(seen[:2] / seen[3], 0, atol=1e-9)


def test_what_gets_no_tile_is_told():
    lights = [
        Spot((0, 1, 0), (0, -1, 0), 1.0, 0.1, 1.5),
        Sun((0, 1, 0), 1.0),
        Sun((1, 1, 0), 1.0),
        Point((0,) * 3, 1),
    ]
    tiles, _ = plan_tiles(lights, BOUNDS, ORIGIN, ShadowSettings(map_size=64, max_suns=1))
    assert [tile.light for tile in tiles] == [1]
    assert untiled_notes(lights, tiles)[0].startswith("2 suns or spots have no shadow map")
    assert plan_tiles(lights, None, ORIGIN, ShadowSettings()) == ((), (1, 1))
    assert untiled_notes([lights[3]], ()) == ()


def test_shadow_settings_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="take a smaller map_size"):
        ShadowSettings(map_size=4096)


def test_records_are_local_and_never_empty():
    records = light_records([Spot((3, 2, 1), (0, 0, -2), 4.0, 0.0, np.pi / 3, range=9.0)], (), ORIGIN)
    np.testing.assert_allclose(records[0]["position"], [2, -0.5, 1])
    np.testing.assert_allclose(records[0]["axis"], [0, 0, -1])
    np.testing.assert_allclose([records[0]["angle_scale"], records[0]["angle_offset"]], [2, -1], rtol=1e-6)
    assert records[0]["range"] == 9 and records[0]["has_tile"] == 0
    assert len(light_records([], (), ORIGIN)) == 1
