"""A square kilometre that streams through the probe volume as the viewer flies."""

import subprocess
import sys

import numpy as np
import pytest

from fit import export
from runtime.lights import Sun
from runtime.sky import Sky

SUN, SKY = Sun((0.5, 0.8, 0.35), 6.0), Sky.constant((0.4, 0.5, 0.7))
SPACING, VOLUME = 6.0, (5, 3, 5)
"""Metres, and probes on each axis: as many for a town as for a room."""

BUDGET = 25
"""Probes that are updated in a frame, a third of all."""

FRAMES, SPEED = 16, 4.5
"""Of the flight, and metres in each: 970 km/h at sixty frames a second."""


@pytest.fixture(scope="module")
def town(repository, tmp_path_factory):
    folder = tmp_path_factory.mktemp("town")
    subprocess.run(
        [sys.executable, repository / "assets" / "town.py", folder], check=True, stdout=subprocess.DEVNULL
    )
    return export.read(folder / "town.npz")


def test_the_town_is_a_square_kilometre_of_some_thousand_primitives(town):
    lower, upper = town.bounds()
    assert (upper - lower)[[0, 2]] == pytest.approx((1000, 1000))
    assert 5_000 < len(town) < 10_000


@pytest.mark.slow
def test_light_streams_in_as_the_viewer_flies(make_stage, town):
    """Over 68 m the volume keeps its number of probes and scrolls; 40 frames after he stops, light on the
    street around him is that of a start on the spot."""

    def fly(start: float, frames: int, speed: float):
        for k in range(frames):
            stage.viewer = np.array([-252.0, 6.0, start - speed * k])
            stage.run()

    options = {"sky": SKY, "lights": (SUN,), "probe_spacing": SPACING, "volume": VOLUME, "max_probes": 512}
    options["probes_per_frame"] = BUDGET
    stage = make_stage("sdfddgi", town, **options)
    fly(200.0, 3, 0.0)
    first = stage.technique.grid
    fly(200.0, FRAMES, SPEED)
    here = 200.0 - SPEED * (FRAMES - 1)
    grid = stage.technique.grid
    assert stage.technique.follows and stage.technique.count == int(np.prod(VOLUME))
    assert (grid.counts, grid.spacing) == (first.counts, SPACING)
    assert np.abs(grid.centre[[0, 2]] - (-252.0, here)).max() <= SPACING
    rng = np.random.default_rng(2)
    points = np.stack(
        [rng.uniform(-254, -244, 60), np.zeros(60), rng.uniform(here - 8, here + 8, 60)], axis=1
    )
    up = np.tile([0.0, 1.0, 0.0], (60, 1))
    fly(here, 40, 0.0)
    flown = np.mean([stage.run().irradiance(points, up) for _ in range(4)], axis=0)
    stage = make_stage("sdfddgi", town, **options)
    fly(here, 40, 0.0)
    fresh = np.mean([stage.run().irradiance(points, up) for _ in range(4)], axis=0)
    assert fresh.mean() > 0.1
    assert np.abs((flown - fresh).mean(axis=1)).mean() <= 0.02 * fresh.mean()
