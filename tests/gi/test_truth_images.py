"""Small pictures of indirect light against what Mitsuba measured at the same points, for each technique.

tests/images/make_truth.py wrote the references. The primitives are the meshes' own solids, so that nothing
but light is tested; limits are half as much again as what was measured.
"""

import tomllib

import numpy as np
import pytest

from fit import gltf
from fit.export import read
from pipelines.difference import relative_error, twice
from pipelines.studio import LightingOptions, Studio
from runtime.probes import ProbeGrid
from runtime.renderer import Renderer
from runtime.settings import RenderSettings, ShadowSettings

FRAMES = 40

LIMITS = {
    "sdfddgi": {
        "closed_box": 0.0001,
        "cornell": 0.21,
        "courtyard": 0.26,
        "curtains": 0.021,
        "emissive_room": 0.039,
        "furnace": 0.0001,
        "tunnel": 0.0184,
        "two_rooms": 0.0088,
    },
    "ddgi": {
        "closed_box": 0.0001,
        "cornell": 0.383,
        "courtyard": 0.23,
        "curtains": 0.141,
        "emissive_room": 0.028,
        "furnace": 0.0001,
        "tunnel": 0.3,
        "two_rooms": 0.027,
    },
}
"""relMSE of irradiance with probes at the spacing of assets/stages.toml, after 40 frames."""

FAST = {"closed_box": 0.0002, "furnace": 0.0002}
"""The same of "sdfddgi" with probes twice as far apart."""


@pytest.fixture
def error_of(gpu, bundled_assets, repository, settings_of):
    """relMSE of a technique's picture of a scene, its probes `widening` times as far apart as there."""
    stages = tomllib.loads((bundled_assets / "stages.toml").read_text(encoding="utf-8"))

    def measure(name: str, technique: str, widening: float = 1.0) -> float:
        stage = stages[name]
        with np.load(repository / "tests" / "images" / "truth" / f"{name}.npz") as file:
            shown, halves = file["shown"], file["irradiance"].astype(np.float64)
        scene, primitives = gltf.load(bundled_assets / f"{name}.glb"), read(bundled_assets / f"{name}.npz")
        light = LightingOptions(sky=stage["sky"], keep_file_lights=True)
        studio = Studio.set_up(scene, stage["camera"], light, shown.shape[::-1], 0.0)
        settings = RenderSettings(
            size=shown.shape[::-1],
            gi=technique,
            technique=settings_of[technique](
                grid=ProbeGrid.around(primitives.bounds(), widening * stage["spacing"])
            ),
            shadows=ShadowSettings(map_size=512),
        )
        renderer = Renderer(gpu, scene, primitives, settings, studio.illumination)
        images = renderer.render(studio.view.camera, settle=FRAMES - 1, only=("irradiance", "normal")).images
        np.testing.assert_array_equal((images["normal"] != 0).any(axis=-1), shown)
        found = images["irradiance"][shown].astype(np.float64)
        return relative_error(twice(found), (halves[0], halves[1])).rel_mse

    return measure


@pytest.mark.parametrize("name", FAST)
def test_pictures_of_few_probes_are_like_the_truth(error_of, name):
    assert error_of(name, "sdfddgi", widening=2.0) <= FAST[name]


@pytest.mark.slow
@pytest.mark.parametrize("technique", LIMITS)
@pytest.mark.parametrize("name", LIMITS["sdfddgi"])
def test_pictures_are_like_the_truth(error_of, name, technique):
    assert error_of(name, technique) <= LIMITS[technique][name]
