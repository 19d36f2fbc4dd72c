"""Exact volumes: closed meshes in every shape that breaks booleans, primitives, their overlap."""

import numpy as np
import pytest
import trimesh

from fit.air import find_air
from fit.gltf import load
from fit.primitives import (
    PrimitiveSet,
    make_box,
    make_cylinder,
    make_half_space,
    make_sphere,
)
from fit.sdf import union_distance
from fit.surface import from_scene, from_triangles
from fit.volume import NotClosed, compare_volumes, mesh_solid, primitive_solid

TABLE = [((2, 0.1, 1), (0, 0.75, 0))] + [
    ((0.1, 0.7, 0.1), (x, 0.35, z)) for x in (-0.9, 0.9) for z in (-0.4, 0.4)
]


def box(size, center=(0, 0, 0)):
    return np.array(trimesh.creation.box(size, trimesh.transformations.translation_matrix(center)).triangles)


def surface_of(*parts):
    return from_triangles(np.concatenate(parts))


def mesh_volume(surface):
    """Of the solid that a surface bounds; else None, and why."""
    try:
        return mesh_solid(surface, surface.center, surface.diagonal).volume() * surface.diagonal**3, ""
    except NotClosed as why:
        return None, str(why)


def union_volume(primitives, bounds=None):
    """Of the union of a set; half-spaces count within the bounds."""
    lower, upper = primitives.bounds() if bounds is None else bounds
    scale = float(np.linalg.norm(upper - lower))
    return primitive_solid(primitives, (lower + upper) / 2, scale, bounds).volume() * scale**3


@pytest.mark.parametrize(
    ("parts", "volume"),
    [
        ([box((2, 1, 3))], 6.0),
        ([box((2, 1, 3))[:, ::-1]], 6.0),
        ([box((2, 2, 2)), box((2, 2, 2), (1, 0, 0))], 12.0),
        ([box((2, 2, 2)), box((1, 1, 1))], 8.0),
        ([box((2, 2, 2)), box((1, 1, 1))[:, ::-1]], 8.0),
        ([box((2, 2, 2)), box((2, 2, 2), (5, 0, 0))[:, ::-1]], 16.0),
        ([box((1, 1, 1)), box((1, 1, 1), (1, 1, 0))], 2.0),
        ([box((1, 1, 1), (1e5, 0, 0))], 1.0),
        ([box((1e-3, 1e-3, 1e-3))], 1e-9),
        ([box(*part) for part in TABLE], 0.2 + 4 * 0.007),
    ],
    ids=[
        "box",
        "inverted",
        "overlapping",
        "nested",
        "nested inverted",
        "apart, one inverted",
        "sharing an edge",
        "far away",
        "tiny",
        "table",
    ],
)
def test_volume_of_closed_meshes(parts, volume):
    found, reason = mesh_volume(surface_of(*parts))
    assert reason == ""
    assert found == pytest.approx(volume, rel=1e-6)


@pytest.mark.parametrize(
    ("triangles", "reason"),
    [
        (box((1, 1, 1))[:-1], "open"),
        (np.concatenate([box((1, 1, 1))[2:], box((1, 1, 1))[:2]])[1:], "open"),
        (np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [0, 1, 0], [1, 0, 0]]], float), "no"),
        (np.concatenate([box((1, 1, 1)), box((1, 1, 1), (3, 0, 0))[:4]]), "open"),
        (np.zeros((0, 3, 3)), "empty"),
    ],
    ids=["lid off", "lid off, reordered", "double sheet", "one of two open", "empty"],
)
def test_what_is_not_closed_has_no_volume(triangles, reason):
    volume, why = mesh_volume(from_triangles(triangles))
    assert volume is None
    assert reason in why


def test_doubled_sheets_beside_a_solid_are_not_taken_for_it():
    """A seat of two coincident faces and a small closed knob: the knob's volume is not the chair's."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float64)
    seat = corners[[[0, 1, 2], [0, 2, 3], [0, 2, 1], [0, 3, 2]]]
    volume, reason = mesh_volume(surface_of(seat, box((0.1, 0.1, 0.1), center=(0.5, 0.5, 0.3))))
    assert volume is None
    assert "sheets" in reason


def test_seams_of_rounding_are_welded():
    ball = np.array(trimesh.creation.icosphere(2, 1.0).triangles)
    shaken = ball + np.random.default_rng(0).uniform(-1e-8, 1e-8, ball.shape)
    volume, reason = mesh_volume(from_triangles(shaken))
    assert reason == ""
    assert volume == pytest.approx(trimesh.creation.icosphere(2, 1.0).volume, rel=1e-5)


def test_primitives_have_their_exact_volume():
    turn = (0.5, 0.5, 0.5, 0.5)
    assert union_volume(make_box((9, 9, 9), (1, 2, 3), turn)) == pytest.approx(6)
    assert union_volume(make_sphere((9, 9, 9), 2.0)) == pytest.approx(4 / 3 * np.pi * 8)
    assert union_volume(make_cylinder((9, 9, 9), 2.0, 3.0, turn)) == pytest.approx(np.pi * 4 * 3)
    pair = PrimitiveSet.concatenate([make_box(), make_box((0.5, 0, 0))])
    assert union_volume(pair) == pytest.approx(1.5)
    assert union_volume(PrimitiveSet.empty(), (np.zeros(3), np.ones(3))) == 0


def test_cylinders_stand_along_their_axis():
    """A box along the cylinder's local Y holds it: together they are no more than the box."""
    turn = (0.0, 0.0, np.sin(0.3), np.cos(0.3))
    rod = PrimitiveSet.concatenate(
        [make_cylinder((1, 2, 3), 0.4, 5.0, turn), make_box((1, 2, 3), (0.9, 5, 0.9), turn)]
    )
    assert union_volume(rod) == pytest.approx(0.9 * 0.9 * 5)


def test_half_spaces_fill_their_side_of_the_bounds():
    bounds = (np.zeros(3), np.array([2.0, 4.0, 2.0]))
    assert union_volume(make_half_space((0, 1, 0)), bounds) == pytest.approx(4)
    upside_down = make_half_space((0, 1, 0), (1, 0, 0, 0))
    assert union_volume(upside_down, bounds) == pytest.approx(12)


def test_iou_and_volume_error_are_exact():
    surface = surface_of(box((2, 1, 1)))
    assert compare_volumes(make_box((0, 0, 0), (2, 1, 1)), surface).iou == pytest.approx(1)
    shifted = compare_volumes(make_box((0.5, 0, 0), (2, 1, 1)), surface)
    assert shifted.iou == pytest.approx(1.5 / 2.5)
    assert shifted.error == pytest.approx(0, abs=1e-9)
    half = compare_volumes(make_box((0.5, 0, 0), (1, 1, 1)), surface)
    assert (half.iou, half.error) == (pytest.approx(0.5), pytest.approx(0.5))
    assert (half.mesh, half.set) == (pytest.approx(2), pytest.approx(1))
    apart = compare_volumes(make_box((9, 0, 0)), surface)
    assert apart.iou == 0


def test_the_table_of_five_boxes_is_matched_exactly():
    surface = surface_of(*(box(*part) for part in TABLE))
    same = PrimitiveSet.concatenate([make_box(center, size) for size, center in TABLE])
    assert compare_volumes(same, surface).iou == pytest.approx(1, abs=1e-9)
    assert compare_volumes(same.select(np.arange(4)), surface).iou == pytest.approx((0.228 - 0.007) / 0.228)


def test_a_room_with_thick_walls_is_solid_only_in_its_walls():
    surface = surface_of(box((3, 3, 3)), box((2, 2, 2))[:, ::-1])
    air = find_air(surface)
    walls = [make_box((x, 0, 0), (0.5, 3, 3)) for x in (-1.25, 1.25)]
    walls += [make_box((0, y, 0), (3, 0.5, 3)) for y in (-1.25, 1.25)]
    walls += [make_box((0, 0, z), (3, 3, 0.5)) for z in (-1.25, 1.25)]
    found = compare_volumes(PrimitiveSet.concatenate(walls), surface, air)
    assert found.mesh == pytest.approx(27 - 8)
    assert found.iou == pytest.approx(1)
    assert compare_volumes(make_box((0, 0, 0), (3, 3, 3)), surface, air).iou == pytest.approx(19 / 27)


def test_a_room_without_outer_walls_bounds_no_solid():
    surface = surface_of(box((2, 2, 2))[:, ::-1])
    found = compare_volumes(make_box(), surface, find_air(surface))
    assert found.iou is None
    assert "around the air" in found.reason


def test_parts_of_one_object_in_several_instances_close_together():
    """One object in two materials is two instances, each open alone."""
    whole = box((1, 1, 1))
    surface = from_triangles(whole)
    object.__setattr__(surface, "instance", np.array([0] * 5 + [1] * 7, np.int32))
    assert mesh_volume(surface)[0] == pytest.approx(1)


@pytest.mark.parametrize(
    ("asset", "closed"), [("Fandisk", True), ("Spot", True), ("Sponza", False), ("RTXGI_Cornell", False)]
)
def test_real_meshes_against_trimesh(shared_assets, asset, closed):
    (path,) = sorted(p for p in (shared_assets / asset).iterdir() if p.suffix in (".gltf", ".glb"))[:1]
    surface = from_scene(load(path))
    volume, reason = mesh_volume(surface)
    assert (volume is not None) == closed, reason
    if closed:
        center = surface.vertices - surface.center
        signed = np.einsum("ti,ti->t", center[:, 0], np.cross(center[:, 1], center[:, 2])).sum() / 6
        assert volume == pytest.approx(abs(signed), rel=1e-3)


def inside_the_shelf(points):
    """The mesh of `shelf`, in closed form: two boxes that overlap, a ball cut by neither."""
    boxes = [((2, 1, 1), (0, 0, 0)), ((1, 2, 0.5), (0.8, 0.4, 0.1))]
    inside = np.linalg.norm(points - (-1.6, 0.2, 0), axis=1) <= 0.4
    for size, center in boxes:
        inside |= (np.abs(points - center) <= np.array(size) / 2).all(axis=1)
    return inside


@pytest.fixture(scope="module")
def shelf():
    """Two overlapping boxes and a fine ball, in one mesh."""
    ball = trimesh.creation.icosphere(5, 0.4)
    ball.apply_translation((-1.6, 0.2, 0))
    return surface_of(box((2, 1, 1)), box((1, 2, 0.5), (0.8, 0.4, 0.1)), np.array(ball.triangles))


@pytest.mark.parametrize("seed", range(3))
def test_every_volume_agrees_with_sampling_within_its_error(shelf, seed):
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(5, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    places = rng.uniform((-1.6, -0.5, -0.4), (1.2, 1.0, 0.4), (5, 3))
    primitives = PrimitiveSet.concatenate(
        [make_box(places[i], rng.uniform(0.3, 1.2, 3), turns[i]) for i in range(2)]
        + [make_sphere(place, rng.uniform(0.2, 0.6)) for place in places[2:4]]
        + [make_cylinder(places[4], 0.3, 1.5, turns[4])]
    )
    found = compare_volumes(primitives, shelf)
    lower, upper = np.array([-3.0, -2.5, -2.0]), np.array([3.0, 2.5, 2.0])
    count = 400_000
    points = rng.uniform(lower, upper, (count, 3))
    in_mesh, in_set = inside_the_shelf(points), union_distance(primitives, points)[0] <= 0
    whole = np.prod(upper - lower)
    for name, inside in {
        "mesh": in_mesh,
        "set": in_set,
        "intersection": in_mesh & in_set,
        "symmetric_difference": in_mesh ^ in_set,
    }.items():
        share = inside.mean()
        error = whole * np.sqrt(share * (1 - share) / count)
        assert getattr(found, name) == pytest.approx(whole * share, abs=4 * error + 1e-3), name
    either = found.mesh + found.set - found.intersection
    assert found.iou == pytest.approx(found.intersection / either)
    assert found.symmetric_difference == pytest.approx(either - found.intersection)


@pytest.mark.parametrize("segments", [32, 64, 128, 256])
def test_tessellation_costs_a_round_primitive_none_of_its_volume(segments, monkeypatch):
    monkeypatch.setattr("fit.volume.SEGMENTS", segments)
    assert union_volume(make_sphere((1, 2, 3), 0.7)) == pytest.approx(4 / 3 * np.pi * 0.7**3, rel=1e-9)
    assert union_volume(make_cylinder((1, 2, 3), 0.7, 0.2)) == pytest.approx(np.pi * 0.7**2 * 0.2, rel=1e-9)


def test_what_a_fine_ball_shares_with_its_sphere_is_nearly_all():
    surface = from_triangles(np.array(trimesh.creation.icosphere(6, 0.5).triangles))
    found = compare_volumes(make_sphere((0, 0, 0), 0.5), surface)
    assert found.iou > 0.9995
    assert found.set == pytest.approx(np.pi / 6, rel=1e-9)


def test_an_open_mesh_has_a_reason_and_the_set_still_a_volume():
    found = compare_volumes(make_box((0, 0, 0), (2, 1, 1)), from_triangles(box((1, 1, 1))[:-1]))
    assert (found.mesh, found.intersection, found.symmetric_difference, found.iou, found.error) == (None,) * 5
    assert found.set == pytest.approx(2)
    assert found.reason == "the mesh is open"


def test_volumes_scale_by_the_cube_of_the_unit():
    found = compare_volumes(make_box((0.5, 0, 0), (2, 1, 1)), surface_of(box((2, 1, 1)))).in_units(10.0)
    assert (found.mesh, found.set) == (pytest.approx(2000), pytest.approx(2000))
    assert (found.intersection, found.symmetric_difference) == (pytest.approx(1500), pytest.approx(1000))
    assert found.iou == pytest.approx(0.6)
