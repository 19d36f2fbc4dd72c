"""The triangle soup and its colours: places, fronts, walls, texture lookups, uniform samples."""

from pathlib import Path

import numpy as np
import pytest

from fit.sample import sample_surface
from fit.scene import AlphaMode, Image, Instance, Material, Mesh, Node, Scene, Texture, TextureUse, Wrap
from fit.surface import colors, from_scene, from_triangles, sample_image

QUAD = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], float)
QUAD_TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
QUAD_UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)


def quad_scene(matrices, material=None, colors=None, images=(), textures=(), texcoords=(QUAD_UV,)):
    mesh = Mesh(
        "quad", QUAD, np.tile([0.0, 0, 1], (4, 1)), QUAD_TRIANGLES, 0, texcoords=texcoords, colors=colors
    )
    return Scene(
        source=Path("quad"),
        meshes=(mesh,),
        materials=(material or Material(),),
        images=tuple(images),
        textures=tuple(textures),
        nodes=tuple(Node(f"n{i}", -1, m, m) for i, m in enumerate(matrices)),
        instances=tuple(Instance(0, i, m) for i, m in enumerate(matrices)),
    )


def two_texels():
    """Left texel red, right texel blue, full bytes that sRGB keeps; the right one half clear."""
    return Image("two", np.array([[[255, 0, 0, 255], [0, 0, 255, 128]]], np.uint8))


def centers(surface):
    return np.arange(len(surface)), np.full((len(surface), 3), 1 / 3)


def test_instances_are_placed_and_mirrored_ones_keep_their_front():
    shift, mirror = np.eye(4), np.diag([-1.0, 1, 1, 1])
    shift[:3, 3] = [10, 20, 30]
    surface = from_scene(quad_scene([np.eye(4), shift, mirror]))
    assert len(surface) == 6
    assert surface.instance.tolist() == [0, 0, 1, 1, 2, 2]
    assert surface.triangle.tolist() == [0, 1, 0, 1, 0, 1]
    np.testing.assert_allclose(surface.areas, 1.0)
    np.testing.assert_allclose(surface.normals, np.tile([0.0, 0, 1], (6, 1)))
    cross = np.cross(
        surface.vertices[:, 1] - surface.vertices[:, 0], surface.vertices[:, 2] - surface.vertices[:, 0]
    )
    np.testing.assert_allclose(cross / 2, surface.normals * surface.areas[:, None])
    np.testing.assert_allclose(surface.bounds, [[-2, 0, 0], [12, 21, 30]])


def test_zero_area_triangles_are_left_out_and_rows_still_point_at_the_mesh():
    corners = np.array([[[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 0, 0], [1, 0, 0], [0, 1, 0]]], float)
    surface = from_triangles(corners)
    assert surface.triangle.tolist() == [1]
    assert np.isfinite(surface.normals).all()
    assert len(from_triangles(corners[:1])) == 0


def test_empty_scene_gives_an_empty_surface():
    surface = from_scene(Scene(source=Path("nothing")))
    assert len(surface) == 0
    assert surface.diagonal == 0.0
    assert len(sample_surface(surface, 100, 0)) == 0


@pytest.mark.parametrize(
    ("material", "wall"),
    [
        (Material(base_color=(1, 1, 1, 0.3)), True),
        (Material(base_color=(1, 1, 1, 0.3), alpha_mode=AlphaMode.MASK), True),
        (Material(base_color=(1, 1, 1, 0.3), alpha_mode=AlphaMode.BLEND), False),
        (Material(base_color=(1, 1, 1, 0.7), alpha_mode=AlphaMode.BLEND), True),
        (Material(transmission=0.9), False),
    ],
)
def test_faces_that_are_seen_through_are_no_walls(material, wall):
    surface = from_scene(quad_scene([np.eye(4)], material))
    assert surface.is_wall.tolist() == [wall, wall]
    assert len(surface.walls()) == (2 if wall else 0)
    assert len(sample_surface(surface, 10, 0)) == (10 if wall else 0)


def test_blended_texture_alpha_and_vertex_alpha_decide_each_face():
    clear = np.array([[1, 1, 1, 1.0], [1, 1, 1, 0.1], [1, 1, 1, 0.1], [1, 1, 1, 1.0]])
    material = Material(alpha_mode=AlphaMode.BLEND)
    assert from_scene(quad_scene([np.eye(4)], material, colors=clear)).is_wall.tolist() == [False, True]


def test_colors_are_textured_transformed_and_linear():
    use = TextureUse(
        0, transform=np.array([[1, 0, 0.5], [0, 1, 0], [0, 0, 1.0]])
    )  # moves half the image: swaps
    material = Material(
        base_color=(0.5, 1, 1, 1),
        base_color_texture=use,
        emission=(2.0, 2.0, 2.0),
        emission_texture=TextureUse(0),
        alpha_mode=AlphaMode.BLEND,
    )
    texture = Texture(0, Wrap.REPEAT, Wrap.REPEAT, linear=False)
    mirror = np.diag([-1.0, 1, 1, 1])
    scene = quad_scene([np.eye(4), mirror], material, images=[two_texels()], textures=[texture])
    surface = from_scene(scene)
    triangle, barycentric = centers(surface)
    points = np.einsum("pc,pck->pk", barycentric, surface.vertices[triangle])
    albedo, emission, alpha = colors(scene, surface, triangle, barycentric)
    left = np.abs(points[:, 0]) < 1
    np.testing.assert_array_equal(left, [False, True, False, True])
    np.testing.assert_allclose(albedo[left], np.tile([0, 0, 1.0], (2, 1)))
    np.testing.assert_allclose(albedo[~left], np.tile([0.5, 0, 0], (2, 1)))
    np.testing.assert_allclose(emission[left], np.tile([2.0, 0, 0], (2, 1)))
    np.testing.assert_allclose(alpha[left], 128 / 255)


def test_mirrored_instances_look_colours_up_at_the_right_corner():
    ramp = np.array([[0, 0, 0, 1], [1, 0, 0, 1], [1, 1, 0, 1], [0, 1, 0, 1.0]])  # red = x / 2, green = y
    scene = quad_scene([np.eye(4), np.diag([-1.0, 1, 1, 1])], colors=ramp)
    samples = sample_surface(from_scene(scene), 200, 3)
    albedo, _, _ = colors(scene, from_scene(scene), samples.triangle, samples.barycentric)
    np.testing.assert_allclose(albedo[:, 0], np.abs(samples.points[:, 0]) / 2, atol=1e-12)
    np.testing.assert_allclose(albedo[:, 1], samples.points[:, 1], atol=1e-12)


def test_bytes_are_decoded_from_srgb_but_alpha_is_not():
    gray = Image("gray", np.full((1, 1, 4), 188, np.uint8))
    np.testing.assert_allclose(
        sample_image(gray, np.zeros((1, 2)), Wrap.REPEAT, Wrap.REPEAT)[0],
        [0.50289] * 3 + [188 / 255],
        atol=1e-5,
    )


@pytest.mark.parametrize(
    ("wrap", "u", "red"),
    [
        (Wrap.CLAMP, -3.2, 1.0),
        (Wrap.CLAMP, 1.7, 0.0),
        (Wrap.REPEAT, 1.25, 1.0),
        (Wrap.REPEAT, 1.0, 0.5),
        (Wrap.REPEAT, -0.25, 0.0),
        (Wrap.MIRROR, 1.25, 0.0),
        (Wrap.MIRROR, 1.75, 1.0),
        (Wrap.MIRROR, -0.25, 1.0),
        (Wrap.MIRROR, 0.0, 1.0),
        (Wrap.CLAMP, 0.5, 0.5),
        (Wrap.CLAMP, 0.375, 0.75),
    ],
)
def test_wrap_modes_and_bilinear_filter(wrap, u, red):
    rgba = sample_image(two_texels(), np.array([[u, 0.5]]), wrap, Wrap.CLAMP)
    np.testing.assert_allclose(rgba[0, 0], red, atol=1e-12)
    np.testing.assert_allclose(rgba[0, 2], 1 - red, atol=1e-12)


def test_samples_are_uniform_by_area_and_repeatable():
    small, large = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[10, 0, 0], [13, 0, 0], [10, 3, 0]]], float)
    surface = from_triangles(np.stack([small, large]))
    samples = sample_surface(surface, 20_000, 1)
    assert abs(np.mean(samples.triangle == 1) - 0.9) < 0.01
    on_large = samples.select(samples.triangle == 1)
    np.testing.assert_allclose(on_large.points.mean(axis=0), [11, 1, 0], atol=0.03)
    np.testing.assert_allclose(samples.barycentric.sum(axis=1), 1)
    np.testing.assert_array_equal(samples.points, sample_surface(surface, 20_000, 1).points)
    assert not np.array_equal(samples.points, sample_surface(surface, 20_000, 2).points)
