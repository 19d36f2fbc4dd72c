"""The fit of closed bodies: what is inside, how steps descend, and how much of a body a few solids fill."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from fit.air import find_air
from fit.bodies import fit_body, of_moments, other_kinds
from fit.descend import descend_together
from fit.inscribe import inscribe
from fit.occupancy import Occupancy, difference, distance_table, nearest, sample_occupancy
from fit.primitives import Kind
from fit.shapes import Shapes, distances_to_one, join, make_shapes, to_primitives
from fit.solid import Solid, find_solid
from fit.spaces import Air
from fit.surface import from_triangles
from fit.volume import compare_volumes


def body_of(*meshes: trimesh.Trimesh) -> tuple[Solid, Air]:
    corners = np.concatenate([mesh.triangles for mesh in meshes])
    air = find_air(from_triangles(corners), resolution=70)
    solid = find_solid(air)
    assert solid is not None
    return solid, air


def block(size: tuple[float, float, float], at: tuple[float, float, float] = (0, 0, 0)) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(at)
    return mesh


def iou_of(shapes: Shapes, air: Air) -> float:
    iou = compare_volumes(to_primitives(shapes), air.walls, air).iou
    assert iou is not None
    return iou


@pytest.fixture(scope="module")
def bent() -> tuple[Solid, Air]:
    """Two overlapping blocks, one of them tilted, and a ball."""
    tilted = block((1.6, 0.3, 0.4))
    tilted.apply_transform(trimesh.transformations.rotation_matrix(0.5, (0, 0, 1), (0, 0, 0)))
    ball = trimesh.creation.icosphere(3, 0.45)
    ball.apply_translation((-0.9, -0.3, 0))
    return body_of(tilted, block((0.4, 1.2, 0.4), (0.6, -0.2, 0.0)), ball)


def test_inside_of_overlapping_shells_is_their_union(bent: tuple[Solid, Air]) -> None:
    solid, _ = bent
    points = np.array([[0.6, 0.3, 0.0], [0.0, 0.0, 0.0], [-0.9, -0.3, 0.4], [0.0, 0.6, 0.0], [0.6, 0.3, 0.5]])
    assert solid.inside(points).tolist() == [True, True, True, False, False]
    assert solid.distances(points[3:4])[0] > 0 > solid.distances(points[:1])[0]


def test_open_sheets_have_no_solid() -> None:
    lid_off = trimesh.creation.box((1, 1, 1))
    air = find_air(from_triangles(lid_off.triangles[2:]), resolution=60)
    assert find_solid(air) is None


def test_difference_is_the_volume_in_which_set_and_solid_differ(bent: tuple[Solid, Air]) -> None:
    solid, air = body_of(block((1.0, 0.8, 0.6)))
    occupancy = sample_occupancy(solid, air, 8000, 2000, 0)
    larger = make_shapes(Kind.BOX, np.zeros((1, 3)), np.eye(3), np.array([0.52, 0.4, 0.3]))
    assert difference(larger, occupancy) == pytest.approx(0.04 * 0.8 * 0.6, rel=0.1)
    assert difference(larger.select(slice(0, 0)), occupancy) > 0.3 * 0.48


def test_far_distances_are_left_out_of_the_table_and_near_ones_are_exact(bent: tuple[Solid, Air]) -> None:
    solid, air = bent
    occupancy = sample_occupancy(solid, air, 4000, 1000, 0)
    shape = make_shapes(Kind.CYLINDER, np.array([[0.5, 0, 0]]), np.eye(3), np.array([0.2, 0.4, 0.2]))
    table, exact = distance_table(shape, occupancy)[0], distances_to_one(shape, 0, occupancy.points)
    near = np.isfinite(table)
    assert 0 < near.sum() < len(near)
    np.testing.assert_array_equal(table[near], exact[near])
    assert (exact[~near] > occupancy.band).all()


def test_the_nearest_shape_is_the_first_of_the_lowest_in_the_table(bent: tuple[Solid, Air]) -> None:
    occupancy = sample_occupancy(*bent, 4000, 1001, 0)
    centers = np.random.default_rng(1).uniform(-0.5, 0.5, (6, 3))
    shapes = make_shapes(Kind.BOX, np.concatenate([centers, centers[:2]]), np.eye(3), np.full(3, 0.1))
    table = distance_table(shapes, occupancy)
    owner, distances = nearest(shapes, occupancy)
    np.testing.assert_array_equal(owner, table.argmin(axis=0))
    np.testing.assert_array_equal(distances, table.min(axis=0))
    assert np.isinf(distances).any() and (np.bincount(owner) > 10)[1:6].all()


@pytest.mark.parametrize("kind", [Kind.BOX, Kind.SPHERE, Kind.CYLINDER])
def test_descent_finds_a_disturbed_solid(kind: Kind) -> None:
    mesh = {
        Kind.BOX: block((1.0, 0.6, 0.5)),
        Kind.SPHERE: trimesh.creation.icosphere(4, 0.5),
        Kind.CYLINDER: trimesh.creation.cylinder(0.4, 1.0, 64),
    }[kind]
    solid, air = body_of(mesh)
    occupancy = sample_occupancy(solid, air, 5000, 1000, 0)
    start = of_moments(occupancy.points[occupancy.inside], kind)
    assert iou_of(descend_together(start, occupancy, 30), air) > 0.985
    assert iou_of(start, air) < 0.98


def test_descent_leaves_exact_shapes_and_never_makes_worse(bent: tuple[Solid, Air]) -> None:
    solid, air = bent
    occupancy = sample_occupancy(solid, air, 4000, 1000, 0)
    held = make_shapes(Kind.BOX, np.array([[0.5, -0.1, 0]]), np.eye(3), np.array([0.2, 0.3, 0.2]), exact=True)
    free = make_shapes(Kind.SPHERE, np.array([[-0.8, -0.2, 0]]), np.eye(3), np.full(3, 0.3))
    after = descend_together(join([held, free]), occupancy, 10)
    np.testing.assert_array_equal(after.centers[0], held.centers[0])
    assert difference(after, occupancy) < difference(join([held, free]), occupancy)


def test_other_kinds_keep_the_volume_within_a_third() -> None:
    shape = make_shapes(Kind.CYLINDER, np.zeros((1, 3)), np.eye(3), np.array([0.5, 0.5, 0.5]))
    others = join(other_kinds(shape, 0))
    assert sorted(others.kinds) == [Kind.BOX, Kind.SPHERE]
    np.testing.assert_allclose(others.volumes() / shape.volumes(), 1.0, atol=0.34)


def test_boxes_inscribed_in_a_tilted_block_are_the_block() -> None:
    turn = trimesh.transformations.rotation_matrix(0.7, (1, 2, 3))
    tilted = block((1.0, 0.5, 0.3))
    tilted.apply_transform(turn)
    solid, _ = body_of(tilted)
    found = inscribe(solid, np.array([[0.05, 0.02, 0.01]]))
    boxes = found.select(found.kinds == Kind.BOX)
    np.testing.assert_allclose(np.sort(boxes.halves, axis=1), [[0.15, 0.25, 0.5]] * len(boxes), atol=1e-6)


def test_few_solids_fill_a_body(bent: tuple[Solid, Air]) -> None:
    solid, air = bent
    shapes = fit_body(solid, air, 4)
    assert len(shapes) <= 4
    assert iou_of(shapes, air) > 0.97


@pytest.mark.slow
def test_more_solids_fill_a_round_body_better_and_the_same_each_time() -> None:
    torus = trimesh.creation.torus(1.0, 0.3, 48, 24)
    solid, air = body_of(torus)
    few, many = (fit_body(solid, air, count) for count in (6, 14))
    assert 0.7 < iou_of(few, air) < iou_of(many, air)
    assert iou_of(many, air) > 0.88
    again = fit_body(solid, air, 6)
    np.testing.assert_array_equal(again.centers, few.centers)


def test_thin_walls_narrow_the_band() -> None:
    thick, air = body_of(block((1, 1, 1)))
    thin, thin_air = body_of(block((1, 1, 0.01)))
    bands = [sample_occupancy(s, a, 500, 100, 0).band / a.cell for s, a in ((thick, air), (thin, thin_air))]
    assert bands[0] == 3.0
    assert bands[1] < 0.5
    assert isinstance(sample_occupancy(thin, thin_air, 500, 100, 0), Occupancy)
