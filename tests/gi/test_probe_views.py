"""What the probes tell of themselves: balls in the picture, and counts."""

import numpy as np
import pytest

from fit.primitives import PrimitiveSet, make_box
from runtime.camera import clip_from_local, look_at
from runtime.lights import Illumination, Sun
from runtime.probes import ProbeGrid
from runtime.renderer import Renderer
from runtime.sdfddgi import SHOWN_BY_PROBES, SdfddgiSettings
from runtime.settings import RenderSettings, ShadowSettings
from runtime.sky import Sky

SIZE = (96, 96)
CAMERA = look_at((0.3, 1.2, 4.0), (0.0, 0.8, 0.0), fov=45)
GRID = ProbeGrid((-1.0, -0.5, -1.0), 1.0, (3, 3, 3))
FLOOR = make_box((0, -0.1, 0), (3, 0.2, 3), albedo=(0.5, 0.5, 0.5))
SOLID = make_box((-1.0, 0.5, 1.0), (1.9, 1.9, 1.9), albedo=(0.5, 0.5, 0.5))


@pytest.fixture
def make_renderer(gpu, mesh_of_boxes):
    def make(drawn: PrimitiveSet, primitives: PrimitiveSet, **settings) -> Renderer:
        technique = SdfddgiSettings(grid=GRID, **settings)
        shadows = ShadowSettings(map_size=256)
        settings = RenderSettings(size=SIZE, technique=technique, shadows=shadows)
        light = Illumination((Sun((0.3, 1.0, 0.2), 3.0),), Sky.constant((1.0, 1.0, 1.0)))
        return Renderer(gpu, mesh_of_boxes(drawn), primitives, settings, light)

    return make


def test_balls_stand_where_probes_do_and_tell_their_state(make_renderer):
    both = PrimitiveSet.concatenate([FLOOR, SOLID])
    renderer = make_renderer(FLOOR, both, probes_per_frame=9)
    names = [f"sdfddgi/probe-{what}" for what in SHOWN_BY_PROBES]
    assert set(names) <= set(renderer.all_views())
    images = renderer.render(CAMERA, frames=5, only=(*names, "depth")).images
    places, is_on = renderer.technique.probes.read_records()
    assert 0 < np.count_nonzero(~is_on) < 14
    clip = np.c_[places, np.ones(len(places))] @ clip_from_local(CAMERA, SIZE, renderer.world.origin).T
    pixels = ((clip[:, :2] / clip[:, 3:] * [0.5, -0.5] + 0.5) * SIZE).astype(int)
    inside = np.all((pixels >= 0) & (pixels < SIZE), axis=1)
    color = images["sdfddgi/probe-states"][pixels[inside, 1], pixels[inside, 0]]
    hidden = images["depth"][pixels[inside, 1], pixels[inside, 0], 0]
    in_front = (hidden == 0) | (clip[inside, 3] < hidden)
    lit, off = color[in_front & is_on[inside]], color[in_front & ~is_on[inside]]
    assert np.mean(lit.argmax(axis=1) == 1) > 0.8  # a ball nearer to the camera may stand before another
    assert np.all(off.argmax(axis=1) == 0)
    ages = images["sdfddgi/probe-age"][pixels[inside, 1], pixels[inside, 0]][in_front & is_on[inside]]
    assert len(np.unique(ages.argmax(axis=1))) > 1
    glow = images["sdfddgi/probe-irradiance"][pixels[inside, 1], pixels[inside, 0]][in_front & is_on[inside]]
    assert 0.3 < np.median(glow) < 3.0


def test_counts_tell_what_the_reflective_shadow_maps_refuse(make_renderer):
    """Half a metre below its mesh the floor is none that the map sees, but the sun shines on it."""
    fits = make_renderer(FLOOR, FLOOR)
    lower = make_box((0, -0.6, 0), (3, 0.2, 3), albedo=(0.5, 0.5, 0.5))
    sunk = make_renderer(FLOOR, lower)
    found = []
    for renderer in (fits, sunk):
        for _ in range(2):
            renderer.draw_frame(only_light=True)
        found.append(renderer.technique.statistics())
    assert found[0].rsm_samples > 100
    assert found[0].rsm_refused < 0.05
    assert found[1].rsm_refused > 0.95
    assert found[1].rsm_missed > 0.9
    assert (found[0].probes, found[0].off, found[0].fresh, found[0].longest_wait) == (27, 0, 0, 0)
