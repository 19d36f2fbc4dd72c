"""The reference against what is known in closed form, against our own path tracer, and against itself."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fit.primitives import Kind, PrimitiveSet, make_box, make_cylinder, make_sphere
from fit.scene import AlphaMode, Camera, Image, Instance, Material, Mesh, Scene, Texture, TextureUse
from runtime.camera import look_at
from runtime.lights import Illumination, Point, Spot, Sun
from runtime.sky import Sky
from runtime.twins import reference as path_tracer

pytest.importorskip("mitsuba", reason="Mitsuba is not installed: pip install 'sdfprim[reference]'")
pytest.importorskip("platformdirs", reason="platformdirs is not installed: pip install 'sdfprim[reference]'")

from pipelines.reference import mesh_reference, primitive_reference
from pipelines.reference.mitsuba import engine_notes
from pipelines.reference.store import FOLDER, cached, digest

DARK = Illumination()
SPECK = make_box((0.3, 0.4, 0.5), (1e-3, 1e-3, 1e-3), albedo=(0, 0, 0))


def points_in_the_air(count: int = 100):
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(count, 3))
    return rng.uniform(-1.9, 1.9, (count, 3)), normals / np.linalg.norm(normals, axis=1, keepdims=True)


def room(albedo: float = 0.5, emission: float = 0.0, opening: bool = False) -> PrimitiveSet:
    """3 m inside, walls 20 cm; without its +x wall when open."""
    walls = []
    for axis in range(3):
        for side in (1, -1):
            if opening and (axis, side) == (0, 1):
                continue
            center, size = np.zeros(3), np.full(3, 3.4)
            center[axis], size[axis] = side * 1.6, 0.2
            walls.append(make_box(center, size, albedo=[albedo] * 3, emission=[emission] * 3))
    return PrimitiveSet.concatenate(walls)


def inner_points(count: int, seed: int = 0):
    rng = np.random.default_rng(seed)
    points, face = rng.uniform(-1.49, 1.49, (count, 3)), rng.integers(1, 6, count)
    axis, side = face // 2, np.where(face % 2, -1.0, 1.0)
    rows = np.arange(count)
    points[rows, axis] = side * 1.5
    normals = np.zeros((count, 3))
    normals[rows, axis] = -side
    return points, normals


def quad(material: Material, **extra) -> Scene:
    """A square of 2 m in the plane z = 0 that faces +z; texture (0, 0) is its upper left corner."""
    positions = np.array([(-1.0, 1, 0), (-1, -1, 0), (1, -1, 0), (1, 1, 0)])
    uv = np.array([(0.0, 0), (0, 1), (1, 1), (1, 0)])
    triangles = np.array([(0, 1, 2), (0, 2, 3)], np.uint32)
    mesh = Mesh("quad", positions, np.tile([0.0, 0, 1], (4, 1)), triangles, 0, (uv,))
    return Scene(
        source=__file__,
        meshes=(mesh,),
        materials=(material,),
        instances=(Instance(0, -1, np.eye(4)),),
        **extra,
    )


def straight_on() -> Camera:
    return Camera("front", look_at(np.array([0.0, 0, 3]), np.zeros(3)).world_from_local, ymag=1.0)


# ------------------------------------------------------------------------------------------- irradiance


def test_constant_sky_is_exact():
    points, normals = points_in_the_air()
    sky = Sky.constant((1.0, 2.0, 0.5))
    found = primitive_reference(SPECK, Illumination((), sky)).irradiance(points, normals, samples=4)
    np.testing.assert_allclose(found.value / (np.pi * np.array([1.0, 2.0, 0.5])), 1, atol=1e-5)
    assert found.noise < 1e-5


def test_gradient_sky_has_its_bright_side_where_it_should():
    axis = np.array([1.0, 2.0, 3.0]) / np.sqrt(14)
    points, normals = points_in_the_air()
    sky = Sky.gradient((1, 1, 1), (0.8, 0.6, 0.4), tuple(axis))
    found = primitive_reference(SPECK, Illumination((), sky)).irradiance(points, normals, samples=512)
    expected = np.pi * (1 + 2 / 3 * np.array([0.8, 0.6, 0.4]) * (normals @ axis)[:, None])
    assert np.abs(found.value / expected - 1).mean() < 0.02
    assert (found.value / expected).mean() == pytest.approx(1, abs=0.005)


def test_closed_box_of_glowing_walls():
    """Unlimited bounces: E = pi Le / (1 - albedo)."""
    reference = primitive_reference(room(albedo=0.8, emission=2.0), DARK)
    found = reference.irradiance(*inner_points(60), samples=1024)
    assert found.value.mean() == pytest.approx(np.pi * 2 / (1 - 0.8), rel=0.01)


def test_agrees_with_our_own_path_tracer():
    """An open room under sun and sky, against the NumPy twin of the runtime's tracer."""
    open_room = room(opening=True)
    sun = (1.0, 0.6, 0.3)
    points, normals = inner_points(300)
    light = Illumination((Sun(sun, 10.0),), Sky.constant((1.0, 1.0, 1.0)))
    found = primitive_reference(open_room, light).irradiance(points, normals, samples=128)
    own = path_tracer.indirect_irradiance(
        open_room,
        points,
        normals,
        sky=lambda directions: np.ones((len(directions), 3)),
        suns=(path_tracer.SunLight(sun, (10.0,) * 3),),
        samples=64,
    )
    assert found.value.mean() == pytest.approx(float(own.mean()), rel=0.03)


def test_a_mesh_and_the_primitives_that_it_is_agree(mesh_of_boxes):
    boxes = PrimitiveSet.concatenate(
        [room(opening=True), make_box((0.3, -1, 0.2), (0.8, 1, 0.6), albedo=[0.5] * 3)]
    )
    light = Illumination((Sun((1.0, 0.6, 0.3), 10.0),), Sky.constant((1.0, 1.0, 1.0)))
    points, normals = inner_points(200)
    found = [
        reference.irradiance(points, normals, samples=128)
        for reference in (primitive_reference(boxes, light), mesh_reference(mesh_of_boxes(boxes), light))
    ]
    assert found[0].value.mean() == pytest.approx(found[1].value.mean(), rel=0.02)
    error = np.hypot(found[0].standard_error, found[1].standard_error)
    difference = np.abs(found[0].value - found[1].value).mean(axis=1)
    assert np.percentile(difference / np.maximum(error, 1e-3), 90) < 4


def test_thin_lamps_of_many_faces_are_counted_once():
    """The sides of a thin lamp lie as far away as its face: a ray that is aimed at one meets the other."""
    points, normals = np.array([(x, -1.4, 0.2) for x in (-0.5, 0.0, 0.5)]), np.tile([0.0, 1.0, 0.0], (3, 1))
    found = []
    for thickness in (0.002, 0.02):
        size = (0.7, thickness, 0.7)
        lamp = make_box((0, 1 + thickness / 2, 0), size, albedo=(0, 0, 0), emission=(5, 5, 5))
        found.append(primitive_reference(lamp, DARK).irradiance(points, normals, samples=4096).value.mean())
    assert found[0] == pytest.approx(found[1], rel=0.05)


def test_noise_falls_and_is_told_rightly():
    light = Illumination((), Sky.gradient((1, 1, 1), (1, 1, 1), (0, 1, 0)))
    reference = primitive_reference(room(opening=True), light)
    points, normals = inner_points(200)
    few, many = (reference.irradiance(points, normals, samples=n) for n in (32, 512))
    assert many.noise == pytest.approx(few.noise / 4, rel=0.35)
    stopped = reference.irradiance(points, normals, samples=4096, target=2 * many.noise)
    assert stopped.noise <= 2 * many.noise
    assert stopped.samples < 1024


# --------------------------------------------------------------------------------------------- pictures


def test_the_sun_lights_a_surface_by_its_cosine():
    towards = (0.0, 1.0, 2.0)
    white = quad(Material(base_color=(0.6, 0.4, 0.2, 1)))
    picture = mesh_reference(white, Illumination((Sun(towards, 5.0),))).picture(
        straight_on(), (8, 8), samples=2
    )
    expected = np.array([0.6, 0.4, 0.2]) / np.pi * 5 * 2 / np.sqrt(5)
    np.testing.assert_allclose(picture.direct.reshape(-1, 3), np.tile(expected, (64, 1)), rtol=1e-4)
    np.testing.assert_allclose(picture.indirect, 0, atol=1e-5)


@pytest.mark.parametrize("inner", [0.0, 0.3])
def test_a_spot_falls_off_as_gltf_says(inner):
    outer, height = 0.5, 2.0
    spot = Spot((0.1, 0.2, height), (0, 0, -1), 7.0, inner, outer)
    picture = mesh_reference(quad(Material()), Illumination((spot,))).picture(
        straight_on(), (32, 32), samples=2
    )
    place = (np.arange(32) + 0.5) / 16 - 1
    x, y = np.meshgrid(place, -place)
    squared = (x - 0.1) ** 2 + (y - 0.2) ** 2 + height**2
    cosine = height / np.sqrt(squared)
    share = np.clip((cosine - np.cos(outer)) / (np.cos(inner) - np.cos(outer)), 0, 1) ** 2
    expected = 7 * share * cosine / squared / np.pi
    np.testing.assert_allclose(picture.direct[..., 0], expected, atol=0.005 * expected.max())


def test_a_point_falls_off_by_the_square():
    lamp = Point((0, 0, 1.5), (2.0, 1.0, 0.5))
    picture = mesh_reference(quad(Material()), Illumination((lamp,))).picture(
        straight_on(), (9, 9), samples=2
    )
    np.testing.assert_allclose(picture.direct[4, 4], np.array([2, 1, 0.5]) / 1.5**2 / np.pi, rtol=1e-4)


def textured(pixels: np.ndarray, **material) -> Scene:
    return quad(
        Material(base_color_texture=TextureUse(0), **material),
        textures=(Texture(0, linear=False),),
        images=(Image("squares", pixels.astype(np.uint8)),),
    )


def test_textures_are_the_right_way_up():
    pixels = np.zeros((2, 2, 4))
    pixels[..., 3] = 255
    pixels[0, 0, 0] = pixels[0, 1, 1] = pixels[1, 0, 2] = 255  # red, green / blue, black
    scene = textured(pixels)
    picture = mesh_reference(scene, Illumination((Sun((0, 0, 1), np.pi),))).picture(
        straight_on(), (4, 4), samples=2
    )
    corners = picture.direct[[0, 0, 3, 3], [0, 3, 0, 3]]
    np.testing.assert_allclose(corners, [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0)], atol=1e-3)


def test_cut_outs_let_light_through_and_show_the_sky():
    pixels = np.full((2, 2, 4), 255)
    pixels[0, :, 3] = 20
    scene = textured(pixels, alpha_mode=AlphaMode.MASK, alpha_cutoff=0.5)
    light = Illumination((), Sky.constant((0.25, 0.25, 0.25)))
    picture = mesh_reference(scene, light).picture(straight_on(), (4, 4), samples=2)
    np.testing.assert_allclose(picture.beauty.value[0], 0.25, rtol=1e-4)
    black = textured(pixels * (0, 0, 0, 1), alpha_mode=AlphaMode.MASK, alpha_cutoff=0.5)
    behind = [[0.0, 0.5, -0.05], [0.0, -0.5, -0.05]]
    found = mesh_reference(black, light).irradiance(behind, [[0, 0, 1.0]] * 2, samples=256)
    assert found.value[0, 0] > 0.9 * np.pi / 4
    assert found.value[1, 0] < 0.1 * np.pi / 4


def test_lamps_shine_through_cut_outs():
    """Half of a screen is holes: a sun behind it lights what faces it through them."""
    pixels = np.full((2, 2, 4), 255)
    pixels[0, :, 3] = 20
    screen = textured(pixels, alpha_mode=AlphaMode.MASK, alpha_cutoff=0.5)
    wall = replace(screen.meshes[0], positions=screen.meshes[0].positions - (0, 0, 0.2), material=1)
    both = replace(
        screen,
        meshes=(*screen.meshes, wall),
        materials=(*screen.materials, Material()),
        instances=(*screen.instances, Instance(1, -1, np.eye(4))),
    )
    sun = Illumination((Sun((0, 0, 1), np.pi),))
    behind = mesh_reference(both, sun).irradiance(
        [[0, 0.5, -0.1], [0, -0.5, -0.1]], [[0, 0, -1.0]] * 2, samples=4096
    )
    assert behind.value[0, 0] > 0.8 * np.pi
    assert behind.value[1, 0] < 0.25 * np.pi, "0.2 pi reach it by way of the wall and the screen's back"


def test_lamps_that_are_double_sided_shine_both_ways():
    both = quad(Material(emission=(3, 2, 1), double_sided=True))
    one = quad(Material(emission=(3, 2, 1)))
    points, normals = [[0, 0, 0.01], [0, 0, -0.01]], [[0, 0, -1.0], [0, 0, 1.0]]
    lit = mesh_reference(both, DARK).irradiance(points, normals, samples=4096).value
    np.testing.assert_allclose(lit, np.pi * np.array([[3, 2, 1]] * 2), rtol=0.05)
    half = mesh_reference(one, DARK).irradiance(points, normals, samples=4096).value
    np.testing.assert_allclose(half, np.pi * np.array([[3, 2, 1], [0, 0, 0]]), atol=0.3)


def test_a_lamp_that_is_mirrored_shines_the_way_its_triangles_face():
    """Mirrored in x it faces +z as before, but triangles change their order; mirrored in z it faces -z."""
    lamp = quad(Material(emission=(3, 2, 1)))
    points, normals = [[0, 0, 0.01], [0, 0, -0.01]], [[0, 0, -1.0], [0, 0, 1.0]]
    for turn, side in (((-1, 1, 1), 0), ((1, 1, -1), 1), ((-1, 1, -1), 1)):
        placed = replace(lamp, instances=(Instance(0, -1, np.diag([*turn, 1.0]).astype(float)),))
        expected = np.zeros((2, 3))
        expected[side] = np.pi * np.array([3, 2, 1])
        lit = mesh_reference(placed, DARK).irradiance(points, normals, samples=4096).value
        np.testing.assert_allclose(lit, expected, atol=0.3)


def with_colors(scene: Scene, color: tuple[float, float, float, float]) -> Scene:
    return replace(scene, meshes=(replace(scene.meshes[0], colors=np.tile(color, (4, 1))),))


def test_vertex_colours_are_multiplied_by_the_factor():
    scene = with_colors(quad(Material(base_color=(0.5, 0.4, 1, 1))), (0.5, 1, 0.25, 1))
    reference = mesh_reference(scene, Illumination((Sun((0, 0, 1), np.pi),)))
    picture = reference.picture(straight_on(), (4, 4), samples=2)
    np.testing.assert_allclose(picture.direct[2, 2], (0.25, 0.4, 0.25), rtol=1e-3)
    assert reference.notes == ()


@pytest.mark.parametrize(("variant", "words"), [("llvm_ad_rgb", ""), ("scalar_rgb", "libllvm19")])
def test_a_slow_variant_says_how_to_get_a_fast_one(variant, words):
    notes = engine_notes(SimpleNamespace(variant=lambda: variant))
    assert bool(notes) == bool(words)
    assert all(words in note and "DRJIT_LIBLLVM_PATH" in note for note in notes)


def test_what_mitsuba_cannot_say_of_textures_is_noted():
    colored = with_colors(textured(np.full((2, 2, 4), 255)), (0.5, 1, 0.25, 1))
    assert any("vertex colours" in note for note in mesh_reference(colored, DARK).notes)
    lamp = {"emission": (1, 1, 1), "emission_texture": TextureUse(0, transform=np.diag([2.0, 2, 1]))}
    glowing = textured(np.full((2, 2, 4), 255), **lamp)
    assert any("emits by the coordinates" in note for note in mesh_reference(glowing, DARK).notes)
    alike = textured(np.full((2, 2, 4), 255), **lamp | {"emission_texture": TextureUse(0)})
    assert mesh_reference(alike, DARK).notes == ()


def test_each_kind_and_face_shows_its_own_colour():
    colors = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (0, 1, 1), (1, 0, 1)]
    box = make_box((0, 0, 0), (1, 1, 1), albedo=colors)
    ball, rod = (
        make_sphere((3, 0, 0), 0.5, albedo=(0.2, 0.4, 0.6)),
        make_cylinder((6, 0, 0), 0.5, 1, albedo=(0.3,) * 3),
    )
    solids = PrimitiveSet.concatenate([box, ball, rod])
    assert solids.kinds.tolist() == [Kind.BOX, Kind.SPHERE, Kind.CYLINDER]
    reference = primitive_reference(solids, Illumination((), Sky.constant((1, 1, 1))))
    for axis, sign in ((a, s) for a in (0, 2) for s in (1, -1)):
        away = np.zeros(3)
        away[axis] = 0.9 * sign
        picture = reference.picture(look_at(away, np.zeros(3), 5), (1, 1), samples=2048)
        np.testing.assert_allclose(
            picture.beauty.value[0, 0], colors[2 * axis + (sign < 0)], atol=0.1 if axis == 0 else 0.02
        )
    for x, color in ((3, (0.2, 0.4, 0.6)), (6, (0.3, 0.3, 0.3))):
        picture = reference.picture(
            look_at(np.array([x, 0, 2.0]), np.array([x, 0, 0.0]), 2), (1, 1), samples=64
        )
        np.testing.assert_allclose(picture.beauty.value[0, 0], color, rtol=0.1)


# ------------------------------------------------------------------------------------------------ store


def test_results_are_found_again_by_all_they_depend_on(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER, str(tmp_path))
    calls = []

    def make():
        calls.append(1)
        return {"value": np.arange(3.0)}

    scene = quad(Material())
    assert cached((scene, 1), make)[1] is False
    arrays, was_kept = cached((scene, 1), make)
    assert was_kept
    np.testing.assert_array_equal(arrays["value"], np.arange(3.0))
    cached((scene, 2), make)
    cached((quad(Material(roughness=0.5)), 1), make)
    assert len(calls) == 3
    for path in (tmp_path / "reference").iterdir():
        path.write_bytes(b"broken")
    assert cached((scene, 1), make)[1] is False


def test_digests_tell_types_and_places_apart():
    values = [
        (1, 2),
        (2, 1),
        ("1", 2),
        ((1,), 2),
        [1, 2],
        (1.0, 2),
        (np.array([1, 2]),),
        (np.array([1.0, 2]),),
    ]
    assert len({digest(value) for value in values}) == len(values)
    with pytest.raises(TypeError, match="object"):
        digest(object())
