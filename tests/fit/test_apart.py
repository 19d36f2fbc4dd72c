"""What moves is fitted apart from what stands, congruent bodies once, within one budget."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fit.apart import budgets, find_bodies
from fit.primitives import make_box
from fit.scene import Animation, Curve, Instance, Motion, Node
from fit.sdf import union_distance
from fit.settings import FitSettings
from fit.solve import fit

ONE = Curve(np.zeros(1), np.ones((1, 3)))
UPRIGHT = Curve(np.zeros(1), np.array([[0.0, 0.0, 0.0, 1.0]]))


def at(x, y, z):
    place = np.eye(4)
    place[:3, 3] = (x, y, z)
    return place


def slide(node):
    return Motion(node, Curve(np.array([0.0, 1.0]), np.array([[0.0, 0, 0], [0, 0, 5]])), UPRIGHT, ONE)


@pytest.fixture
def court(mesh_of_boxes):
    """A floor, and two cubes of one mesh that two nodes move, 4 m apart; a third stands."""
    cubes = mesh_of_boxes(make_box((0, 0, 0), (8, 0.2, 8)))
    slab, cube = cubes.meshes[0], replace(cubes.meshes[0], name="cube")
    places = (at(0, 0, 0), at(-2, 0.6, 0), at(2, 0.6, 0), at(0, 0.6, 3))
    nodes = tuple(Node(f"node {i}", -1, place, place) for i, place in enumerate(places))
    floor = places[0] @ np.diag([8.0, 0.2, 8.0, 1.0])
    instances = (
        Instance(0, 0, floor, np.diag([8.0, 0.2, 8.0, 1.0])),
        *(Instance(1, i, places[i]) for i in (1, 2, 3)),
    )
    return replace(
        cubes,
        meshes=(slab, cube),
        nodes=nodes,
        instances=instances,
        animations=(Animation("slide", (slide(1), slide(2))),),
    )


def test_bodies_are_what_moves_and_what_stands(court):
    moving, standing = find_bodies(court)
    assert (moving.nodes, moving.instances) == ((1, 2), (1,))
    assert [place[:3, 3].tolist() for place in moving.places] == [[-2, 0.6, 0], [2, 0.6, 0]]
    assert moving.area == pytest.approx(6)
    assert np.array_equal(moving.scene.instances[0].world_from_local, np.eye(4))
    assert (standing.nodes, standing.instances) == ((-1,), (0, 3))


def test_a_scene_at_rest_is_one_whole(court):
    assert find_bodies(replace(court, animations=())) == ()


def test_instances_that_stand_are_bodies_where_asked_for(court):
    still = replace(court, animations=())
    cubes, floor = find_bodies(still, instancing=True)
    assert (cubes.nodes, len(cubes.places), floor.instances) == ((-1, -1, -1), 3, (0,))


def test_other_sizes_are_other_bodies_and_mirrors_stay_mirrored(court):
    larger = at(2, 0.6, 0) @ np.diag([-2.0, 2.0, 2.0, 1.0])
    nodes = (*court.nodes[:2], Node("node 2", -1, larger, larger), court.nodes[3])
    instances = (*court.instances[:2], Instance(1, 2, larger), court.instances[3])
    bodies = find_bodies(replace(court, nodes=nodes, instances=instances))
    assert [body.nodes for body in bodies] == [(1,), (2,), (-1,)]
    turn = bodies[1].places[0][:3, :3]
    assert np.linalg.det(turn) == pytest.approx(1)
    assert np.linalg.det(bodies[1].scene.instances[0].world_from_local[:3, :3]) == pytest.approx(-8)


def test_a_budget_is_shared_and_drops_the_smallest_where_it_must(court):
    bodies = find_bodies(court)
    assert budgets(bodies, FitSettings()) == [None, None]
    for most in (3, 10, 40):
        each, rest = budgets(bodies, FitSettings(max_primitives=most))
        assert 2 * each + rest <= most and min(each, rest) >= 1
    assert rest > each
    assert budgets(bodies, FitSettings(max_primitives=2)) == [0, 2]


def test_a_fit_knows_what_moves_with_which_node(court):
    result = fit(court, FitSettings(max_primitives=4, resolution=60))
    primitives = result.primitives.validate()
    assert sorted(primitives.nodes) == [-1, -1, 1, 2]
    cubes = [primitives.select([primitives.nodes.index(node)]) for node in (1, 2)]
    assert np.allclose(cubes[1].positions - cubes[0].positions, (4, 0, 0))
    assert np.allclose(np.sort(cubes[0].sizes), 1, atol=0.03)
    corners = np.array([(-1.5, 0.6, 0), (2, 1.1, 0), (0, 1.1, 3), (3.9, 0.1, 3.9)])
    assert np.abs(union_distance(primitives, corners)[0]).max() < 0.05
    assert result.metrics.covered_half_pct > 0.95
    assert len(result.errors) == 4


def test_a_budget_too_small_says_what_it_left_out(court):
    result = fit(court, FitSettings(max_primitives=2, resolution=60))
    assert set(result.primitives.nodes) == {-1}
    assert "node 1: no primitive, the budget has no room for so many bodies" in result.notes
