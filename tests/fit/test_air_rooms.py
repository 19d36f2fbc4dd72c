"""Rooms behind thin walls, closed double-sided rooms, and passages too narrow for the grid, in any pose."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fit.air import find_air
from fit.gltf import load
from fit.scene import Camera, Instance, Light, LightKind, Material, Mesh, Node, Scene
from fit.surface import from_scene, from_triangles

SIZE = np.array([4.0, 3.0, 5.0])
LEFT, RIGHT = np.array([-1.0, 0, 0]), np.array([1.0, 0, 0])


def box(size, center=(0, 0, 0)):
    return np.array(trimesh.creation.box(size, trimesh.transformations.translation_matrix(center)).triangles)


def turned(triangles):
    return triangles[:, ::-1]


def partition(thickness):
    """Across a room at x = 0: two sheets, or a single one where there is no thickness."""
    wall = box((max(thickness, 1.0), SIZE[1], SIZE[2]))
    if thickness == 0:
        return wall[(wall[:, :, 0] > 0).all(axis=1)] - [0.5, 0, 0]
    return wall


def wall_with_a_slit(width, depth, height=SIZE[1]):
    """Across the room, `depth` thick, with a slit of `width` along its whole `height` at z = 0."""
    side = (SIZE[2] - width) / 2
    parts = [box((depth, SIZE[1], side), (0, 0, sign * (width + side) / 2)) for sign in (-1, 1)]
    parts.append(box((depth, SIZE[1] - height, width), (0, height / 2, 0)))
    return np.concatenate(parts[: 2 if height == SIZE[1] else 3])


def evidence(spaces):
    return [space.evidence for space in spaces]


# ------------------------------------------------------------------------------------------------ thin walls


@settings(max_examples=12, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 2**32 - 1),
    thickness=st.one_of(st.just(0.0), st.floats(-5, -1.5).map(lambda power: 10.0**power)),
    scale=st.floats(-4, 5).map(lambda power: 10.0**power),
    far=st.floats(-1e3, 1e3),
)
def test_no_wall_is_so_thin_that_two_rooms_share_their_air(seed, thickness, scale, far):
    """`thickness` is a share of the diagonal; `far` of diagonals away from the origin."""
    diagonal = np.linalg.norm(SIZE)
    turn = Rotation.random(random_state=seed).as_matrix()
    triangles = np.concatenate([turned(box(SIZE)), partition(thickness * diagonal)])

    def placed(points):
        return scale * (points @ turn.T + far * diagonal * turn[0])

    air = find_air(from_triangles(placed(triangles)), resolution=40 + seed % 30)
    left, right, outside = air.labels_at(placed(np.array([LEFT, RIGHT, [9, 9, 9]])))
    assert left > 0 and right > 0 and left != right
    assert outside == 1
    assert not air.passages


def curtain(folds, amplitude=0.15, steps=60):
    """A pleated sheet across the room at x = 0, one triangle thin, a little larger than the opening."""
    u, v = np.meshgrid(np.linspace(-0.52, 0.52, steps), [-0.52, 0.52], indexing="ij")
    points = np.stack([amplitude * np.sin(2 * np.pi * folds * u), v * SIZE[1], u * SIZE[2]], axis=-1)
    a, b, c, d = points[:-1, 0], points[1:, 0], points[:-1, 1], points[1:, 1]
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([c, b, d], axis=1)])


@pytest.mark.parametrize("folds", [1.5, 7.3])
@pytest.mark.parametrize("double_sided", [False, True])
def test_a_curtain_parts_two_rooms(folds, double_sided):
    triangles = np.concatenate([turned(box(SIZE)), curtain(folds)])
    air = find_air(from_triangles(triangles, double_sided=double_sided), resolution=60)
    left, right = air.labels_at(np.stack([LEFT, RIGHT]))
    assert left > 0 and right > 0 and left != right


# ----------------------------------------------------------------------------- closed double-sided rooms


def scene_of(triangles, *, double_sided=True, light=None, camera=None):
    mesh = Mesh(
        "room", triangles.reshape(-1, 3), np.tile([0.0, 1, 0], (3 * len(triangles), 1)),
        np.arange(3 * len(triangles), dtype=np.uint32).reshape(-1, 3), 0,
    )  # fmt: skip
    lights = () if light is None else (Light("lamp", LightKind.POINT, (1, 1, 1), 5.0, at(light)),)
    cameras = () if camera is None else (Camera("eye", at(camera), yfov=1.0),)
    return Scene(
        Path("room"), meshes=(mesh,), materials=(Material(double_sided=double_sided),), lights=lights,
        cameras=cameras, nodes=(Node("room", -1, at(0), at(0)),), instances=(Instance(0, 0, at(0)),),
    )  # fmt: skip


def at(point):
    place = np.eye(4)
    place[:3, 3] = point
    return place


def ball(radius):
    return np.array(trimesh.creation.icosphere(3, radius).triangles)


TABLE = box((1.0, 0.1, 1.0), (0.5, -0.5, 0.5))


@pytest.mark.parametrize(
    ("triangles", "options", "is_air"),
    [
        (box(SIZE), {}, False),
        (box(SIZE), {"light": (0.5, 1, 0)}, True),
        (box(SIZE), {"light": (9.0, 9, 9)}, False),
        (box(SIZE), {"camera": (0.5, 1, 0)}, True),
        (box(SIZE), {"light": (0.5, 1, 0), "double_sided": False}, False),
        (np.concatenate([box(SIZE), TABLE]), {}, True),
        (np.concatenate([box(SIZE), TABLE]), {"double_sided": False}, False),
        (np.concatenate([box(SIZE), TABLE, box((2, 2, 2), (0, 5, 0))]), {}, False),
        (turned(box(SIZE)), {}, True),
        (ball(1.0), {"light": (0.0, 0, 0)}, False),
        (np.concatenate([ball(1.0), 0.3 * ball(1.0)]), {}, False),
    ],
    ids=[
        "an empty box", "a light within", "a light without", "a camera", "a single-sided lamp",
        "a table in it", "a single-sided box around a table", "more outside than in it", "fronts inward",
        "a bulb", "a round body with something in it",
    ],
)  # fmt: skip
def test_what_is_in_a_closed_double_sided_box_tells_a_room_from_a_solid(triangles, options, is_air):
    scene = scene_of(triangles, **options)
    air = find_air(from_scene(scene), scene, resolution=60)
    centre = np.array([[-0.3, 0.35, -0.2]])
    assert air.is_air(centre).tolist() == [is_air], evidence(air.spaces + air.rejected)


def test_an_empty_double_sided_box_says_that_nothing_is_in_it():
    air = find_air(from_triangles(box(SIZE), double_sided=True), resolution=60)
    assert "nothing is in it" in air.rejected[0].evidence


@pytest.mark.parametrize(
    ("asset", "inside"),
    [("RTXGI_Furnace/furnace.glb", (0, 0, 0)), ("Bevy_CubesLights/Cubes.glb", (-0.839, 2.41, 2.457))],
)
def test_empty_double_sided_boxes_of_real_scenes_are_solids(shared_assets, asset, inside):
    """The first is a slab that its program looks at from above, the second a cube beside a lamp."""
    scene = load(shared_assets / asset)
    assert not find_air(from_scene(scene), scene).is_air(np.array([inside], float)).any()


# ------------------------------------------------------------------------------------- narrow passages


@pytest.mark.parametrize(("depth", "seed"), [(0.05, 0), (0.05, 1), (0.05, 2), (0.2, 0)])
def test_a_slit_under_two_cells_is_reported_with_its_width(seed, depth):
    width = 0.06
    turn = Rotation.random(random_state=seed).as_matrix() if seed else np.eye(3)
    triangles = np.concatenate([turned(box(SIZE)), wall_with_a_slit(width, depth)])
    air = find_air(from_triangles(triangles @ turn.T), resolution=80)
    assert width < air.cell
    left, right = air.labels_at(np.stack([LEFT, RIGHT]) @ turn.T).tolist()
    assert left != right
    passages = [p for p in air.passages if p.joins == tuple(sorted((left, right)))]
    assert passages, "the two rooms see each other"
    assert abs(passages[0].width - width) < 0.25 * width
    point = np.array(passages[0].point) @ turn
    assert abs(point[0]) < depth / 2 + air.cell and abs(point[2]) < width
    assert f"about {passages[0].width:.3g} m wide" in air.notes()[0]


def test_a_slit_beside_an_open_door_is_reported_too():
    """The two sides are one space, but not where the slit is."""
    wall = wall_with_a_slit(0.05, 0.1)
    wall[:, :, 2] = np.maximum(wall[:, :, 2], -1.5)  # a metre of the wall is missing: the door
    air = find_air(from_triangles(np.concatenate([turned(box(SIZE)), wall])), resolution=80)
    (number,) = air.labels_at(LEFT[None]).tolist()
    assert air.labels_at(RIGHT[None]).tolist() == [number]
    assert [p.joins for p in air.passages] == [(number, number)]
    assert abs(air.passages[0].width - 0.05) < 0.02


def test_wide_doors_rods_and_closed_walls_are_no_narrow_passages():
    door = wall_with_a_slit(1.0, 0.1, height=2.0)
    rod = box((0.05, SIZE[1], 0.05), (1, 0, 1))
    air = find_air(from_triangles(np.concatenate([turned(box(SIZE)), door, rod])), resolution=80)
    assert air.labels_at(LEFT[None]) == air.labels_at(RIGHT[None])
    assert air.passages == ()
