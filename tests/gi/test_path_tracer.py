"""The GPU's path tracer: its tree by what a tree must hold, its light by closed forms and by Mitsuba."""

import numpy as np
import pytest

from fit.gltf import load
from fit.primitives import PrimitiveSet, make_box
from fit.scene import AlphaMode, Image, Instance, Material, Mesh, Scene, Texture, TextureUse, Wrap
from runtime.agreement import agreement
from runtime.estimate import Estimate
from runtime.lights import Illumination, Point, Spot, Sun, choose_illumination
from runtime.path_tracer import PathTracer
from runtime.sky import Sky
from runtime.triangle_tree import DEEPEST, TRIANGLES_A_LEAF, build_tree
from runtime.triangles import Triangles

OUTDOORS = Illumination((Sun((1.0, 0.6, 0.3), 10.0),), Sky.constant((1.0, 1.0, 1.0)))


@pytest.mark.parametrize("count", [1, 4, 5, 63, 1000])
def test_the_tree_holds_every_triangle_once_and_in_its_boxes(count):
    rng = np.random.default_rng(count)
    corners = rng.normal(size=(count, 1, 3)) * (10, 1, 3) + 0.1 * rng.normal(size=(count, 3, 3))
    order, nodes = build_tree(corners)
    assert np.sort(order).tolist() == list(range(count))
    seen = walk(order, nodes, corners)
    assert sorted(seen) == list(range(count))


def walk(order: np.ndarray, nodes: np.ndarray, corners: np.ndarray) -> list[int]:
    """Places of all triangles that lead down from the root reaches, each checked against the boxes above it;
    no way is longer than the shader's stack."""
    words = np.ascontiguousarray(nodes).view(np.uint32)
    reached: list[int] = []
    todo = [(0, [0])]
    while todo:
        node, way = todo.pop()
        assert len(way) <= DEEPEST
        first, count = int(words[node, 0, 3]), int(words[node, 1, 3])
        if count == 0:
            todo += [(child, [*way, child]) for child in (first, first + 1)]
            continue
        assert count <= TRIANGLES_A_LEAF
        reached += range(first, first + count)
        held = corners[order[first : first + count]]
        assert np.all(held >= nodes[way, 0, :3][:, None, None]) and np.all(
            held <= nodes[way, 1, :3][:, None, None]
        )
    return reached


@pytest.mark.parametrize("kind", ["alike", "in a row", "ever smaller"])
def test_the_tree_of_triangles_that_nothing_parts_is_no_deeper_than_the_stack(kind):
    """All in one place; and lengths that halve, which a cut by area alone would take off one by one."""
    scale = {"alike": np.zeros(600), "in a row": np.arange(600.0), "ever smaller": 0.5 ** np.arange(600)}[
        kind
    ]
    corners = np.tile(np.eye(3), (600, 1, 1)) * 1e-3 + scale[:, None, None] * (1, 0, 0)
    assert sorted(walk(*build_tree(corners), corners)) == list(range(600))


def test_the_tree_parts_what_lies_apart():
    """A leaf's box is far smaller than the whole, and a large triangle does not widen its neighbours'."""
    rng = np.random.default_rng(0)
    corners = rng.uniform(size=(4096, 1, 3)) + 0.001 * rng.normal(size=(4096, 3, 3))
    corners[:16] = [(0, 0, 0), (1, 0, 0), (0, 0, 1)]
    _, nodes = build_tree(corners)
    leaves = np.ascontiguousarray(nodes).view(np.uint32)[:, 1, 3] > 0
    sizes = np.ptp(nodes[leaves][:, :, :3], axis=1).max(axis=1)
    assert np.mean(sizes > 0.5) < 0.02
    assert np.median(sizes) < 0.15


def test_closed_box_of_glowing_walls(gpu, make_room, inner_surface, mesh_of_boxes):
    """Unlimited bounces: E = pi Le / (1 - albedo)."""
    glowing = Material(base_color=(0.8, 0.8, 0.8, 1.0), emission=(2.0, 2.0, 2.0))
    tracer = PathTracer(gpu, mesh_of_boxes(make_room(0.2), glowing), Illumination())
    found = tracer.irradiance(*inner_surface(200), samples=32)
    expected = np.pi * 2 / (1 - 0.8)
    error = np.sqrt((found.standard_error**2).sum()) / len(found.standard_error)
    assert error < 0.015 * expected
    assert abs(found.value.mean() - expected) < 3.5 * error


def test_primitives_are_traced_like_the_mesh_of_them(gpu, make_room, inner_surface, mesh_of_boxes):
    room, surface = make_room(0.2, opening=True), inner_surface(200, opening=True)
    scene = mesh_of_boxes(room)
    mesh, boxes = (
        PathTracer(gpu, scene, OUTDOORS, given).irradiance(*surface, samples=64) for given in (None, room)
    )
    error = np.sqrt((np.hypot(mesh.standard_error, boxes.standard_error) ** 2).sum())
    assert error < 0.05 * mesh.value.mean(axis=1).sum()
    assert abs((mesh.value - boxes.value).mean(axis=1).sum()) < 3.5 * error


def test_points_without_a_start_among_primitives_are_dark(gpu, make_room, mesh_of_boxes):
    block = make_box((0, 0, 0), (2, 2, 2))
    tracer = PathTracer(gpu, mesh_of_boxes(block), OUTDOORS, block)
    found = tracer.irradiance([(0, 0, 0), (0, 1, 0)], [(0, 1, 0), (0, 1, 0)], samples=8)
    assert np.all(found.value[0] == 0)
    np.testing.assert_allclose(found.value[1], np.pi, rtol=1e-5)


def test_sealed_room_is_black(gpu, make_room, inner_surface, mesh_of_boxes):
    tracer = PathTracer(gpu, mesh_of_boxes(make_room(0.01)), OUTDOORS)
    assert np.all(tracer.irradiance(*inner_surface(500), samples=16).value == 0)


def test_far_from_the_origin_nothing_changes(gpu, make_room, inner_surface, mesh_of_boxes):
    room, (points, normals) = make_room(0.2, opening=True), inner_surface(100, opening=True)
    near = PathTracer(gpu, mesh_of_boxes(room), OUTDOORS).irradiance(points, normals, samples=16)
    offset = np.array([1e6, 0, -1e6])
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    far = PathTracer(gpu, mesh_of_boxes(room.transformed(matrix)), OUTDOORS)
    moved = far.irradiance(points + offset, normals, samples=16)
    assert moved.value.mean() == pytest.approx(near.value.mean(), rel=0.02)


def test_noise_is_told_rightly_and_a_target_ends_early(gpu, make_room, inner_surface, mesh_of_boxes):
    tracer = PathTracer(gpu, mesh_of_boxes(make_room(0.2, opening=True)), OUTDOORS)
    points, normals = inner_surface(100, opening=True)
    few, many = (tracer.irradiance(points, normals, samples=n) for n in (64, 256))
    assert many.noise == pytest.approx(few.noise / 2, rel=0.4)
    stopped = tracer.irradiance(points, normals, samples=10_000, target=1.2 * few.noise)
    assert stopped.samples == 64
    assert many.standard_error.mean() == pytest.approx(few.standard_error.mean() / 2, rel=0.2)


def test_an_empty_scene_is_refused(gpu):
    mesh = Mesh("none", np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3), np.uint32), 0)
    scene = Scene(source="empty.glb", meshes=(mesh,), instances=(Instance(0, -1, np.eye(4)),))
    with pytest.raises(ValueError, match="no triangle"):
        Triangles(gpu, scene, np.zeros(3))


# -------------------------------------------------------------------------------------------- Mitsuba


def textured_stage() -> Scene:
    """A floor, a checkered screen with holes that repeats and mirrors, and a lamp that shines both ways."""
    rng = np.random.default_rng(5)
    pixels = rng.integers(30, 226, (8, 8, 4)).astype(np.uint8)
    screen = Material(
        base_color=(0.9, 0.8, 0.7, 1),
        base_color_texture=TextureUse(0),
        alpha_mode=AlphaMode.MASK,
        alpha_cutoff=0.4,
    )
    lamp = Material(base_color=(0.1, 0.1, 0.1, 1), emission=(4, 3, 2), double_sided=True)
    floor = Material(base_color=(0.7, 0.7, 0.7, 1))

    def square(material: int) -> Mesh:
        positions = np.array([(-1.0, 0, -1), (-1, 0, 1), (1, 0, 1), (1, 0, -1)])
        uv = np.array([(-0.5, -0.5), (-0.5, 2), (2, 2), (2, -0.5)])
        triangles = np.array([(0, 1, 2), (0, 2, 3)], np.uint32)
        return Mesh("square", positions, np.tile([0.0, 1, 0], (4, 1)), triangles, material, (uv,))

    def place(scale: float, height: float, tilt: float = 0.0) -> np.ndarray:
        c, s = np.cos(tilt), np.sin(tilt)
        matrix = np.array([[c, -s, 0, 0], [s, c, 0, height], [0, 0, 1, 0], [0, 0, 0, 1.0]])
        matrix[:3, :3] *= scale
        return matrix

    return Scene(
        source="stage.glb",
        meshes=(square(0), square(1), square(2)),
        materials=(floor, screen, lamp),
        textures=(Texture(0, Wrap.MIRROR, Wrap.MIRROR),),
        images=(Image("holes", pixels),),
        instances=(
            Instance(0, -1, place(2.0, 0.0)),
            Instance(1, -1, place(0.9, 0.6, 0.4)),
            Instance(2, -1, place(0.2, 1.4)),
        ),
    )


LIGHTS = Illumination(
    (
        Sun((0.3, 1.0, 0.4), 2.0),
        Point((0.5, 1.5, -0.5), 1.0),
        Spot((-0.7, 1.2, 0.2), (0.3, -1, 0), 1.0, 0.2, 0.6),
    ),
    Sky.gradient((0.3, 0.4, 0.5), (0.2, 0.2, 0.2), (0, 1, 0)),
)


def scenes(bundled_assets, mesh_of_boxes, make_room):
    cornell = load(bundled_assets / "cornell.glb")
    blocks = PrimitiveSet.concatenate([make_room(0.2, opening=True), make_box((0.3, -1, 0.2), (0.8, 1, 0.6))])
    return {
        "stage": (textured_stage(), LIGHTS, (-1.5, 0.0, -1.5), (1.5, 0.0, 1.5)),
        "room": (mesh_of_boxes(blocks), OUTDOORS, (-1.4, -1.5, -1.4), (-0.3, -1.5, 1.4)),
        "cornell": (cornell, choose_illumination(cornell), (-0.9, 0.0, -0.9), (0.9, 0.0, 0.9)),
    }


@pytest.mark.parametrize("name", ["stage", "room", "cornell"])
def test_agrees_with_mitsuba_within_noise(gpu, bundled_assets, mesh_of_boxes, make_room, name):
    """z-test on the floor: no strip of 20 pixels is off by more than chance allows, and there is no bias.
    In strips, because rays that meet a small lamp are too rare for one point's error to be normal."""
    pytest.importorskip("mitsuba", reason="Mitsuba is not installed: pip install 'sdfprim[reference]'")
    from pipelines.reference import mesh_reference

    scene, light, lower, upper = scenes(bundled_assets, mesh_of_boxes, make_room)[name]
    points = np.random.default_rng(1).uniform(lower, upper, (250, 3))
    normals = np.tile([0.0, 1.0, 0.0], (len(points), 1))
    ours = PathTracer(gpu, scene, light).irradiance(points, normals, samples=128)
    theirs = mesh_reference(scene, light).irradiance(points, normals, samples=256)
    order = np.argsort(points[:, 0], kind="stable")
    found = agreement(rows_of(ours, order), rows_of(theirs, order), pixels_a_group=20)
    assert found.holds, found.describe()


def rows_of(estimate: Estimate, rows: np.ndarray) -> Estimate:
    columns = (estimate.value, estimate.first, estimate.second, estimate.standard_error)
    return Estimate(*(column[rows] for column in columns), estimate.samples)
