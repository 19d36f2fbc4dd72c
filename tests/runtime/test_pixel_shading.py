"""The stages of shared shading, one by one, on a small picture: which pixels are chosen against NumPy, light
against a whole lookup of each pixel, the way up against a loop over pixels and samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fit.primitives import PrimitiveSet, make_box
from runtime import pixel_shading
from runtime.camera import look_at
from runtime.ddgi import DdgiSettings
from runtime.encoder import Recorder
from runtime.lights import Illumination, Sun
from runtime.pixel_shading import NO_PIXEL, ROUND, SharedShading
from runtime.probes import ProbeGrid
from runtime.renderer import Renderer
from runtime.sdfddgi import SdfddgiSettings
from runtime.settings import RenderSettings, ShadingMode, ShadingSettings, ShadowSettings
from runtime.sky import Sky

SIZE = (38, 27)
"""Neither side is a multiple of four."""

SHARED = ShadingSettings(mode=ShadingMode.SHARED, is_counted=True)

ROOM = PrimitiveSet.concatenate(
    [
        make_box((0, -0.1, 0), (6, 0.2, 6), albedo=[0.8, 0.5, 0.3]),
        make_box((-2, 1, 0), (0.1, 2, 6), albedo=[0.2, 0.6, 0.9]),
        make_box((0.3, 0.5, -0.5), (0.8, 1, 0.8)),
        make_box((1.0, 0.6, 1.2), (0.1, 1.2, 0.1)),
    ]
)
FRONT = look_at(np.array([2.5, 2.2, 4.0]), np.array([0.0, 0.4, 0.0]), fov=50.0)
TURNS = (0, 3, 1, 2)


class Picture:
    """A renderer whose pixels can also be asked one by one."""

    def __init__(self, gpu, scene, shading, size=SIZE):
        settings = RenderSettings(
            size=size,
            technique=SdfddgiSettings(max_probes=64),
            shadows=ShadowSettings(map_size=256),
            shading=shading,
        )
        light = Illumination((Sun((0.5, 1.0, 0.3), 3.0),), Sky.constant((0.4, 0.5, 0.7)))
        self.renderer = Renderer(gpu, scene, ROOM, settings, light)
        self.full = pixel_shading.FullShading(gpu, size, self.renderer.technique)

    @property
    def shading(self) -> SharedShading:
        assert isinstance(self.renderer.shading, SharedShading)
        return self.renderer.shading

    def draw(self, frames=1, camera=FRONT, **options):
        self.renderer.set_camera(camera)
        for _ in range(frames):
            self.renderer.draw_frame(**options)
        return self

    def whole(self):
        """Irradiance (h, w, 3) of a lookup for each pixel, of the frame that was drawn last."""
        rec = Recorder(self.renderer.gpu)
        self.full.record(rec, self.renderer._shared())
        rec.submit()
        return self.full.irradiance.read()[..., :3]

    def light(self):
        return self.shading.irradiance.read()[..., :3]

    def surfaces(self):
        """Which pixels show one (h, w), positions and normals (h, w, 3), stored depths (h, w)."""
        depth = self.renderer.gbuffer.depth.read()
        position = self.renderer.read_view("position").astype(np.float64)
        return depth > 0, position, self.renderer.read_view("normal").astype(np.float64), depth

    @property
    def frame_index(self):
        return self.renderer._index - 1


@pytest.fixture(scope="module")
def scene(mesh_of_boxes):
    return mesh_of_boxes(ROOM)


@pytest.fixture(scope="module")
def picture(gpu, scene):
    return Picture(gpu, scene, SHARED).draw(8, only_light=True)


def agree(a, b, positions, normals, slack):
    """`surfaces_agree` of two pixels (row, column)."""
    s = SHARED
    way, total = positions[b] - positions[a], normals[a] + normals[b]
    rise = abs(way @ total) / np.linalg.norm(total)
    is_alike = normals[a] @ normals[b] >= s.normal_agreement
    return is_alike and rise <= s.slope * np.linalg.norm(way) + slack


def reduced(picture):
    """What `shading/reduce_pixels` has to choose, as (row, column) or None, (h / 2, w / 2)."""
    is_surface, positions, normals, depth = picture.surfaces()
    slack = picture.renderer.world.start_margin
    turn = picture.frame_index // 4
    rows, columns = -(-SIZE[1] // 2), -(-SIZE[0] // 2)
    chosen = np.full((rows, columns), None, object)
    for y in range(rows):
        for x in range(columns):
            quad = [(2 * y + i // 2, 2 * x + i % 2) for i in range(4)]
            there = [p for p in quad if p[0] < SIZE[1] and p[1] < SIZE[0] and is_surface[p]]
            if not there:
                continue
            nearest = (x + y + turn) % 2 == 0
            chosen[y, x] = (max if nearest else min)(there, key=lambda p: depth[p])
            if len(there) == 4 and all(agree(quad[0], p, positions, normals, slack) for p in quad[1:]):
                chosen[y, x] = quad[TURNS[turn % 4]]
    return chosen


def unpacked(packed):
    """Packed pixels as (row, column) or None."""
    result = np.full(packed.shape, None, object)
    for place in np.argwhere(packed != NO_PIXEL):
        word = int(packed[tuple(place)])
        result[tuple(place)] = (word >> 16, word & 0xFFFF)
    return result


@pytest.mark.parametrize("frames", [1, 4, 9])
def test_half_the_resolution_keeps_near_and_far(picture, frames):
    picture.draw(frames)
    found, expected = unpacked(picture.shading._half_pixels.read()), reduced(picture)
    differing = np.count_nonzero(found != expected)  # a plane's pixels differ by rounding alone
    assert differing <= 0.005 * expected.size, f"{differing} of {expected.size}"
    assert np.count_nonzero(expected == None) > 5  # noqa: E711


def test_a_quarter_of_the_resolution_covers_every_surface(picture):
    """Over four frames: the choice is that of the turns, but for surfaces that no block around shows."""
    given_up = 0
    for _ in range(4):
        picture.draw()
        _, positions, normals, _ = picture.surfaces()
        slack = picture.renderer.world.start_margin
        half = unpacked(picture.shading._half_pixels.read())
        found = unpacked(picture.shading._sample_pixels.read())
        turn = picture.frame_index
        for y, x in np.ndindex(found.shape):
            expected = first_choice(half, found.shape, turn, y, x)
            around = [(y, x), (y, x + 1), (y, x - 1), (y + 1, x), (y - 1, x)]
            around = [first_choice(half, found.shape, turn, *block) for block in around]
            for i in range(4) if (x + y + turn) % 2 else ():
                pixel = corner_of(half, y, x, i)
                if pixel and not any(a and agree(pixel, a, positions, normals, slack) for a in around):
                    given_up += pixel != expected
                    expected = pixel
                    break
            assert found[y, x] == expected
    assert given_up > 0


def corner_of(half, y, x, i):
    """Pixel of a corner of a block of half the resolution, or None."""
    place = (2 * y + i // 2, 2 * x + i % 2)
    return half[place] if place[0] < half.shape[0] and place[1] < half.shape[1] else None


def first_choice(half, blocks, turn, y, x):
    """The corner whose turn it is, or the next one that shows a surface."""
    if not (0 <= y < blocks[0] and 0 <= x < blocks[1]):
        return None
    turned = (corner_of(half, y, x, TURNS[(turn + i) % 4]) for i in range(4))
    return next((pixel for pixel in turned if pixel is not None), None)


def test_every_pixel_of_a_surface_has_its_turn(gpu, scene):
    picture = Picture(gpu, scene, SHARED)
    asked = np.zeros(SIZE[::-1], bool)
    for _ in range(ROUND):
        for pixel in unpacked(picture.draw().shading._sample_pixels.read()).ravel():
            if pixel:
                asked[pixel] = True
    is_surface = picture.surfaces()[0]
    assert not asked[~is_surface].any()
    assert np.count_nonzero(asked) > 0.85 * np.count_nonzero(is_surface)


def test_samples_that_share_nothing_are_whole_lookups(gpu, scene):
    """Where no sample is near enough to another one, each test is its own: 8 a sample, but for weights of
    0."""
    picture = Picture(gpu, scene, replace(SHARED, share_distance=0.0)).draw(8, only_light=True).draw()
    light, whole = picture.shading._sample_light.read(), picture.whole()
    samples = unpacked(picture.shading._sample_pixels.read())
    is_lit = light[..., 3] >= 0
    assert is_lit.sum() > 30
    assert all(pixel is not None for pixel in samples[is_lit])
    for place in np.argwhere(is_lit):
        np.testing.assert_allclose(
            light[tuple(place)][:3], whole[samples[tuple(place)]], rtol=1e-4, atol=1e-6
        )
    counts = picture.shading.counts(picture.renderer.gbuffer.depth)
    assert counts.samples == is_lit.sum()
    assert counts.visibility_tests == 8 * counts.samples


def test_neighbours_share_tests(gpu, scene):
    """A quarter of the tests and less, the same light within the width of an edge."""
    tests, errors = {}, {}
    for unit in (2, 4):
        picture = (
            Picture(gpu, scene, replace(SHARED, unit=unit, share_distance=1.0))
            .draw(8, only_light=True)
            .draw()
        )
        counts = picture.shading.counts(picture.renderer.gbuffer.depth)
        tests[unit] = counts.visibility_tests / counts.samples
        light, whole = picture.shading._sample_light.read(), picture.whole()
        samples = unpacked(picture.shading._sample_pixels.read())
        places = [tuple(place) for place in np.argwhere(light[..., 3] >= 0)]
        pairs = np.array([(light[place][:3], whole[samples[place]]) for place in places])
        errors[unit] = np.abs(pairs[:, 0] - pairs[:, 1]).mean() / pairs[:, 1].mean()
    assert tests[4] < tests[2] < 6
    assert errors[2] < 0.02 and errors[4] < 0.03


def test_the_way_up_against_a_loop_over_pixels(gpu, scene):
    """Without history every pixel is its own sample, or the mean of those that are proven to lie on its
    surface with nothing between; the others are listed."""
    picture = Picture(gpu, scene, SHARED).draw(8, only_light=True).draw()
    is_surface, positions, normals, _ = picture.surfaces()
    slack = picture.renderer.world.start_margin
    light, found = picture.shading._sample_light.read(), picture.light()
    samples = unpacked(picture.shading._sample_pixels.read())
    filled = picture.shading.read_view("sdfddgi/fill_pixels", picture.renderer.gbuffer.depth)[..., 0] > 0
    wrong = 0
    for y, x in np.argwhere(is_surface):
        total, weights, own = np.zeros(3), 0.0, None
        for j, i in np.ndindex(3, 3):
            block = (y // 4 + j - 1, x // 4 + i - 1)
            if min(block) < 0 or block[0] >= samples.shape[0] or block[1] >= samples.shape[1]:
                continue
            pixel, (*rgb, clear) = samples[block], light[block]
            if pixel is None or clear < 0:
                continue
            own = np.array(rgb) if pixel == (y, x) else own
            near = np.linalg.norm(positions[pixel] - positions[y, x]) < clear
            if pixel != (y, x) and not (near and agree((y, x), pixel, positions, normals, slack)):
                continue
            squared = (pixel[0] - y) ** 2 + (pixel[1] - x) ** 2
            likeness = max(normals[pixel] @ normals[y, x], 0) ** SHARED.normal_exponent
            weight = np.exp(-0.5 * squared / SHARED.filter_width**2) * likeness
            total, weights = total + weight * np.array(rgb), weights + weight
        if (weights == 0) != filled[y, x]:
            wrong += 1
        elif weights > 0:
            expected = total / weights if own is None else own
            wrong += not np.allclose(found[y, x], expected, rtol=1e-3, atol=1e-6)
    assert wrong <= 0.005 * is_surface.sum(), f"{wrong} of {is_surface.sum()}"
    whole = picture.whole()
    assert 0 < filled.sum() < is_surface.sum()
    assert np.abs(found - whole)[filled].mean() < 0.05 * whole[filled].mean()
    counts = picture.shading.counts(picture.renderer.gbuffer.depth)
    assert counts.filled == filled.sum() and 0 < counts.lookups < counts.filled
    assert np.count_nonzero(np.isclose(found, whole, rtol=1e-4).all(-1) & filled) >= counts.lookups
    assert not found[~is_surface].any()


def test_a_still_picture_comes_to_be_that_of_whole_lookups(gpu, scene):
    """No pixel is black that a whole lookup lights; the error falls as pixels have their turns."""
    picture = Picture(gpu, scene, SHARED).draw(64, only_light=True).draw()
    is_surface, whole = picture.surfaces()[0], picture.whole()
    first = np.abs(picture.light() - whole)[is_surface].mean()
    picture.draw(2 * ROUND)
    whole = picture.whole()
    last = np.abs(picture.light() - whole)[is_surface].mean()
    assert last < 0.01 * whole[is_surface].mean()
    assert last < 0.9 * first
    assert np.all(picture.light()[is_surface].sum(-1) > 0)
    counts = picture.shading.counts(picture.renderer.gbuffer.depth)
    assert counts.pixels == is_surface.sum()
    assert counts.rings == 0


def test_history_is_dropped_where_the_point_was_not_seen(gpu, scene):
    """After a turn the side that comes into the picture has no history, the rest has."""
    picture = Picture(gpu, scene, SHARED).draw(4, only_light=True).draw(20)
    weight = picture.shading.irradiance.read()[..., 3]
    is_surface = picture.surfaces()[0]
    assert np.median(weight[is_surface]) > 0.9
    turned = look_at(np.array([2.5, 2.2, 4.0]), np.array([-0.7, 0.4, 0.0]), fov=50.0)
    picture.draw(1, turned)
    weight, is_surface = picture.shading.irradiance.read()[..., 3], picture.surfaces()[0]
    mask = picture.shading.read_view("sdfddgi/fill_pixels", picture.renderer.gbuffer.depth)[..., 0] > 0
    fresh = weight <= 2 * SHARED.guess_weight
    motion = picture.renderer.read_view("motion")
    place = np.arange(SIZE[0]) + motion[..., 0] * SIZE[0]
    outside, inside = is_surface & (place < -1), is_surface & (place > 1)
    assert outside.sum() > 20
    own = np.zeros_like(fresh)
    for pixel in unpacked(picture.shading._sample_pixels.read()).ravel():
        if pixel:
            own[pixel] = True
    assert np.all(fresh[outside & ~own & ~mask])
    assert np.mean(fresh[inside & ~own & ~mask]) < 0.1


def test_history_is_clipped_to_the_samples_around(gpu, scene):
    """When the lights go out, no pixel keeps more than its neighbours' samples have."""
    picture = Picture(gpu, scene, SHARED).draw(16, only_light=True).draw(20)
    before = picture.light().max()
    picture.renderer.set_lights(())
    picture.renderer.set_sky(Sky())
    picture.draw(60, only_light=True).draw()
    whole = picture.whole()
    assert before > 0.5
    assert picture.light().max() <= 1.05 * whole.max() + 1e-6


def test_two_runs_give_the_same_picture(gpu, scene):
    first, second = (Picture(gpu, scene, SHARED).draw(4, only_light=True).draw(6).light() for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_any_technique_can_be_shared(gpu, scene):
    """DDGI shares no tests: its samples are whole lookups."""
    probes = DdgiSettings(grid=ProbeGrid.around(([-2, 0, -2], [2, 2, 2]), max_probes=27), rays_per_probe=64)
    settings = RenderSettings(
        size=SIZE, gi="ddgi", technique=probes, shadows=ShadowSettings(map_size=256), shading=SHARED
    )
    renderer = Renderer(gpu, scene, ROOM, settings, Illumination((), Sky.constant((1, 1, 1))))
    light = renderer.render(FRONT, settle=40, only=("irradiance", "shading/light_samples")).images
    full = pixel_shading.FullShading(gpu, SIZE, renderer.technique)
    rec = Recorder(gpu)
    full.record(rec, renderer._shared())
    rec.submit()
    whole = full.irradiance.read()[..., :3]
    assert light["shading/light_samples"].any()
    assert np.abs(light["irradiance"] - whole).mean() < 0.02 * whole.mean()


def test_settings_are_checked():
    with pytest.raises(ValueError, match=r"2 or 4 of them along its side, not 3"):
        ShadingSettings(unit=3)
    with pytest.raises(ValueError, match=r"not 4\.0, 0\.0 and 2\.0"):
        ShadingSettings(guess_weight=0.0)


def test_counting_has_to_be_asked_for(gpu, scene):
    picture = Picture(gpu, scene, replace(SHARED, is_counted=False)).draw()
    with pytest.raises(ValueError, match="is_counted"):
        picture.shading.counts(picture.renderer.gbuffer.depth)


def test_every_stage_has_a_view_by_its_name(picture):
    picture.draw()
    names = [name for name in picture.renderer.all_views() if name in picture.shading.views()]
    assert names == [
        "shading/reduce_pixels",
        "shading/choose_pixels",
        "sdfddgi/light_samples",
        "shading/upsample_pixels",
        "sdfddgi/fill_pixels",
    ]
    for name in names:
        pixels = picture.renderer.read_view(name)
        assert pixels.shape[-1] == 3 and pixels.any()
