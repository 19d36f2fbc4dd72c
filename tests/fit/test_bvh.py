"""Exact nearest triangles and first hits, against brute force."""

import numpy as np
import pytest
import trimesh

from fit import bvh, rays
from fit.bvh import TriangleTree, cut_long_triangles
from fit.rays import RayCaster
from fit.triangle import plane_frames


def soup(count=150, size=0.2, seed=0):
    rng = np.random.default_rng(seed)
    return rng.random((count, 1, 3)) + rng.normal(size=(count, 3, 3)) * size * rng.random((count, 1, 1)) ** 3


def brute_distance(point, triangle):
    """Distance to a triangle by projecting on its plane and its edges, one at a time."""
    a, b, c = triangle
    normal = np.cross(b - a, c - a)
    weights = np.linalg.lstsq(np.stack([b - a, c - a], axis=1), point - a, rcond=None)[0]
    if min(weights) >= 0 and sum(weights) <= 1:
        return abs((point - a) @ normal) / np.linalg.norm(normal)
    ends = [(a, b), (b, c), (c, a)]
    steps = [np.clip((point - p) @ (q - p) / ((q - p) @ (q - p)), 0, 1) for p, q in ends]
    return min(np.linalg.norm(point - p - t * (q - p)) for (p, q), t in zip(ends, steps, strict=True))


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("size", [0.05, 2.0])
def test_nearest_agrees_with_brute_force(size, offset):
    triangles = soup(size=size)
    points = np.random.default_rng(1).uniform(-1, 2, (40, 3))
    distance, triangle = TriangleTree(triangles + offset).nearest(points + offset)
    expected = np.array([[brute_distance(p, t) for t in triangles] for p in points])
    np.testing.assert_allclose(distance, expected.min(axis=1), rtol=1e-9, atol=1e-9 * max(offset, 1e-3))
    np.testing.assert_allclose(
        expected[np.arange(40), triangle], distance, rtol=1e-9, atol=1e-9 * max(offset, 1e-3)
    )


def test_points_as_far_from_all_triangles_are_searched_part_by_part(monkeypatch):
    """From near the middle of a ball no box is nearer than the others: 3 million pairs."""
    ball = trimesh.creation.icosphere(5).triangles
    points = np.random.default_rng(0).normal(size=(150, 3)) * 1e-3
    looked_at = []
    measure = bvh.squared_distances
    monkeypatch.setattr(bvh, "squared_distances", lambda p, f: looked_at.append(len(p)) or measure(p, f))
    tree = TriangleTree(ball)
    distance, triangle = tree.nearest(points)
    assert sum(looked_at) > 2 * bvh._PAIRS_AT_ONCE
    assert max(looked_at[2:]) <= bvh.BRANCHES * bvh._PAIRS_AT_ONCE
    frames = plane_frames(ball - tree.center)
    exact = [measure(np.broadcast_to(p - tree.center, (len(ball), 3)), frames) for p in points]
    np.testing.assert_array_equal(distance, np.sqrt([e.min() for e in exact]))
    assert all(e[t] == e.min() for e, t in zip(exact, triangle, strict=True))


def test_what_is_near_is_found_whatever_else_is_not_looked_for():
    triangles, points = soup(), np.random.default_rng(1).uniform(-2, 3, (400, 3))
    tree = TriangleTree(triangles)
    exact, triangle = tree.nearest(points)
    distance, found = tree.nearest(points, within=1.0)
    near = exact < 1.0
    assert 10 < near.sum() < 390
    np.testing.assert_array_equal(distance[near], exact[near])
    np.testing.assert_array_equal(found[near], triangle[near])
    assert (distance[~near] >= exact[~near]).all()


def test_nearest_on_needles_and_slivers_keeps_its_digits():
    needle = np.array([[[0, 0, 0], [1e4, 0, 0], [5e3, 1e-3, 0]]], float)
    points = np.array([[5e3, -1.0, 0], [5e3, 5e-4, 2.0], [-3.0, 4.0, 0.0], [1e4 + 1, 0, 0]])
    np.testing.assert_allclose(TriangleTree(needle).nearest(points)[0], [1, 2, 5, 1], rtol=1e-9)


def test_triangles_that_rounding_flattens_count_as_segments_and_points():
    far = 1e6 + np.array([[[0, 0, 0], [0, 0, 0], [0, 3, 0]], [[9, 0, 0], [9, 0, 0], [9, 0, 0]]], float)
    distance, triangle = TriangleTree(far).nearest(1e6 + np.array([[2.0, 1, 0], [9, 0, 4]]))
    np.testing.assert_allclose(distance, [2, 4])
    assert triangle.tolist() == [0, 1]


@pytest.mark.parametrize("use_embree", [True, False])
def test_first_hits_agree_with_brute_force(use_embree):
    if use_embree and rays.EmbreeScene is None:
        pytest.skip("embreex is not installed on this platform")
    triangles = soup(300, 0.4)
    rng = np.random.default_rng(2)
    origins, directions = rng.uniform(-0.5, 1.5, (400, 3)), unit(rng.normal(size=(400, 3)))
    tree = TriangleTree(triangles)
    distance, triangle = RayCaster(triangles, tree, use_embree=use_embree).first_hit(origins, directions)
    best = np.full(400, np.inf)
    for a, b, c in triangles:  # Cramer's rule, as Moller and Trumbore 1997
        p = np.cross(directions, c - a)
        determinant = p @ (b - a)
        u = np.einsum("ij,ij->i", origins - a, p) / determinant
        q = np.cross(origins - a, b - a)
        v = np.einsum("ij,ij->i", directions, q) / determinant
        t = q @ (c - a) / determinant
        best = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), np.minimum(best, t), best)
    assert 100 < np.isfinite(best).sum() < 400
    np.testing.assert_array_equal(np.isfinite(distance), np.isfinite(best))
    np.testing.assert_array_equal(triangle < 0, np.isinf(best))
    np.testing.assert_allclose(distance, best, rtol=2e-5, atol=1e-6)


def test_axis_parallel_rays_hit_walls_that_lie_in_the_boxes_sides():
    wall = np.array([[[0, 0, 0], [0, 1, 0], [0, 1, 1]], [[0, 0, 0], [0, 1, 1], [0, 0, 1]]], float)
    tree = TriangleTree(wall)
    distance, _ = tree.first_hit(np.array([[-2.0, 0.5, 0.25], [-2, 2, 0.25]]), np.tile([1.0, 0, 0], (2, 1)))
    np.testing.assert_array_equal(distance, [2.0, np.inf])


def test_visible_is_blocked_by_what_lies_between_only():
    wall = np.array([[[0, -9, -9], [0, 9, -9], [0, 0, 9]]], float)
    caster = RayCaster(wall, TriangleTree(wall))
    start = np.array([[-1.0, 0, 0], [-1, 0, 0]])
    np.testing.assert_array_equal(caster.visible(start, np.array([[1.0, 0, 0], [-0.1, 0, 0]])), [False, True])


def test_cut_triangles_keep_their_area_and_owner():
    triangles = np.array([[[0, 0, 0], [8, 0, 0], [0, 6, 0]], [[0, 0, 1], [1, 0, 1], [0, 1, 1]]], float)
    pieces, owner = cut_long_triangles(triangles, longest=1.5)
    areas = np.linalg.norm(np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0]), axis=1) / 2
    np.testing.assert_allclose(np.bincount(owner, areas), [24, 0.5])
    assert np.linalg.norm(pieces - np.roll(pieces, 1, axis=1), axis=2).max() <= 1.5
    assert len(cut_long_triangles(triangles, longest=1e-3, max_extra=10)[0]) <= 12


def test_an_empty_tree_is_refused():
    with pytest.raises(ValueError, match="empty"):
        TriangleTree(np.zeros((0, 3, 3)))
