"""Contact light: energy is kept, occlusion is that of rays, small things light and shade what is near."""

import numpy as np
import pytest

from fit.primitives import PrimitiveSet, make_box
from runtime.camera import look_at
from runtime.contact_settings import ContactForm, ContactSettings
from runtime.lights import Illumination, Sun
from runtime.path_tracer import PathTracer
from runtime.probes import ProbeGrid
from runtime.renderer import Renderer
from runtime.sdfddgi import SdfddgiSettings
from runtime.settings import RenderSettings, ShadowSettings
from runtime.sky import Sky
from runtime.twins import horizon

SIZE = (64, 48)
GRID = ProbeGrid((-3.0, -0.5, -3.0), 2.0, (4, 3, 4))
NOTHING_NEAR = make_box((0, -1000, 0), (1, 1, 1))
WHITE = Sky.constant((1, 1, 1))
FROM_ABOVE = look_at(np.array([2.2, 1.8, 2.6]), np.array([0.1, 0.2, 0.0]), 45)
INTO_THE_CORNER = look_at(np.array([1.6, 0.6, 1.2]), np.array([-0.5, 1.0, -1.0]), 50)
"""The corner runs through the picture's border."""

VIEWS = ("irradiance", "depth", "position", "normal", "contact/ao", "contact/ao-raw", "contact/near")
BOTH_SCALES = pytest.mark.parametrize("scale", [1, 2])


def corner(builder, color=(0.6, 0.6, 0.6), emission=(0.0, 0.0, 0.0)):
    """A floor and two walls of one colour, and a block and a post on the floor of another."""
    material = {"base_color": (*color, 1), "emission": emission}
    builder.box((0, -0.5, 0), (6, 1, 6), **material)
    builder.box((-1, 1, 0), (1, 6, 6), **material)
    builder.box((0, 1, -1.5), (6, 6, 1), **material)
    builder.box((0.5, 0.15, 0.2), (0.4, 0.3, 0.4), **material)
    builder.box((-0.1, 0.25, 0.6), (0.1, 0.5, 0.1), **material)
    return builder.scene()


SHELL = PrimitiveSet.concatenate(
    [
        make_box((0, -0.5, 0), (6, 1, 6), albedo=(0.6,) * 3),
        make_box((-1, 1, 0), (1, 6, 6), albedo=(0.6,) * 3),
        make_box((0, 1, -1.5), (6, 6, 1), albedo=(0.6,) * 3),
    ]
)
"""What a fit would keep of the corner: block and post are too small."""


def renderer(gpu, scene, contact, primitives=NOTHING_NEAR, light=None, gi="sdfddgi", size=SIZE):
    technique = SdfddgiSettings(grid=GRID) if gi == "sdfddgi" else None
    settings = RenderSettings(
        size, gi=gi, technique=technique, contact=contact, shadows=ShadowSettings(map_size=256)
    )
    return Renderer(gpu, scene, primitives, settings, light or Illumination(sky=WHITE))


def surface_of(images):
    return images["depth"][..., 0] > 0


def texels_of(image, scale):
    """What the texels of contact light stand for."""
    return image[::scale, ::scale]


# -------------------------------------------------------------------------------- the horizon integral


def test_shares_of_a_slice_are_those_of_a_sum():
    """By quadrature, with the normal tilted either way and beyond the tangents."""
    for tilt in (-1.4, -0.5, 0.0, 0.3, 1.2):
        x = np.linspace(tilt - np.pi / 2, tilt + np.pi / 2, 20001)
        light = np.cos(x - tilt) * np.abs(np.sin(x))
        summed = np.concatenate([[0], np.cumsum((light[1:] + light[:-1]) / 2 * np.diff(x))])
        assert summed[-1] == pytest.approx(horizon.horizon_slice(np.array([tilt]))[0], rel=1e-6)
        angles = np.array([tilt - 2.0, tilt - 1.0, 0.0, tilt + 0.7, tilt + 1.6])
        expected = np.interp(angles, x, summed / summed[-1])
        np.testing.assert_allclose(horizon.horizon_share(angles, np.full(5, tilt)), expected, atol=1e-6)


def test_slices_weigh_one_on_average():
    """About the way to the viewer, whatever the angle at which the surface is seen."""
    turns = np.pi * (np.arange(4000) + 0.5) / 4000
    across = np.stack([np.cos(turns), np.sin(turns), np.zeros(4000)], axis=1)
    for angle in (0.0, 0.7, 1.4):
        normal = np.array([np.sin(angle), 0.0, np.cos(angle)])
        along = np.stack([across @ normal, np.full(4000, normal[2])], axis=1)
        tilt = np.arctan2(along[:, 0], along[:, 1])
        weights = np.linalg.norm(along, axis=1) * horizon.horizon_slice(tilt)
        assert weights.mean() == pytest.approx(1, abs=1e-4)


def test_sectors_are_as_many_as_the_share_on_average():
    jitter = (np.arange(64) + 0.5) / 64
    first, last = np.full(64, 0.2417), np.full(64, 0.7061)
    sectors = horizon.horizon_sectors(first, last, jitter)
    assert np.bitwise_count(sectors).mean() == pytest.approx(32 * (0.7061 - 0.2417), abs=1 / 64)
    assert set(np.bitwise_count(horizon.horizon_sectors(0 * first, 0 * last + 1, jitter))) == {32}


# -------------------------------------------------------------------------------- energy


@BOTH_SCALES
def test_furnace(gpu, builder, scale):
    """Whatever sends as much light as the sky does cannot be told from it, however much of the sky it
    covers, also at the picture's border."""
    scene = corner(builder, (0.3, 0.3, 0.3), (0.7, 0.7, 0.7))
    drawn = renderer(gpu, scene, ContactSettings(radius=1.0, longest=1.0, scale=scale))
    for camera in (FROM_ABOVE, INTO_THE_CORNER):
        images = drawn.render(camera, frames=10, only=VIEWS).images
        assert np.percentile(images["contact/ao"], 2) < 0.7
        irradiance = images["irradiance"][surface_of(images)]
        np.testing.assert_allclose(irradiance, np.pi, rtol=0.005)


def test_as_printed_a_furnace_is_not_one(gpu, builder):
    """Which is why the printed form is not the default."""
    contact = ContactSettings(ContactForm.PRINTED, radius=1.0, longest=1.0, scale=1)
    scene = corner(builder, (1.0, 1.0, 1.0))
    images = renderer(gpu, scene, contact).render(FROM_ABOVE, frames=6, only=VIEWS).images
    shares = images["irradiance"][surface_of(images)] / np.pi
    assert np.percentile(shares, 5) < 0.97
    assert np.isfinite(shares).all()


@pytest.mark.parametrize(("albedo", "settle"), [(0.5, 32), pytest.param(0.9, 240, marks=pytest.mark.slow)])
def test_closed_box_keeps_its_light(gpu, builder, albedo, settle):
    walls = []
    for axis in range(3):
        for side in (-1, 1):
            center, size = [0.0, 0.5, 0.0], [3.4, 3.4, 3.4]
            center[axis] += 1.6 * side
            size[axis] = 0.2
            builder.box(center, size, base_color=(albedo,) * 3 + (1,), emission=(1.0, 1.0, 1.0))
            walls.append(make_box(tuple(center), tuple(size), albedo=(albedo,) * 3, emission=(1,) * 3))
    scene, primitives = builder.scene(), PrimitiveSet.concatenate(walls)
    camera = look_at(np.array([1.2, 1.6, 1.2]), np.array([-1.0, -0.4, -0.8]), 70)
    light = Illumination()
    with_contact, without = (
        renderer(gpu, scene, contact, primitives, light)
        .render(camera, frames=12, settle=settle, only=("irradiance",))
        .images["irradiance"]
        .mean()
        for contact in (ContactSettings(radius=1.0, longest=1.0), None)
    )
    assert with_contact == pytest.approx(without, rel=0.02)
    assert with_contact == pytest.approx(np.pi / (1 - albedo), rel=0.05)


# -------------------------------------------------------------------------------- each stage


@BOTH_SCALES
def test_occlusion_is_that_of_rays(gpu, builder, scale):
    contact = ContactSettings(radius=0.5, longest=1.0, scale=scale)
    scene = corner(builder)
    size = (SIZE[0] * scale, SIZE[1] * scale)
    drawn = renderer(gpu, scene, contact, gi="none", size=size)
    images = drawn.render(FROM_ABOVE, frames=24, only=VIEWS).images
    surface = texels_of(surface_of(images), scale)
    position, normal = (texels_of(images[name], scale)[surface] for name in ("position", "normal"))
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    truth = PathTracer(gpu, scene, Illumination()).openness(position, normal, 0.5, contact.falloff)
    seen = images["contact/ao"][..., 0][surface]
    assert np.sqrt(np.mean((seen - truth) ** 2)) < 0.05 < 0.5 * truth.std()
    assert seen.mean() == pytest.approx(truth.mean(), abs=0.02)


def test_occlusion_by_rays_is_that_of_a_corner(gpu, builder):
    """Next to a wall without end half of the light is covered; a wall farther than the radius covers none."""
    builder.box((0, -0.5, 0), (200, 1, 200))
    builder.box((-50.5, 50, 0), (100, 100, 200))
    points = np.array([(-0.499, 0, 0), (1.0, 0, 0), (20.0, 0, 0)])
    normals = np.tile((0.0, 1.0, 0.0), (3, 1))
    tracer = PathTracer(gpu, builder.scene(), Illumination())
    openness = tracer.openness(points, normals, 10.0, 1e-3, samples=4096)
    # A strip of height h in distance d covers (1 - cos(atan(h / d))) / 2, here cut off by the radius' circle.
    assert openness[0] == pytest.approx(0.5, abs=0.02)
    assert 0.5 < openness[1] < 0.75
    assert openness[2] == 1.0


def test_sources_send_what_the_picture_shows(gpu, builder):
    """Once all rests, the radiance of every texel is that of its pixel."""
    light = Illumination((Sun((0.6, 1.0, 0.5), 4.0),), WHITE)
    scene = corner(builder, emission=(0.0, 0.1, 0.0))
    contact = ContactSettings(radius=0.5, scale=1)
    images = renderer(gpu, scene, contact, SHELL, light).render(
        FROM_ABOVE, frames=16, settle=4, only=("final", "depth", "contact/sources")
    ).images  # fmt: skip
    surface = surface_of(images)
    difference = np.abs(images["contact/sources"][surface] - images["final"][surface])
    assert difference.mean() < 0.01 * images["final"][surface].mean()


def test_both_parts_make_the_irradiance(gpu, builder):
    """At full resolution: openness times that of the probes, plus what is near."""
    scene, contact = corner(builder), ContactSettings(radius=0.5, scale=1)
    with_contact = renderer(gpu, scene, contact, SHELL).render(FROM_ABOVE, frames=4, settle=4, only=VIEWS)
    without = renderer(gpu, scene, None, SHELL).render(FROM_ABOVE, frames=4, settle=4, only=("irradiance",))
    images = with_contact.images
    expected = np.clip(images["contact/ao"], 0, 1) * without.images["irradiance"] + images["contact/near"]
    surface = surface_of(images)
    np.testing.assert_allclose(images["irradiance"][surface], expected[surface], rtol=1e-3, atol=1e-4)


def test_denoising_leaves_little_noise(gpu, builder):
    """Of a first frame's noise at most a tenth is left, and edges of the floor's block stay."""
    scene, contact = corner(builder), ContactSettings(radius=0.5, scale=1)
    drawn = renderer(gpu, scene, contact, gi="none")
    raw, denoised = [], []
    drawn.render(FROM_ABOVE, frames=16)
    for _ in range(12):
        images = drawn.render(frames=1, only=VIEWS).images
        raw.append(images["contact/ao-raw"][..., 0])
        denoised.append(images["contact/ao"][..., 0])
    noise, left = np.std(raw, axis=0), np.std(denoised, axis=0)
    covered = np.mean(raw, axis=0) < 0.95
    assert noise[covered].mean() > 0.05
    assert left[covered].mean() < 0.1 * noise[covered].mean()


# -------------------------------------------------------------------------------- against the truth


def test_what_the_set_leaves_out_is_lit_and_shades(gpu, builder):
    """Near the walls' corner and the objects that have no primitive, the error is smaller than without
    contact light, and than with plain ambient occlusion, which overshadows them (SDFDDGI, Fig. 9)."""
    light = Illumination((Sun((0.6, 1.0, 0.5), 6.0),), Sky.constant((0.5, 0.6, 0.8)))
    scene = corner(builder)
    contact = ContactSettings(radius=0.5, longest=1.0, scale=2)
    images = renderer(gpu, scene, contact, SHELL, light).render(
        FROM_ABOVE, frames=16, settle=24, only=VIEWS
    ).images  # fmt: skip
    without = renderer(gpu, scene, None, SHELL, light).render(
        FROM_ABOVE, frames=1, settle=39, only=("irradiance",)
    ).images["irradiance"]  # fmt: skip
    openness = np.kron(np.clip(images["contact/ao"], 0, 1), np.ones((2, 2, 1)))
    near = surface_of(images) & (openness[..., 0] < 0.9)
    normal = images["normal"][near] / np.linalg.norm(images["normal"][near], axis=1, keepdims=True)
    truth = PathTracer(gpu, scene, light).irradiance(images["position"][near], normal, samples=64)

    def error(irradiance):
        a, b, seen = truth.first, truth.second, irradiance[near]
        return np.mean((seen - a) * (seen - b) / (a * b + (0.01 * truth.value.mean()) ** 2))

    assert near.mean() > 0.05
    assert error(images["irradiance"]) < 0.75 * error(without)
    assert error(images["irradiance"]) < 0.5 * error(without * openness)


# -------------------------------------------------------------------------------- over time


@pytest.mark.slow
def test_still(gpu, builder):
    """At rest, the 95th percentile of the irradiance's standard deviation is at most half a per cent."""
    light = Illumination((Sun((0.6, 1.0, 0.5), 6.0),), WHITE)
    drawn = renderer(gpu, corner(builder, (1.0, 0.5, 0.2)), ContactSettings(radius=0.5), light=light)
    drawn.render(FROM_ABOVE, frames=40)
    frames = np.array(
        [drawn.render(frames=1, only=("irradiance",)).images["irradiance"].mean(axis=-1) for _ in range(24)]
    )
    assert np.percentile(drawn.read_view("contact/ao"), 5) < 0.8
    wobble = frames.std(axis=0) / np.maximum(frames.mean(axis=0), 0.01 * frames.mean())
    assert np.percentile(wobble, 95) <= 0.005


@pytest.mark.slow
def test_nothing_trails_behind_what_moves(gpu, builder):
    """40 frames after an object and the camera moved, the picture is that of a scene that always was so."""
    scene, contact = corner(builder), ContactSettings(radius=0.5, scale=1)
    block, target = 3, np.array([0.1, 0.2, 0.0])

    def draw(shares):
        drawn = renderer(gpu, scene, contact)
        for share in shares:
            place = np.eye(4)
            place[0, 3] = 0.5 * share
            drawn.move_instances({block: place})
            drawn.set_camera(look_at(np.array([2.2 + 0.2 * share, 1.8, 2.6 - 0.2 * share]), target, 45))
            drawn.draw_frame()
        for _ in range(40):
            drawn.draw_frame()
        frames = [drawn.render(frames=1, only=("irradiance", "depth")).images for _ in range(12)]
        return np.mean([frame["irradiance"] for frame in frames], axis=0), surface_of(frames[-1])

    after, surface = draw([0.0] * 12 + list(np.linspace(0, 1, 8)))
    rest, _ = draw([1.0])
    trail = np.abs(after - rest)[surface].mean(axis=-1)
    assert np.percentile(trail, 99) <= 0.02 * rest[surface].mean()


def test_same_seed_same_light(gpu, builder):
    """To the bit; another seed differs."""
    scene = corner(builder)

    def light(seed):
        contact = ContactSettings(radius=0.5, seed=seed)
        images = renderer(gpu, scene, contact, gi="none").render(FROM_ABOVE, frames=3, only=VIEWS).images
        return images["contact/ao"]

    first = light(0)
    np.testing.assert_array_equal(first, light(0))
    assert np.any(first != light(1))


@pytest.mark.parametrize(
    ("size", "eye", "scale"),
    [((1, 1), (0, 2, 3), 2), ((17, 5), (0, 1e-3, 3), 2), ((31, 33), (0, 0.3, 0.06), 1)],
)
def test_no_nan_in_odd_pictures(gpu, builder, size, eye, scale):
    """One pixel, odd sizes, a camera that touches a wall, needles, and lamps brighter than half floats."""
    builder.box((0, -0.5, 0), (60, 1, 60), emission=(1e6, 0.0, 1e-9))
    for k in range(6):
        builder.box((0.3 * k, 0.2, -0.2 * k), (10.0 ** (-k), 0.4, 0.1), base_color=(1, 1, 1, 1))
    scene, contact = builder.scene(), ContactSettings(radius=50.0, scale=scale)
    camera = look_at(np.array(eye, float), np.array([0.0, 0.1, -1.0]), 120, near=1e-4)
    images = renderer(gpu, scene, contact, gi="none", size=size).render(camera, frames=3, only=VIEWS).images
    assert all(np.isfinite(image).all() for image in images.values())
    assert images["irradiance"].min() >= 0


def test_pictures_with_many_rows_take_half_of_them():
    assert ContactSettings().scale_of((1920, 1080)) == 2
    assert ContactSettings().scale_of((640, 90)) == 1
    assert ContactSettings(scale=1).scale_of((1920, 1080)) == 1


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"scale": 3}, "scale of 1 or 2"),
        ({"radius": 0.0}, "radius above 0"),
        ({"steps": 0}, "1 to 64 steps"),
        ({"thickness": float("nan")}, "thickness above 0"),
        ({"history_frames": 0.5}, "history_frames"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        ContactSettings(**settings)
