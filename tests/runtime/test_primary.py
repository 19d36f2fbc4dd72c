"""The G-buffer against a brute-force ray caster, and what the textured triangles of glTF ask of a
rasteriser."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fit.scene import AlphaMode, Camera, TextureUse, Wrap
from runtime.camera import look_at
from runtime.lights import Sun
from runtime.meshes import SceneMeshes
from runtime.renderer import Renderer
from runtime.settings import RenderSettings
from runtime.textures import mipmaps

SIZE = (64, 48)
GEOMETRY = ("depth", "position", "normal", "face_normal", "albedo")
FRONT = look_at(np.array([0.0, 0.0, 3.0]), np.zeros(3), fov=45.0)


def assert_matches(images, expected, edge_share=0.02):
    """Depth, position and face normal agree except at the few pixels whose centres lie on an edge."""
    depth, position, normal = expected
    fits = np.isclose(images["depth"][..., 0], depth, rtol=1e-4, atol=1e-4)
    fits &= np.abs(images["position"] - position).max(-1) < 1e-3
    fits &= np.abs(images["face_normal"] - normal).max(-1) < 2e-3
    assert np.count_nonzero(~fits) <= edge_share * fits.size, f"{np.count_nonzero(~fits)} pixels differ"
    assert np.count_nonzero(depth) > 0.05 * depth.size


@pytest.mark.parametrize("kind", ["perspective", "far plane", "orthographic"])
def test_matches_a_ray_caster(builder, ray_caster, render_scene, kind):
    builder.box((0.2, 0.1, 0), (1, 1.4, 0.8), base_color=(0.8, 0.2, 0.1, 1))
    builder.quad((-3, -0.7, -3), (6, 0, 0), (0, 0, 6))
    scene = builder.scene()
    camera = look_at(np.array([1.5, 1.2, 2.5]), np.array([0.0, 0.0, 0.0]), fov=50.0)
    if kind == "far plane":
        camera = replace(camera, znear=0.5, zfar=20.0)
    if kind == "orthographic":
        camera = replace(camera, yfov=None, ymag=1.5, znear=0.0, zfar=20.0)
    images = render_scene(scene, camera, size=SIZE, only=GEOMETRY).images
    assert_matches(images, ray_caster(scene).picture(camera, SIZE))
    np.testing.assert_allclose(images["normal"], images["face_normal"], atol=2e-3)


def test_field_of_view_is_vertical_and_pixel_centres_are_exact(builder, render_scene):
    """A square of the exact height of the view, drawn wider than tall: its edges fall on known pixel
    borders."""
    builder.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    camera = look_at(np.array([0.0, 0.0, 2.0]), np.zeros(3), fov=2 * np.degrees(np.arctan(1.0)))
    depth = render_scene(builder.scene(), camera, size=(80, 40), only=("depth",)).images["depth"][..., 0]
    covered = np.zeros((40, 80), bool)
    covered[10:30, 30:50] = True
    np.testing.assert_array_equal(depth > 0, covered)
    np.testing.assert_allclose(depth[covered], 2.0, rtol=1e-6)


def test_texture_v_runs_downward(builder, render_scene):
    top_left, top_right, bottom_left, bottom_right = [255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]
    use = builder.image([[top_left, top_right], [bottom_left, bottom_right]], linear=False)
    builder.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), base_color_texture=use)
    albedo = render_scene(builder.scene(), FRONT, size=SIZE, only=("albedo",)).images["albedo"]
    quadrants = [albedo[16, 24], albedo[16, 40], albedo[32, 24], albedo[32, 40]]
    np.testing.assert_allclose(quadrants, [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], atol=1e-3)


def test_texture_transform_and_wrap_modes(builder, render_scene):
    """A strip of four columns, scaled by two and shifted by a column, then repeated, mirrored or clamped."""
    columns = [[[0, 0, 0], [85, 85, 85], [170, 170, 170], [255, 255, 255]]]
    linear = [((c / 255 + 0.055) / 1.055) ** 2.4 if c > 10 else 0.0 for c in (0, 85, 170, 255)]
    transform = np.array([[2.0, 0, 0.25], [0, 1, 0], [0, 0, 1]])
    order = {
        Wrap.REPEAT: [1, 2, 3, 0, 1, 2, 3, 0],
        Wrap.MIRROR: [1, 2, 3, 3, 2, 1, 0, 0],
        Wrap.CLAMP: [1, 2, 3, 3, 3, 3, 3, 3],
    }
    for row, wrap in enumerate(order):
        use = builder.image(columns, linear=False, wrap_u=wrap)
        use = TextureUse(use.texture, 0, transform)
        builder.quad((-0.8, 0.3 - 0.4 * row, 0), (1.6, 0, 0), (0, 0.3, 0), base_color_texture=use)
    albedo = render_scene(builder.scene(), FRONT, size=(128, 96), only=("albedo",)).images["albedo"]
    for row, indices in enumerate(order.values()):
        y = round(48 - (0.45 - 0.4 * row) * 48 / (3 * np.tan(np.radians(22.5))))
        places = [64 + round((-0.7 + 0.2 * k) * 48 / (3 * np.tan(np.radians(22.5)))) for k in range(8)]
        np.testing.assert_allclose(albedo[y, places, 0], [linear[i] for i in indices], atol=2e-3)


def test_vertex_colours_factors_and_textures_multiply(builder, render_scene):
    use = builder.image(np.full((2, 2, 3), 188))
    linear = ((188 / 255 + 0.055) / 1.055) ** 2.4
    colors = np.tile([0.5, 1.0, 0.25, 1.0], (4, 1))
    builder.quad(
        (-1, -1, 0), (2, 0, 0), (0, 2, 0), base_color=(0.9, 0.5, 1, 1), base_color_texture=use, colors=colors,
        emission=(3.0, 2.0, 1.0), roughness=0.25, metallic=0.75,
    )  # fmt: skip
    images = render_scene(builder.scene(), FRONT, only=("albedo", "emission", "roughness")).images
    # Hardware decodes sRGB to about 0.1 %, and half floats add as much.
    np.testing.assert_allclose(images["albedo"][24, 32], np.array([0.45, 0.5, 0.25]) * linear, rtol=3e-3)
    np.testing.assert_allclose(images["emission"][24, 32], [3, 2, 1], rtol=1e-3)
    np.testing.assert_allclose(images["roughness"][24, 32, :2], [0.25, 0.75], rtol=1e-3)


@pytest.mark.parametrize(
    ("mode", "alpha", "cutoff", "is_drawn"),
    [
        (AlphaMode.OPAQUE, 0.0, 0.5, True),
        (AlphaMode.MASK, 0.4, 0.5, False),
        (AlphaMode.MASK, 0.4, 0.3, True),
        (AlphaMode.BLEND, 0.45, 0.1, False),
        (AlphaMode.BLEND, 0.55, 0.9, True),
    ],
)
def test_alpha_modes(builder, render_scene, mode, alpha, cutoff, is_drawn):
    builder.quad(
        (-1, -1, 0), (2, 0, 0), (0, 2, 0), base_color=(1, 1, 1, alpha), alpha_mode=mode, alpha_cutoff=cutoff
    )
    depth = render_scene(builder.scene(), FRONT, only=("depth",)).images["depth"]
    assert (depth[24, 32, 0] > 0) == is_drawn


def test_alpha_mask_cuts_the_filtered_value_and_the_shadow(builder, render_scene):
    """Left half opaque, right half cut, in the picture and in the sun's shadow on the floor behind."""
    pixels = np.full((2, 2, 4), 255, np.uint8)
    pixels[:, 1, 3] = 0
    use = builder.image(pixels, wrap_u=Wrap.CLAMP, wrap_v=Wrap.CLAMP)
    builder.quad((-0.5, -0.5, 0.5), (1, 0, 0), (0, 1, 0), base_color_texture=use, alpha_mode=AlphaMode.MASK)
    builder.quad((-2, -2, 0), (4, 0, 0), (0, 4, 0), base_color=(0.5, 0.5, 0.5, 1))
    camera = look_at(np.array([0.0, 0.0, 3.0]), np.zeros(3), fov=60.0)
    images = render_scene(
        builder.scene(), camera, size=(96, 96), lights=[Sun((0.5, 0, 1.0), 2.0)], only=("depth", "direct")
    ).images
    assert images["depth"][48, 40, 0] == pytest.approx(2.5, abs=1e-3)
    assert images["depth"][48, 56, 0] == pytest.approx(3.0, abs=1e-3)
    # The quad's left half, x in [-0.5, 0], is shifted by 0.25 towards -x on the floor: x in [-0.75, -0.25].
    shadowed, lit = (
        48 + round(-0.65 * 48 / (3 * np.tan(np.radians(30)))),
        48 + round(0.3 * 48 / (3 * np.tan(np.radians(30)))),
    )
    assert images["direct"][48, shadowed, 0] == 0
    assert images["direct"][48, lit, 0] == pytest.approx(2 * 0.5 / np.pi / np.sqrt(1.25), rel=2e-3)


def test_every_face_has_two_sides(builder, render_scene):
    builder.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    scene = builder.scene()
    for z in (3.0, -3.0):
        camera = look_at(np.array([0.0, 0.0, z]), np.zeros(3))
        normal = render_scene(scene, camera, only=("normal",)).images["normal"]
        np.testing.assert_allclose(normal[24, 32], [0, 0, np.sign(z)], atol=1e-4)


def test_mirrored_and_stretched_instances(builder, ray_caster, render_scene):
    mirror = np.diag([-1.5, 0.5, 2.0, 1.0])
    turn = np.array([[0.8, 0, 0.6, 0.2], [0, 1, 0, 0.1], [-0.6, 0, 0.8, 0], [0, 0, 0, 1]])
    builder.box((0, 0, 0), (0.8, 0.8, 0.3), world_from_local=turn @ mirror)
    builder.place(0, np.array([[0.5, 0.2, 0, -1.2], [0, 0.5, 0, 0.4], [0, 0, 0.5, 0], [0, 0, 0, 1]]))
    scene = builder.scene()
    images = render_scene(scene, FRONT, size=SIZE, only=GEOMETRY).images
    assert_matches(images, ray_caster(scene).picture(FRONT, SIZE))
    np.testing.assert_allclose(images["normal"], images["face_normal"], atol=3e-3)


def test_normals_are_interpolated(builder, render_scene):
    """A bent normal at each corner: the middle sees their mean, the face keeps its own."""
    tilt = 0.6
    normals = np.array([[-tilt, 0, 0.8], [tilt, 0, 0.8], [tilt, 0, 0.8], [-tilt, 0, 0.8]])
    builder.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), normals=normals)
    images = render_scene(builder.scene(), FRONT, size=(64, 48), only=("normal", "face_normal")).images
    x = 3 * np.tan(np.radians(22.5)) * (40.5 - 32) / 24
    expected = np.array([tilt * x, 0, 0.8]) / np.hypot(tilt * x, 0.8)
    np.testing.assert_allclose(images["normal"][24, 40], expected, atol=1e-3)
    np.testing.assert_allclose(images["face_normal"][24, 40], [0, 0, 1], atol=1e-3)


def test_far_from_the_origin_nothing_is_lost(builder, ray_caster, render_scene):
    offset = np.array([1e6, -2e6, 5e5])
    builder.box(offset + np.array([0.2, 0.1, 0]), (1, 1.4, 0.8))
    camera = look_at(offset + np.array([1.5, 1.2, 2.5]), offset, fov=50.0)
    scene = builder.scene()
    images = render_scene(scene, camera, size=SIZE, only=GEOMETRY).images
    depth, _, normal = ray_caster(scene).picture(camera, SIZE)
    fits = np.isclose(images["depth"][..., 0], depth, rtol=1e-4)
    assert np.count_nonzero(~fits) <= 0.02 * fits.size
    assert np.median(np.abs(images["face_normal"] - normal)[fits]) < 1e-3


def test_motion_of_camera_and_instance(gpu, builder):
    """Previous minus current place in shares of the picture, v downward."""
    builder.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    renderer = Renderer(gpu, builder.scene(), _no_primitives(), RenderSettings(size=(64, 64), gi="none"))
    still = look_at(np.array([0.0, 0.0, 2.0]), np.zeros(3), fov=90.0)
    renderer.render(still)
    shifted = Camera("moved", still.world_from_local + _at(0.1, 0.2), yfov=still.yfov, znear=still.znear)
    moved = renderer.render(shifted, only=("motion",)).images["motion"]
    # 4 m are in view at 2 m; half floats come in steps of 6e-5 there. What the camera has moved by, the
    # picture was off by, to the other side.
    np.testing.assert_allclose(moved[32, 32, :2], [0.1 / 4, -0.2 / 4], atol=6e-5)
    renderer.move_instances({0: np.eye(4) + _at(0.4, 0.0)})
    moved = renderer.render(only=("motion",)).images["motion"]
    np.testing.assert_allclose(moved[32, 32, :2], [-0.4 / 4, 0], atol=6e-5)
    still_again = renderer.render(only=("motion",)).images["motion"]
    np.testing.assert_allclose(still_again[32, 32, :2], 0, atol=6e-5)


def test_the_last_picture_is_kept_and_found_by_depth(gpu, builder):
    """A point's depth a frame ago comes with its motion, whoever has moved; the last picture is there yet."""
    builder.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    renderer = Renderer(gpu, builder.scene(), _no_primitives(), RenderSettings(size=(32, 32), gi="none"))
    camera = look_at(np.array([0.0, 0.0, 2.0]), np.zeros(3), fov=90.0)
    renderer.render(camera)
    assert not renderer.gbuffer.bindings()["previous_depth"].read().any()
    first = renderer.gbuffer.depth.read()
    assert first[16, 16] == pytest.approx(camera.znear / 2, rel=1e-5)
    nearer = look_at(np.array([0.0, 0.0, 1.0]), np.zeros(3), fov=90.0)
    motion = renderer.render(nearer, only=("motion",)).images["motion"]
    assert motion[16, 16, 2] == pytest.approx(camera.znear / 2, rel=1e-5)
    np.testing.assert_array_equal(renderer.gbuffer.bindings()["previous_depth"].read(), first)
    away = np.eye(4)
    away[2, 3] = -3.0
    renderer.move_instances({0: away})
    motion = renderer.render(only=("motion",)).images["motion"]
    assert motion[16, 16, 2] == pytest.approx(camera.znear / 1, rel=1e-5)
    assert renderer.gbuffer.depth.read()[16, 16] == pytest.approx(camera.znear / 4, rel=1e-5)


def test_transmissive_surfaces_are_left_out_and_told(builder, render_scene):
    builder.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), transmission=1.0)
    builder.quad((-1, -1, -1), (2, 0, 0), (0, 2, 0))
    result = render_scene(builder.scene(), FRONT, only=("depth",))
    assert result.images["depth"][24, 32, 0] == pytest.approx(4.0, rel=1e-5)
    assert any("transmissive" in note for note in result.notes)


def test_unlit_materials_are_lit_and_told(builder, render_scene):
    builder.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), unlit=True)
    result = render_scene(builder.scene(), FRONT, lights=[Sun((0, 0, 1), 2.0)], only=("direct",))
    assert result.images["direct"][24, 32, 0] == pytest.approx(2 / np.pi, rel=1e-3)
    assert "1 unlit materials are lit like any other" in result.notes


def test_meshes_too_large_for_a_buffer_are_named(gpu, builder):
    builder.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    small = replace(gpu, limits={**gpu.limits, "max-buffer-size": 100})
    with pytest.raises(ValueError, match=r"built\.gltf: vertices take 0 MiB.*simplify"):
        SceneMeshes(small, builder.scene(), np.zeros(3), 64)


def test_large_textures_are_halved_and_told(builder, render_scene):
    use = builder.image(np.full((8, 64, 3), 200))
    builder.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), base_color_texture=use)
    result = render_scene(builder.scene(), FRONT, only=("albedo",), max_texture_size=16)
    note = "1 images are halved until they fit into 16 texels a side; the largest has 64 x 8"
    assert note in result.notes
    expected = ((200 / 255 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(result.images["albedo"][24, 32], expected, rtol=5e-3)


def test_mipmaps_average_linear_light():
    """Black and white in a checkerboard is half the light, not half the code; odd sizes lose no texel."""
    checkers = np.indices((8, 8)).sum(0) % 2 * 255
    pixels = np.stack([checkers] * 4, axis=-1).astype(np.uint8)
    last = mipmaps(pixels, srgb=True)[-1][0, 0]
    assert abs(int(last[0]) - 188) <= 1 and abs(int(last[3]) - 128) <= 1
    odd = np.zeros((1, 3, 4), np.uint8)
    odd[0, 1] = 255
    assert abs(int(mipmaps(odd, srgb=False)[-1][0, 0, 0]) - 85) <= 1
    assert [level.shape[:2] for level in mipmaps(np.zeros((5, 12, 4), np.uint8), True)] == [
        (5, 12), (2, 6), (1, 3), (1, 1),
    ]  # fmt: skip


def _at(x, y):
    shift = np.zeros((4, 4))
    shift[0, 3], shift[1, 3] = x, y
    return shift


def _no_primitives():
    from fit.primitives import PrimitiveSet

    return PrimitiveSet.empty()
