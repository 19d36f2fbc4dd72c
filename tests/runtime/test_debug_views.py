"""A debug picture of what surfaces see of the probes around them."""

from __future__ import annotations

import numpy as np
import pytest

from fit.primitives import PrimitiveSet, make_box
from runtime.camera import look_at
from runtime.lights import Illumination
from runtime.probes import ProbeGrid
from runtime.renderer import Renderer
from runtime.sdfddgi import SdfddgiSettings
from runtime.settings import RenderSettings
from runtime.sky import Sky

SIZE = (96, 64)
CAMERA = look_at(np.array([0.0, 1.0, 6.0]), np.array([0.0, 1.0, 0.0]), fov=45.0)

GRID = ProbeGrid((-1.0, 0.0, 0.0), 1.0, (3, 3, 1))
"""In the plane that the camera looks at; the lowest row stands on the floor, one probe within the block."""


@pytest.fixture(scope="module")
def shown(gpu, mesh_of_boxes):
    """Views after 4 frames of a floor under the open sky, and a block that swallows one probe whole."""
    boxes = PrimitiveSet.concatenate(
        [make_box((0, -0.6, 0), (6, 1, 6)), make_box((-1.5, 1.5, 0.0), (2.0, 2.0, 2.0))]
    )
    settings = RenderSettings(size=SIZE, technique=SdfddgiSettings(grid=GRID))
    light = Illumination((), Sky.constant((1.0, 1.0, 1.0)))
    renderer = Renderer(gpu, mesh_of_boxes(boxes), boxes, settings, light)
    return renderer, renderer.render(CAMERA, frames=2, settle=2, only=("sdfddgi/visibility",)).images


def test_what_is_seen_of_the_probes_is_a_share(shown):
    """All of them on open ground, less behind the block, nothing of the sky."""
    renderer, images = shown
    seen, depth = images["sdfddgi/visibility"][..., 0], renderer.read_view("depth")[..., 0]
    surface = depth > 0
    assert seen.min() >= 0 and seen.max() == pytest.approx(1.0, abs=1e-3)
    assert 0.05 < seen[surface].mean() < 0.999
    assert not seen[~surface].any()
