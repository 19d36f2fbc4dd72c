"""Direct light: strengths against the formulas, shadows against the ray caster, reflective shadow maps at
hits."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

from fit.primitives import PrimitiveSet, make_box, make_half_space, make_plane
from runtime.camera import look_at
from runtime.direct import LightMaps
from runtime.encoder import Recorder
from runtime.kernel import Kernel
from runtime.lights import Light, Point, Spot, Sun, light_records
from runtime.meshes import SceneMeshes
from runtime.resources import Buffer
from runtime.settings import ShadowSettings
from runtime.twins.punctual import punctual_attenuation, punctual_direction
from runtime.world import World

ABOVE = look_at(np.array([0.0, 4.0, 0.0]), np.zeros(3), fov=60.0)
SIZE = (64, 64)


def floor(builder, size=4.0, y=0.0, albedo=0.5):
    builder.quad((-size / 2, y, size / 2), (size, 0, 0), (0, 0, -size), base_color=(albedo,) * 3 + (1,))


def irradiance(images):
    """Of pixels of albedo 0.5."""
    return images["direct"] * np.pi / 0.5


def test_sun_on_a_facing_plane_is_exactly_its_strength(builder, render_scene):
    floor(builder)
    images = render_scene(
        builder.scene(), ABOVE, size=SIZE, lights=[Sun((0, 2, 0), 7.0)], only=("direct",)
    ).images
    seen = images["direct"][..., 0] > 0
    assert seen.mean() > 0.7
    np.testing.assert_allclose(irradiance(images)[seen], 7.0, rtol=1e-3)


@pytest.mark.parametrize("degrees", [30.0, 60.0, 85.0, 89.0])
def test_slanting_sun_follows_the_cosine_without_acne(builder, render_scene, degrees):
    """No pixel of a flat floor shadows itself, however the light grazes it."""
    floor(builder)
    angle = np.radians(degrees)
    sun = Sun((np.sin(angle), np.cos(angle), 0.2 * np.sin(angle)), (4.0, 2.0, 1.0))
    images = render_scene(
        builder.scene(), ABOVE, size=SIZE, lights=[sun], only=("direct",), map_size=64
    ).images
    towards = np.array(sun.direction) / np.linalg.norm(sun.direction)
    seen = images["direct"][..., 0] > 0
    assert seen.mean() > 0.7
    np.testing.assert_allclose(
        irradiance(images)[seen], np.tile(towards[1] * np.array([4, 2, 1]), (seen.sum(), 1)), rtol=2e-3
    )


def test_point_and_spot_follow_their_twins(builder, render_scene):
    """Inverse square, the range's window, the cone's squared falloff, the cosine: at every pixel."""
    floor(builder)
    for light in (
        Point((0.5, 1.5, 0.2), (3.0, 2.0, 1.0), range=3.0),
        Spot((0.3, 1.5, 0.0), (0.1, -1, 0.05), 5.0, 0.2, 0.6),
        Spot((0.0, 2.0, 0.0), (0, -1, 0), 5.0, 0.0, 0.5, range=2.5),
    ):
        result = render_scene(
            builder.scene(), ABOVE, size=SIZE, lights=[light], only=("direct", "position", "normal")
        )
        positions = result.images["position"].reshape(-1, 3).astype(np.float64)
        record = light_records([light], [], np.zeros(3))[0:1]
        cosine = punctual_direction(record, positions)[:, 1:2]
        expected = np.array(light.color) * punctual_attenuation(record, positions)[:, None] * cosine
        seen = (result.images["normal"][..., 1] > 0).ravel()
        actual = irradiance(result.images).reshape(-1, 3)
        np.testing.assert_allclose(actual[seen], expected[seen], rtol=2e-3, atol=1e-4)
        assert expected[seen].max() > 0.5


def shadow_truth(scene, images, towards, ray_caster):
    """Whether each pixel's surface sees the light, by rays."""
    positions = images["position"].reshape(-1, 3).astype(np.float64)
    starts = positions + 1e-3 * images["face_normal"].reshape(-1, 3)
    directions = np.broadcast_to(towards(starts), starts.shape)
    t, _ = ray_caster(scene).cast(starts, directions)
    return ~np.isfinite(t)


@pytest.mark.parametrize("kind", ["sun", "spot"])
def test_mapped_shadows_lie_where_rays_are_blocked(builder, ray_caster, render_scene, kind):
    """All pixels away from shadow edges agree with the ray caster; the block stands on the floor without a
    gap."""
    floor(builder, 5.0)
    builder.box((0, 0.6, 0), (0.9, 1.2, 0.9), base_color=(0.5, 0.5, 0.5, 1))
    scene = builder.scene()
    camera = look_at(np.array([-1.0, 4.0, 2.0]), np.zeros(3), fov=55.0)
    if kind == "sun":
        light = Sun((1.0, 1.2, 0.4), 3.0)
        direction = np.array(light.direction) / np.linalg.norm(light.direction)

        def towards(p):
            return direction
    else:
        light = Spot((1.5, 3.0, 0.5), (-1.5, -3, -0.5), 30.0, 0.5, 0.9)

        def towards(p):
            way = np.array(light.position) - p
            return way / np.linalg.norm(way, axis=1, keepdims=True)

    only = ("direct", "position", "face_normal", "albedo")
    images = render_scene(scene, camera, size=(96, 96), lights=[light], only=only, map_size=1024).images
    lit = shadow_truth(scene, images, towards, ray_caster).reshape(96, 96)
    rays = np.broadcast_to(towards(images["position"].reshape(-1, 3)), (96 * 96, 3)).reshape(96, 96, 3)
    facing = (images["face_normal"] * rays).sum(-1)
    counts = (images["albedo"][..., 0] > 0) & (np.abs(facing) > 0.05)
    lit &= facing > 0
    away = counts & (minimum(lit) == maximum(lit))
    actual = images["direct"][..., 0] > 0.5 * images["direct"][..., 0][lit & away].min()
    assert (lit & away).sum() > 1000 and (~lit & away).sum() > 200
    assert np.count_nonzero(actual[away] != lit[away]) <= 2


def minimum(mask):
    return np.min(
        [np.roll(mask, (y, x), (0, 1)) for y in (-2, -1, 0, 1, 2) for x in (-2, -1, 0, 1, 2)], axis=0
    )


def maximum(mask):
    return ~minimum(~mask)


def test_points_are_shadowed_by_tracing_the_primitives(builder, render_scene):
    """The block is in the primitives alone: only a traced shadow can know of it."""
    floor(builder)
    block = make_box((0, 0.5, 0), (0.5, 0.2, 0.5))
    lights = [Point((0, 2.0, 0), 10.0)]
    lit = render_scene(builder.scene(), ABOVE, size=SIZE, lights=lights, only=("direct",)).images["direct"]
    shaded = render_scene(
        builder.scene(), ABOVE, size=SIZE, lights=lights, only=("direct",), primitives=block
    ).images["direct"]
    assert lit[32, 32, 0] > 0.1 and shaded[32, 32, 0] == 0
    # The block's shadow is 0.25 * 2 / 1.4 = 0.357 m wide on each side; a metre is 13.86 px.
    row = shaded[32, :, 0]
    assert np.all(row[28:36] == 0) and np.allclose(row[[25, 38]], lit[32, [25, 38], 0])


def test_a_mesh_inside_its_primitive_is_not_dark(builder, render_scene):
    """A fit swallows the surface by a centimetre: the shadow ray starts where it is free."""
    floor(builder)
    ground = make_plane((0, -0.05, 0), 4, 4, 0.12)
    image = render_scene(
        builder.scene(),
        ABOVE,
        size=SIZE,
        lights=[Point((0, 2.0, 0), 10.0)],
        only=("direct",),
        primitives=ground,
    ).images["direct"]
    assert irradiance({"direct": image})[32, 32, 0] == pytest.approx(2.5, rel=2e-2)


PROBE_KERNEL = """
import package::lib::light_list::{lights};
import package::lib::lights::{direct_radiance_at_hit, lights_rsm_radiance};

@group(0) @binding(0) var<storage, read> hits: array<array<vec4f, 3>>;
@group(0) @binding(1) var<storage, read_write> radiance: array<array<vec4f, 2>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&hits) {
        return;
    }
    let hit = hits[id.x];
    let total = direct_radiance_at_hit(hit[0].xyz, hit[1].xyz, hit[2].xyz, hit[0].w);
    radiance[id.x] = array<vec4f, 2>(
        vec4f(total, 1.0), lights_rsm_radiance(lights[0], hit[0].xyz, hit[1].xyz, hit[0].w),
    );
}
"""


@pytest.fixture
def hit_light(gpu, tmp_path, repository):
    """hit_light(scene, primitives, lights, hits): radiance and RSM answers (n, 4) at hits (position, half
    thickness, normal, albedo)."""
    root = tmp_path / "shaders"
    shutil.copytree(repository / "runtime" / "shaders", root)
    (root / "probe.wgsl").write_text(PROBE_KERNEL)
    kernel = Kernel(gpu, "probe", root=root)

    def measure(scene, primitives, lights, hits, tolerance=0.1, share=1.0):
        world = World(gpu, scene, primitives, origin=(0, 0, 0))
        meshes = SceneMeshes(gpu, scene, world.origin, 512)
        settings = ShadowSettings(map_size=512, rsm_tolerance=tolerance, rsm_tolerance_share=share)
        maps = LightMaps(gpu, world.origin, settings, meshes)
        maps.set(lights)
        rows = np.zeros((len(hits), 3, 4), np.float32)
        for row, (position, half_thickness, normal, albedo) in zip(rows, hits, strict=True):
            row[0], row[1, :3], row[2, :3] = (*position, half_thickness), normal, albedo
        result = Buffer(gpu, 32 * len(hits))
        rec = Recorder(gpu)
        world.record(rec)
        maps.record(rec)
        with rec.compute("probe") as compute_pass:
            kernel.dispatch(
                compute_pass, kernel.groups_for(len(hits)), world.bindings(), maps.bindings(),
                hits=Buffer(gpu, rows), radiance=result,
            )  # fmt: skip
        rec.submit()
        return np.moveaxis(result.read(np.float32, (len(hits), 2, 4)), 1, 0)

    return measure


def test_reflective_shadow_map_gives_the_meshs_own_colour(builder, hit_light):
    """The primitive is grey, the mesh red: an accepted sample is red, and linear in the light down to
    1e-6."""
    builder.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), base_color=(0.8, 0.1, 0.05, 1))
    scene = builder.scene()
    ground = make_plane((0, -0.05, 0), 4, 4, 0.1)
    hit = ((0.3, 0.02, 0.2), 0.05, (0, 1, 0), (0.5, 0.5, 0.5))
    sun = np.array([0.3, 1.0, 0.2])
    cosine = 1 / np.linalg.norm(sun)
    for strength in (10.0, 1e-5):
        total, seen = hit_light(scene, ground, [Sun(tuple(sun), strength)], [hit])
        expected = np.array([0.8, 0.1, 0.05]) * strength * cosine / np.pi
        np.testing.assert_allclose(total[0, :3], expected, rtol=2e-3)
        assert seen[0, 3] == 1


def test_reflective_shadow_map_rejects_what_it_does_not_see(builder, hit_light):
    """Wrong normal, too far, thinner than the gap: all fall back to a traced shadow with the primitive's
    colour."""
    builder.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), base_color=(0.8, 0.1, 0.05, 1))
    scene = builder.scene()
    grey = (0.5, 0.5, 0.5)
    tilted = np.array([0.9, 0.436, 0.0])
    hits = [
        ((0, 0.02, 0), 0.05, (0, 1, 0), grey),
        ((0, 0.02, 0), 0.01, (0, 1, 0), grey),
        ((0, 0.2, 0), 0.5, (0, 1, 0), grey),
        ((0, 0.02, 0), 0.05, tuple(tilted), grey),
    ]
    total, seen = hit_light(scene, PrimitiveSet.empty(), [Sun((0, 1, 0), 10.0)], hits)
    np.testing.assert_array_equal(seen[:, 3], [1, 0, 0, 0])
    np.testing.assert_allclose(total[1:3, 0], 0.5 * 10 / np.pi, rtol=1e-4)
    np.testing.assert_allclose(total[3, 0], 0.5 * 10 * tilted[1] / np.pi, rtol=1e-4)


def test_a_thin_roof_does_not_leak_through_the_reflective_shadow_map(builder, hit_light):
    """1 cm sheet, 512 texels over 4 m: neither its dark side nor the ground just below takes its sunlit
    side."""
    builder.box((0, 1.0, 0), (4, 0.01, 4), base_color=(0.5, 0.5, 0.5, 1))
    builder.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), base_color=(0.5, 0.5, 0.5, 1))
    scene = builder.scene()
    primitives = PrimitiveSet.concatenate(
        [make_plane((0, 1, 0), 4, 4, 0.01), make_plane((0, -0.1, 0), 4, 4, 0.2)]
    )
    points = np.random.default_rng(1).uniform(-1.8, 1.8, (64, 2))
    grey = (0.5, 0.5, 0.5)
    hits = [((x, 0.995, z), 0.005, (0, -1, 0), grey) for x, z in points]
    hits += [((x, 0.0, z), 0.1, (0, 1, 0), grey) for x, z in points]
    total, _ = hit_light(scene, primitives, [Sun((0.1, 1, 0.05), 10.0)], hits)
    np.testing.assert_array_equal(total[:, :3], 0)
    lit, _ = hit_light(
        scene, primitives, [Sun((0.1, 1, 0.05), 10.0)], [((0, 1.005, 0), 0.005, (0, 1, 0), grey)]
    )
    assert lit[0, 0] == pytest.approx(0.5 * 10 / np.linalg.norm([0.1, 1, 0.05]) / np.pi, rel=2e-3)


@pytest.mark.parametrize("scale", [1.0, 0.1])
def test_shade_under_a_table_is_dark_at_any_scale(builder, hit_light, scale):
    """The map sees the table's top alone: on thick ground no fixed length may reach down from it."""
    ground = builder.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8))
    top = builder.box((0, 0.7, 0), (4, 0.05, 4))
    shrink = np.diag([scale, scale, scale, 1.0])
    for row in (ground, top):
        builder.parts["instances"][row] = replace(builder.parts["instances"][row], world_from_local=shrink)
    table = make_box((0, 0.7 * scale, 0), np.array([4, 0.05, 4]) * scale)
    primitives = PrimitiveSet.concatenate([make_half_space(), table])
    places = np.random.default_rng(1).uniform(-1.8, 1.8, (16, 2)) * scale
    hits = [((x, 0.0, z), 3e38, (0, 1, 0), (0.5, 0.5, 0.5)) for x, z in places]
    defaults = ShadowSettings()
    total, _ = hit_light(
        builder.scene(), primitives, [Sun((0, 1, 0), 10.0)], hits,
        defaults.rsm_tolerance, defaults.rsm_tolerance_share,
    )  # fmt: skip
    np.testing.assert_array_equal(total[:, :3], 0)


def test_spot_map_at_hits_matches_the_formula(builder, hit_light):
    builder.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), base_color=(0.4, 0.4, 0.4, 1))
    spot = Spot((0.2, 2.0, 0.1), (0, -1, 0), (6.0, 3.0, 1.5), 0.3, 0.8)
    positions = np.random.default_rng(2).uniform(-1, 1, (32, 3)) * [1, 0, 1]
    hits = [(tuple(p), 0.05, (0, 1, 0), (0.9, 0.9, 0.9)) for p in positions]
    total, seen = hit_light(builder.scene(), make_plane((0, -0.05, 0), 4, 4, 0.1), [spot], hits)
    record = light_records([spot], [], np.zeros(3))[0:1]
    share = punctual_attenuation(record, positions) * punctual_direction(record, positions)[:, 1]
    expected = 0.4 / np.pi * share[:, None] * np.array(spot.color)
    assert seen[:, 3].mean() > 0.9
    accepted = seen[:, 3] == 1
    np.testing.assert_allclose(total[accepted, :3], expected[accepted], rtol=0.02, atol=2e-3)


def test_maps_are_drawn_again_only_when_something_moved(gpu, builder):
    floor(builder)
    scene = builder.scene()
    meshes = SceneMeshes(gpu, scene, np.zeros(3), 512)
    maps = LightMaps(gpu, np.zeros(3), ShadowSettings(map_size=64), meshes)

    def passes():
        rec = Recorder(gpu)
        maps.record(rec)
        rec.submit()
        return list(rec.timer.results())

    maps.set([Sun((0, 1, 0), 1.0)])
    assert passes() == ["direct/draw_light_view"]
    assert passes() == []
    maps.set([Sun((0, 1, 0), 5.0)])
    assert passes() == [], "a new strength needs no new map"
    maps.set([Sun((0.1, 1, 0), 5.0)])
    assert passes() == ["direct/draw_light_view"]
    meshes.move({0: np.diag([2.0, 1, 1, 1])})
    maps.invalidate()
    assert passes() == ["direct/draw_light_view"]
    assert maps.bindings()["lights"].size == Light.dtype.itemsize
