"""Shaded points that the primitives swallow or cut off: where a lookup starts for them."""

import numpy as np
import pytest

from fit.primitives import PrimitiveSet, make_box
from runtime.probes import ProbeGrid
from runtime.sky import Sky
from runtime.world import WorldSettings

CURTAIN = make_box((0, 0, 0), (3.0, 3.0, 0.02), albedo=(0.5, 0.5, 0.5))
LAMP = make_box((0, 0, 1.2), (0.8, 0.8, 0.1), albedo=(0, 0, 0), emission=(4, 4, 4))
GRID = ProbeGrid((-1.4, -1.4, -1.4), 0.7, (5, 5, 5))
PLACES = np.array([(x, y) for x in (-0.8, 0.1, 0.9) for y in (-0.7, 0.2, 0.8)])


def at_depth(z: float) -> np.ndarray:
    return np.column_stack([PLACES, np.full(len(PLACES), z)])


@pytest.fixture
def stage(technique, make_stage, make_room):
    """A sealed room that a curtain divides; the half at +z is lit."""
    primitives = PrimitiveSet.concatenate([make_room(0.2), CURTAIN, LAMP])
    return make_stage(technique, primitives, grid=GRID, world=WorldSettings(start_limit=0.15)).run(16)


def test_folds_behind_a_curtains_stand_in_take_the_light_of_their_own_side(stage):
    """Folds lie up to 8 cm behind the flat primitive: lit when seen from +z, dark when seen from -z."""
    towards = np.tile([0.0, 0.0, 1.0], (len(PLACES), 1))
    lit = stage.irradiance(at_depth(0.011), towards)
    assert lit.min() > 0.2
    np.testing.assert_allclose(stage.irradiance(at_depth(-0.08), towards), lit, rtol=0.05)
    assert stage.irradiance(at_depth(0.08), -towards).max() <= 1e-3 * lit.mean()


def test_a_fold_deeper_than_the_limit_stays_on_its_side(stage):
    towards = np.tile([0.0, 0.0, 1.0], (len(PLACES), 1))
    assert (
        stage.irradiance(at_depth(-0.3), towards).max()
        <= 1e-3 * stage.irradiance(at_depth(0.3), towards).mean()
    )


def test_sides_of_mouldings_look_out_through_the_nearest_face(stage):
    """3 cm inside the wall at x = 1.5, facing along it: out through the wall's face, not its far end."""
    up = np.tile([0.0, 1.0, 0.0], (3, 1))
    inside = np.array([(1.53, y, 0.8) for y in (-0.5, 0.0, 0.5)])
    before = inside - (0.04, 0, 0)
    np.testing.assert_allclose(stage.irradiance(inside, up), stage.irradiance(before, up), rtol=0.05)
    assert stage.irradiance(before, up).min() > 0.05


def test_no_point_leaves_through_the_back_of_its_wall(technique, make_stage, make_room):
    """A dark room under a bright sky: 2 cm below the wall's outside, but facing the room, it is dark."""
    grid = ProbeGrid((-2.1, -2.1, -2.1), 0.7, (7, 7, 7))
    stage = make_stage(
        technique,
        make_room(0.2),
        grid=grid,
        sky=Sky.constant((1, 1, 1)),
        world=WorldSettings(start_limit=0.1),
    ).run(4)
    deep = np.array([(1.68, y, 0.8) for y in (-0.5, 0.0, 0.5)])
    outward = np.tile([1.0, 0.0, 0.0], (3, 1))
    assert stage.irradiance(deep, outward).min() > 1
    assert stage.irradiance(deep, -outward).max() == 0
