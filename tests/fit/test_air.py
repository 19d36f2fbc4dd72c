"""Which spaces are air: cells no light step crosses, evidence, seeds, touched sides, random points."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from fit.air import find_air, parse_seed
from fit.gltf import load
from fit.scene import Camera, Scene
from fit.surface import from_scene, from_triangles

ROOM = np.array([4.0, 3.0, 5.0])


def box(size, center=(0, 0, 0)):
    return np.array(trimesh.creation.box(size, trimesh.transformations.translation_matrix(center)).triangles)


def turned(triangles):
    """The same sheets, facing the other way."""
    return triangles[:, ::-1]


def slabs(size, thickness):
    """Six slabs around an empty room of `size`, each a closed box of its own."""
    walls = []
    for axis in range(3):
        for side in (-1, 1):
            extent = np.array(size) + 2 * thickness
            extent[axis] = thickness
            center = np.zeros(3)
            center[axis] = side * (size[axis] + thickness) / 2
            walls.append(box(extent, center))
    return np.concatenate(walls)


def shell_with_a_hole(radius=1.0):
    """A single-sided sphere, front outwards, whose lowest cap is missing: a scan that stood on a table."""
    ball = np.array(trimesh.creation.icosphere(4, radius).triangles)
    return ball[ball[:, :, 1].mean(axis=1) > -0.9 * radius]


def evidence(spaces):
    return [space.evidence for space in spaces]


# ------------------------------------------------------------------------------------------- which spaces


def test_around_a_closed_object_only_the_outside_is_air():
    air = find_air(from_triangles(box((2, 1, 3))))
    assert air.is_air(np.array([[1.05, 0, 0], [0, 0, 0], [0.9, 0.4, 1.4], [50.0, 0, 0]])).tolist() == [
        True,
        False,
        False,
        True,
    ]
    assert len(air.spaces) == 1
    assert "surfaces face it" in air.spaces[0].evidence
    assert len(air.rejected) == 1
    assert abs(air.rejected[0].volume - 6) < 0.5


def test_a_room_of_inward_sheets_is_air_and_its_far_side_is_not():
    air = find_air(from_triangles(turned(box(ROOM))))
    assert air.is_air(np.array([[0.0, 0, 0], [9, 9, 9]])).tolist() == [True, False]
    assert "a room, seen from inside" in air.spaces[0].evidence
    assert "the outside" in air.rejected[0].evidence


@pytest.mark.parametrize("thickness", [0.2, 0.01])
def test_two_rooms_beside_each_other_are_two_spaces_and_both_air(thickness):
    middle = box((thickness, ROOM[1], ROOM[2]))
    air = find_air(from_triangles(np.concatenate([slabs((2 * ROOM[0], ROOM[1], ROOM[2]), 0.2), middle])))
    inside = np.array([[-2.0, 0, 0], [2.0, 0, 0], [0, 0, 0], [0, 1.6, 0]])
    labels = air.labels_at(inside)
    assert labels[0] != labels[1]
    assert air.is_air(inside).tolist() == [True, True, False, False]
    assert len(air.spaces) == 3, evidence(air.spaces)


def test_a_hollow_between_two_shells_is_no_air():
    outer, inner = box(ROOM + 1), turned(box(ROOM))
    air = find_air(from_triangles(np.concatenate([outer, inner])))
    assert air.is_air(np.array([[0.0, 0, 0], [0, ROOM[1] / 2 + 0.25, 0], [9, 9, 9]])).tolist() == [
        True,
        False,
        True,
    ]


def test_the_inside_of_an_open_bottomed_scan_is_no_air_unless_asked_for():
    surface = from_triangles(shell_with_a_hole())
    points = np.array([[0.0, 0.1, 0], [0, -1.05, 0], [0, 1.05, 0]])
    air = find_air(surface)
    assert air.is_air(points).tolist() == [False, True, True]
    assert "through a hole" in air.rejected[0].evidence
    asked = find_air(surface, seeds=[(0, 0.1, 0)])
    assert asked.is_air(points).tolist() == [True, False, False]


def test_a_double_sided_shell_with_a_hole_is_air_within():
    air = find_air(from_triangles(shell_with_a_hole(), double_sided=True))
    assert air.is_air(np.array([[0.0, 0.1, 0], [0, 1.05, 0]])).all()


def test_a_camera_in_a_space_makes_it_air():
    place = np.eye(4)
    place[:3, 3] = (0.2, 0, 0)
    scene = Scene(source=Path("room"), cameras=(Camera("eye", place, yfov=1.0),))
    air = find_air(from_triangles(box(ROOM)), scene)
    assert air.is_air(np.zeros((1, 3))).all()
    assert any("camera 'eye'" in text for text in evidence(air.spaces))


def test_a_cupboard_in_a_room_stays_shut():
    cupboard = turned(box((0.3, 0.3, 0.3), (1, 0, 0)))
    air = find_air(from_triangles(np.concatenate([turned(box(ROOM)), cupboard])))
    assert air.is_air(np.array([[0.0, 0, 0], [1, 0, 0]])).tolist() == [True, False]


def test_a_small_inverted_thing_does_not_shut_the_outside_out():
    apart = [turned(box((1, 1, 1), (x, 0, 0))) for x in (-5, 5)]
    air = find_air(from_triangles(np.concatenate(apart)))
    assert air.is_air(np.array([[0.0, 0, 0], [9, 9, 9]])).all()


# -------------------------------------------------------------------------------------------------- seeds


def test_seeds_decide_alone():
    surface = from_triangles(turned(box(ROOM)))
    points = np.array([[0.0, 0, 0], [9, 9, 9]])
    assert find_air(surface, seeds=["outside"]).is_air(points).tolist() == [False, True]
    assert find_air(surface, seeds=["0.5,0,0"]).is_air(points).tolist() == [True, False]
    assert find_air(surface, seeds=["outside", (0.5, 0, 0)]).is_air(points).tolist() == [True, True]


def test_a_seed_in_a_wall_is_an_error_that_names_a_free_point():
    with pytest.raises(ValueError, match=r"air 2,0,0: .* nearest free point is") as caught:
        find_air(from_triangles(box(ROOM)), seeds=[(2.0, 0.0, 0.0)])
    named = tuple(float(v) for v in str(caught.value).split(" is ")[1].split(","))
    assert find_air(from_triangles(box(ROOM)), seeds=[named]).is_air(np.array([named])).all()


@pytest.mark.parametrize(
    ("text", "seed"), [("outside", "outside"), (" Outside", "outside"), ("-1,0,2.5", (-1.0, 0.0, 2.5))]
)
def test_parse_seed(text, seed):
    assert parse_seed(text) == seed


@pytest.mark.parametrize("text", ["", "inside", "1,2", "1,2,3,4", "1,2,nan", "1,2,x"])
def test_parse_seed_refuses(text):
    with pytest.raises(ValueError, match="expected 'outside' or three numbers"):
        parse_seed(text)


# -------------------------------------------------------------------------------------------------- cells


@pytest.mark.parametrize("seed", range(8))
def test_no_step_between_free_cells_crosses_a_wall_however_thin(seed):
    """A room as one turned sheet on a coarse grid: a leak anywhere would join inside and outside."""
    turn = trimesh.transformations.random_rotation_matrix(np.random.default_rng(seed).random(3))
    mesh = trimesh.creation.icosphere(2, 1.0)
    mesh.apply_transform(turn)
    air = find_air(from_triangles(mesh.triangles), resolution=24 + seed)
    labels = air.labels_at(np.array([[0.0, 0, 0], [1.2, 1.2, 1.2]]))
    assert labels[0] != labels[1]
    assert labels.all()


def test_solid_cells_are_exactly_those_within_half_a_cell():
    rng = np.random.default_rng(5)
    triangles = rng.random((60, 1, 3)) * 3 + rng.normal(size=(60, 3, 3)) * [[[0.02], [0.3], [1.0]]]
    air = find_air(from_triangles(triangles), resolution=60)
    near = air.distance <= air.cell / 2
    np.testing.assert_array_equal(air.label == 0, near)
    assert 0.001 < near.mean() < 0.5


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e5])
@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_decisions_do_not_depend_on_scale_or_place(scale, offset):
    surface = from_triangles((turned(box(ROOM)) + offset) * scale)
    air = find_air(surface)
    points = (np.array([[0.0, 0, 0], [1.9, 1.4, 2.4], [9, 9, 9]]) + offset) * scale
    assert air.is_air(points).tolist() == [True, True, False]


@pytest.mark.parametrize(
    "triangles",
    [
        [[[0, 0, 0], [1, 0, 0], [0, 1, 0]]],
        [[[0, 0, 0], [1e4, 0, 0], [0, 1, 0]], [[0, 0, 1], [1e4, 0, 1], [0, 1, 1]]],
        [[[0, 0, 0], [1e-6, 0, 0], [0, 1e-6, 0]], [[0, 0, 1e3], [1e-6, 0, 1e3], [0, 1e-6, 1e3]]],
    ],
    ids=["one triangle", "needles", "dust far apart"],
)
def test_flat_thin_and_tiny_meshes_have_an_outside(triangles):
    air = find_air(from_triangles(np.array(triangles, float)))
    assert air.label.size < 12_000_000
    assert len(air.spaces) == 1
    points = air.random_points(500, 0)
    assert len(points) == 500
    assert air.is_air(points).all()


def test_without_a_wall_there_is_nothing_to_fit():
    with pytest.raises(ValueError, match="no face stops light"):
        find_air(from_triangles(np.zeros((0, 3, 3))))


# ---------------------------------------------------------------------------------------- touch and points


def test_a_sheet_is_touched_from_both_sides_and_a_wall_from_one():
    sheet = np.array([[[-1, 0, -1], [1, 0, -1], [0, 0, 1]]], float)
    air = find_air(from_triangles(sheet))
    up = np.array([[0, 1.0, 0]])
    assert air.touches(np.zeros((1, 3)), up).tolist() == [2]
    room = find_air(from_triangles(turned(box(ROOM))))
    floor = np.array([[0.3, -1.5, 0.2]])
    assert room.touches(floor, up).tolist() == [1]
    assert room.touches(floor, -up).tolist() == [-1]
    assert find_air(from_triangles(box(ROOM)), seeds=["outside"]).touches(floor, up).tolist() == [-1]


def test_a_thin_wall_is_touched_on_its_near_side_only():
    """Two sheets, a twentieth of a cell apart, between two rooms: nobody sees the gap."""
    room = turned(box((2.0, 1, 1)))
    gap = 0.0006
    sheets = box((gap, 1, 1))
    air = find_air(from_triangles(np.concatenate([room, sheets])), seeds=[(-0.5, 0, 0), (0.5, 0, 0)])
    points = np.array([[gap / 2, 0.1, 0.2], [-gap / 2, 0.1, 0.2]])
    assert air.touches(points, np.array([[1.0, 0, 0], [-1, 0, 0]])).tolist() == [1, 1]
    one_room = find_air(from_triangles(np.concatenate([room, sheets])), seeds=[(0.5, 0, 0)])
    assert one_room.touches(points, np.array([[1.0, 0, 0], [-1, 0, 0]])).tolist() == [1, 0]


def test_corners_are_touched_too():
    air = find_air(from_triangles(turned(box(ROOM))))
    near_the_edge = np.array([[-1.999, -1.5, 0.3], [-1.999, -1.5, -2.499]])
    assert air.touches(near_the_edge, np.tile([0, 1.0, 0], (2, 1))).tolist() == [1, 1]


def test_random_points_fill_the_room_evenly_and_repeat():
    air = find_air(from_triangles(turned(box(ROOM))), resolution=90)
    points = air.random_points(8_000, 3)
    assert points.shape == (8_000, 3)
    # Air ends where no free cell's centre is nearer than the wall: within half a cell of it.
    assert (np.abs(points) < ROOM / 2).all()
    np.testing.assert_allclose(points.mean(axis=0), 0, atol=0.06)
    np.testing.assert_allclose(points.std(axis=0), ROOM / np.sqrt(12), rtol=0.03)
    np.testing.assert_array_equal(points, air.random_points(8_000, 3))
    assert not np.array_equal(points, air.random_points(8_000, 4))
    again, distance = air.random_points_and_distances(8_000, 3)
    np.testing.assert_array_equal(points, again)
    np.testing.assert_allclose(distance, (ROOM / 2 - np.abs(points)).min(axis=1), atol=1e-9)


# -------------------------------------------------------------------------------------------- real scenes


@pytest.mark.parametrize(
    ("asset", "air_points", "other_points"),
    [
        ("Sponza/Sponza.gltf", [(0, 2, 0), (0, 12, 0), (-6, 2, 5.5)], [(-16.5, 3, 0), (0, -0.9, 0)]),
        ("WebXR_Garage/garage.gltf", [(0, 1.5, 0)], [(0, 1.5, 3.9), (0, 2.92, 4.1)]),
        ("TRI_FurnishedLivingRoom/TRI_FurnishedLivingRoom.gltf", [(0, 1.5, 0)], [(0, 3.3, 0)]),
        ("Godot_LivingRoom/living_room.glb", [(0, 2.5, 9), (-2, 2, 1)], [(0, -1, 5)]),
        ("RTXGI_Cornell/cornell.glb", [(0, 1.6, 0), (0, 1, 0.95)], [(-0.34, 0.3, -0.3), (0.3, 0.3, 0.38)]),
        ("RTXGI_TwoRooms/two-rooms.glb", [(0, 25, 50), (0, 25, -50), (-300, 30, 0)], [(0, -2, 300)]),
        ("FireplaceRoom/FireplaceRoom.gltf", [(3, 1.5, -1)], [(-0.25, 0.19, 0.21)]),
        ("StanfordBunny/StanfordBunny.glb", [(0.06, 0.18, 0.05)], [(-0.02, 0.08, 0.0)]),
    ],
)
def test_spaces_of_real_scenes(shared_assets, asset, air_points, other_points):
    scene = load(shared_assets / asset)
    air = find_air(from_scene(scene), scene)
    assert air.is_air(np.array(air_points, float)).all(), evidence(air.spaces)
    assert not air.is_air(np.array(other_points, float)).any(), evidence(air.spaces)
