"""Signed distances against independent methods, at all scales; gradients; samples of the boundary."""

from __future__ import annotations

import time
import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from fit import rotation, sdf
from fit.primitives import (
    FACES,
    PrimitiveSet,
    make_box,
    make_cylinder,
    make_half_space,
    make_plane,
    make_sphere,
)

seeds = st.integers(0, 2**32 - 1)
scales = st.floats(-4, 5).map(lambda e: 10.0**e)
aspects = st.floats(0, 4).map(lambda e: 10.0**-e)

KINDS = ("box", "sphere", "cylinder", "plane", "half_space")


def turned(rng: np.random.Generator) -> np.ndarray:
    return rotation.normalized(rng.normal(size=4))


def make(kind: str, rng: np.random.Generator, scale: float = 1.0, aspect: float = 0.5, far: float = 3.0):
    """One primitive of a kind, about `scale` large, `aspect` times as thin, `far` times its size away."""
    position, turn = rng.normal(size=3) * scale * far, turned(rng)
    sizes = scale * rng.permutation([1.0, aspect, np.sqrt(aspect)])
    if kind == "box":
        return make_box(position, sizes, turn)
    if kind == "sphere":
        return make_sphere(position, scale / 2)
    if kind == "cylinder":
        return make_cylinder(position, sizes[0] / 2, sizes[1], turn)
    if kind == "plane":
        return make_plane(position, scale, scale * np.sqrt(aspect), 0.04 * scale * aspect, turn)
    return make_half_space(position, turn)


def points_about(
    primitive: PrimitiveSet, rng: np.random.Generator, count: int = 200, scale: float = 1.0
) -> np.ndarray:
    """World points around, in and close to one primitive, with local coordinates of 0 among them."""
    size = np.where(primitive.is_half_space[0], scale, primitive.sizes[0])
    local = rng.normal(size=(count, 3)) * size * rng.choice([0.2, 1.0, 5.0], size=(count, 1))
    local[rng.random((count, 3)) < 0.1] = 0
    return local @ primitive.rotation_matrices()[0].T + primitive.positions[0]


def local_points(primitive: PrimitiveSet, points: np.ndarray) -> np.ndarray:
    return (points - primitive.positions[0]) @ primitive.rotation_matrices()[0]


def distance_by_segments(p: np.ndarray, radius: float, half_height: float) -> np.ndarray:
    """Distance to a cylinder by its profile, three segments in the half-plane (distance to axis, height)."""
    flat = np.stack([np.hypot(p[:, 0], p[:, 2]), p[:, 1]], axis=1)
    r, h = radius, half_height
    ends = np.array([[[0, h], [r, h]], [[0, -h], [r, -h]], [[r, -h], [r, h]]], float)
    best = np.full(len(p), np.inf)
    for a, b in ends:
        t = np.clip((flat - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        best = np.minimum(best, np.linalg.norm(flat - a - t[:, None] * (b - a), axis=1))
    inside = (flat[:, 0] < r) & (np.abs(flat[:, 1]) < h)
    return np.where(inside, -best, best)


def distance_by_clamping(p: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Distance to a box: to the nearest of its points outside, to the nearest of its faces inside."""
    outside = np.linalg.norm(p - np.clip(p, -half, half), axis=1)
    return np.where(outside > 0, outside, -np.min(half - np.abs(p), axis=1))


@pytest.mark.parametrize("kind", KINDS)
@given(seed=seeds, scale=scales, aspect=aspects)
@settings(max_examples=60, deadline=None)
def test_distance_is_exact_at_all_scales(kind, seed, scale, aspect):
    """The distance is the independent method's, and its sign is that of containment."""
    rng = np.random.default_rng(seed)
    primitive = make(kind, rng, scale, aspect)
    points = points_about(primitive, rng, scale=scale)
    p, half = local_points(primitive, points), primitive.sizes[0] / 2
    if kind == "sphere":
        expected = np.sqrt(np.sum(p * p, axis=1)) - half[0]
    elif kind == "cylinder":
        expected = distance_by_segments(p, half[0], half[1])
    elif kind == "half_space":
        expected = p[:, 1]
    else:
        expected = distance_by_clamping(p, half)
    found = sdf.distance(primitive, points)[:, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-14 * scale * 10)


@given(seed=seeds)
@settings(max_examples=25, deadline=None)
def test_box_distance_is_that_of_its_triangles(seed):
    """Against trimesh's nearest point on the triangulated box, which is exact."""
    rng = np.random.default_rng(seed)
    box = make("box", rng, aspect=rng.uniform(0.02, 1))
    points = points_about(box, rng, 60)
    mesh = trimesh.creation.box(extents=box.sizes[0])
    p = local_points(box, points)
    _, expected, _ = trimesh.proximity.closest_point_naive(mesh, p)
    inside = np.all(np.abs(p) < box.sizes[0] / 2, axis=1)
    found = sdf.distance(box, points)[:, 0]
    np.testing.assert_allclose(found, np.where(inside, -expected, expected), atol=1e-7)


@pytest.mark.parametrize("kind", ["sphere", "cylinder"])
@given(seed=seeds)
@settings(max_examples=5, deadline=None)
def test_round_distance_is_that_of_dense_samples(kind, seed):
    """Against brute force over a dense boundary: never more than it, and less by the samples' gap at most."""
    rng = np.random.default_rng(seed)
    primitive = make(kind, rng, aspect=0.4)
    half = primitive.sizes[0] / 2
    angle, gap = np.linspace(0, 2 * np.pi, 300, endpoint=False), 2 * np.pi / 300
    if kind == "sphere":
        polar = np.linspace(0, np.pi, 151)
        profile = np.stack([np.sin(polar), np.cos(polar)], axis=1) * half[0]
    else:
        step = np.linspace(0, 1, 151)[:, None]
        r, h = half[0], half[1]
        corners = np.array([[0, -h], [r, -h], [r, h], [0, h]])
        profile = np.concatenate([a + step * (b - a) for a, b in pairwise(corners)])
    ring = np.stack([np.cos(angle), np.ones_like(angle), np.sin(angle)], axis=1)
    boundary = (profile[:, None, [0, 1, 0]] * ring[None]).reshape(-1, 3)
    points = points_about(primitive, rng, 40)
    p = local_points(primitive, points)
    nearest = np.array([np.min(np.linalg.norm(boundary - q, axis=1)) for q in p])
    found = np.abs(sdf.distance(primitive, points)[:, 0])
    assert np.all(found <= nearest + 1e-12)
    assert np.all(nearest <= found + gap * max(half))


@pytest.mark.parametrize("kind", KINDS)
@given(seed=seeds, scale=scales, aspect=aspects)
@settings(max_examples=40, deadline=None)
def test_distance_is_1_lipschitz(kind, seed, scale, aspect):
    rng = np.random.default_rng(seed)
    primitive = make(kind, rng, scale, aspect)
    a, b = points_about(primitive, rng, scale=scale), points_about(primitive, rng, scale=scale)
    change = np.abs(sdf.distance(primitive, a) - sdf.distance(primitive, b))[:, 0]
    assert np.all(change <= np.linalg.norm(a - b, axis=1) * (1 + 1e-12) + 1e-13 * scale)


@pytest.mark.parametrize("kind", KINDS)
@given(seed=seeds, scale=scales, aspect=aspects)
@settings(max_examples=60, deadline=None)
def test_gradient_leads_to_the_boundary(kind, seed, scale, aspect):
    """p - d grad d is on the boundary, for medial points too, and the gradient has unit length."""
    rng = np.random.default_rng(seed)
    primitive = make(kind, rng, scale, aspect, far=0)
    points = points_about(primitive, rng, scale=scale)
    d = sdf.distance(primitive, points)[:, 0]
    g = sdf.gradient(primitive, points, np.zeros(len(points), int))
    np.testing.assert_allclose(np.linalg.norm(g, axis=1), 1, atol=1e-12)
    landed = sdf.distance(primitive, points - d[:, None] * g)[:, 0]
    assert np.abs(landed).max() <= 1e-13 * (scale + np.abs(points).max())


@pytest.mark.parametrize("kind", KINDS)
@given(seed=seeds)
@settings(max_examples=30, deadline=None)
def test_gradient_is_the_finite_difference(kind, seed):
    rng = np.random.default_rng(seed)
    primitive = make(kind, rng)
    points = points_about(primitive, rng)
    step = 1e-6
    g = sdf.gradient(primitive, points, np.zeros(len(points), int))
    differences = [
        sdf.distance(primitive, points + step * e) - sdf.distance(primitive, points - step * e)
        for e in np.eye(3)
    ]
    numeric = np.concatenate(differences, axis=1) / (2 * step)
    # Where two faces are equally near there is a crease, and a difference across it is shorter than 1. Beside
    # an axis the direction turns within a step.
    smooth = np.abs(np.linalg.norm(numeric, axis=1) - 1) < 1e-7
    assert smooth.mean() > 0.6
    np.testing.assert_allclose(g[smooth], numeric[smooth], atol=1e-3)


def test_gradient_takes_the_documented_side_on_medial_axes():
    primitives = PrimitiveSet.concatenate(
        [make_box(), make_sphere(), make_cylinder(radius=0.5, height=1), make_box(size=(2, 1, 1))]
    )
    g = sdf.gradient(primitives, np.zeros((4, 3)), np.arange(4))
    np.testing.assert_array_equal(g, [[1, 0, 0], [1, 0, 0], [1, 0, 0], [0, 1, 0]])
    corner = sdf.gradient(primitives, [[0.5, 0.5, 0.5]], [0])
    np.testing.assert_array_equal(corner, [[1, 0, 0]])


@pytest.mark.parametrize("kind", KINDS)
@given(seed=seeds, aspect=aspects)
@settings(max_examples=20, deadline=None)
def test_distance_moves_with_the_primitive(kind, seed, aspect):
    rng = np.random.default_rng(seed)
    primitive = make(kind, rng, aspect=aspect)
    points = points_about(primitive, rng)
    matrix = np.eye(4)
    matrix[:3, :3] = rotation.matrices_from_quaternions(turned(rng))
    matrix[:3, 3] = rng.normal(size=3)
    moved = points @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(
        sdf.distance(primitive.transformed(matrix), moved), sdf.distance(primitive, points), atol=1e-13
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("offset", [1e3, 1e6])
def test_distance_keeps_its_digits_far_from_the_origin(kind, offset):
    """What is lost is the position's own last digit, not a product of rotation and offset."""
    rng = np.random.default_rng(3)
    primitive = make(kind, rng, scale=1e-2)
    points = points_about(primitive, rng)
    moved = np.eye(4)
    moved[:3, 3] = offset
    change = sdf.distance(primitive.transformed(moved), points + offset) - sdf.distance(primitive, points)
    assert np.abs(change).max() <= 4 * np.spacing(offset)


@pytest.mark.parametrize("kind", KINDS)
@given(seed=seeds, scale=scales, aspect=aspects)
@settings(max_examples=40, deadline=None)
def test_float32_agrees_with_float64(kind, seed, scale, aspect):
    """The `sd_` functions keep float32, and are off by a few of its last digits of the largest length."""
    rng = np.random.default_rng(seed)
    primitive = make(kind, rng, scale, aspect)
    p = local_points(primitive, points_about(primitive, rng)).astype(np.float32)
    half = np.minimum(primitive.sizes[0] / 2, 1e30).astype(np.float32)

    def evaluate(q, h):
        return {
            "sphere": lambda: sdf.sd_sphere(q, h[0]),
            "cylinder": lambda: sdf.sd_cylinder(q, h[0], h[1]),
            "half_space": lambda: sdf.sd_half_space(q),
        }.get(kind, lambda: sdf.sd_box(q, h))()

    single, double = evaluate(p, half), evaluate(p.astype(float), half.astype(float))
    assert single.dtype == np.float32
    reach = np.abs(p).max(axis=1) + (0 if kind == "half_space" else half.max())
    assert np.all(np.abs(single - double) <= 4 * np.finfo(np.float32).eps * reach)


def many(count: int, seed: int = 0) -> PrimitiveSet:
    rng = np.random.default_rng(seed)
    return PrimitiveSet.concatenate([make(KINDS[i % 4], rng, rng.uniform(0.3, 2)) for i in range(count)])


def test_union_is_the_nearest_primitive():
    primitives = PrimitiveSet.concatenate([many(11), make_half_space((0, -3, 0))])
    points = np.random.default_rng(1).normal(size=(500, 3)) * 4
    each = sdf.distance(primitives, points)
    for chunk in (None, 1, 7, 10_000):
        d, index = sdf.union_distance(primitives, points, chunk)
        np.testing.assert_array_equal(d, each.min(axis=1))
        np.testing.assert_array_equal(index, each.argmin(axis=1))
    assert len(set(index.tolist())) > 8 and 11 in index


def test_union_of_nothing_is_infinitely_far():
    d, index = sdf.union_distance(PrimitiveSet.empty(), np.zeros((3, 3)))
    assert np.all(d == np.inf) and np.all(index == sdf.NO_PRIMITIVE)
    assert sdf.distance(PrimitiveSet.empty(), np.zeros((3, 3))).shape == (3, 0)
    d, index = sdf.union_distance(make_box(), np.zeros((0, 3)))
    assert d.shape == index.shape == (0,)


def test_union_is_fast_and_takes_little_memory():
    """43 primitives, the paper's Sponza, at 100,000 points."""
    primitives, points = many(43), np.random.default_rng(0).normal(size=(100_000, 3)) * 3
    start = time.process_time()
    sdf.union_distance(primitives, points)
    assert time.process_time() - start < 1.0
    large = PrimitiveSet.concatenate([primitives] * 46)
    tracemalloc.start()
    try:
        sdf.union_distance(large, points[:4000])  # all pairs at once are 64 MB
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()


def test_points_of_a_wrong_shape_are_refused():
    with pytest.raises(ValueError, match=r"\(3,\); \(p, 3\) is needed"):
        sdf.distance(make_box(), [0, 0, 0])


def test_primitive_face_is_where_the_normal_points():
    primitives = many(40)
    points, normals, index = sdf.sample_boundary(primitives, 5000, 0)
    face = sdf.primitive_face(primitives, points, index)
    local = np.einsum("pji,pj->pi", primitives.rotation_matrices()[index], normals)
    straight = np.isin(primitives.kinds[index], (0, 3))
    axis = np.argmax(np.abs(local), axis=1)
    expected = 2 * axis + (local[np.arange(len(local)), axis] < 0)
    np.testing.assert_array_equal(face[straight], expected[straight])
    assert set(face[straight].tolist()) == set(range(6))
    cylinder = primitives.kinds[index] == 2
    capped = np.where(np.abs(local[:, 1]) > 0.5, expected, 0)
    np.testing.assert_array_equal(face[cylinder], capped[cylinder])
    assert set(face[cylinder].tolist()) == {0, 2, 3}
    assert np.all(face[primitives.kinds[index] == 1] == 0)
    ground = sdf.primitive_face(make_half_space(), [[3.0, 0, 7], [0, -9, 0]], [0, 0])
    assert [FACES[f] for f in ground] == ["+y", "+y"]


def test_primitive_face_tells_the_sides_of_a_thin_wall_apart():
    wall = make_plane(size_x=4, size_z=3, thickness=0.01, rotation=turned(np.random.default_rng(0)))
    up = wall.rotation_matrices()[0][:, 1]
    hits = np.outer([0.005 + 1e-7, 0.005 - 1e-7, -0.005 + 1e-7, -0.005 - 1e-7], up)
    assert sdf.primitive_face(wall, hits, np.zeros(4, int)).tolist() == [2, 2, 3, 3]


@given(seed=seeds)
@settings(max_examples=10, deadline=None)
def test_samples_lie_on_the_boundary_with_their_normals(seed):
    primitives = PrimitiveSet.concatenate([many(8, seed), make_half_space((0, 1, 0))])
    points, normals, index = sdf.sample_boundary(primitives, 2000, seed, half_space_size=5.0)
    rows = np.arange(len(points))
    assert np.abs(sdf.distance(primitives, points)[rows, index]).max() < 1e-13
    assert np.abs(sdf.distance(primitives, points + 1e-3 * normals)[rows, index] - 1e-3).max() < 1e-13
    assert np.all(np.diff(index) >= 0)
    again = sdf.sample_boundary(primitives, 2000, seed, half_space_size=5.0)
    np.testing.assert_array_equal(points, again[0])


def test_samples_are_uniform_by_area():
    """Counts by face against areas, and moments within each face."""
    count = 200_000
    box = make_box(size=(1, 2, 4))
    points, normals, _ = sdf.sample_boundary(box, count, 0)
    face = 2 * np.argmax(np.abs(normals), axis=1) + (normals.sum(axis=1) < 0)
    share = np.bincount(face, minlength=6) / count
    np.testing.assert_allclose(share, box.face_areas()[0] / 28, atol=0.004)
    np.testing.assert_allclose(points.mean(axis=0), 0, atol=0.02)
    big = face == 0
    np.testing.assert_allclose(np.mean(points[big] ** 2, axis=0), [0.25, 4 / 12, 16 / 12], rtol=0.02)
    cylinder = make_cylinder(radius=1, height=2)
    points, normals, _ = sdf.sample_boundary(cylinder, count, 0)
    top, bottom = normals[:, 1] > 0.5, normals[:, 1] < -0.5
    np.testing.assert_allclose([top.mean(), bottom.mean()], 1 / 6, atol=0.004)
    np.testing.assert_allclose(np.mean(points[top, 0] ** 2 + points[top, 2] ** 2), 0.5, rtol=0.02)
    side = ~(top | bottom)
    np.testing.assert_allclose(np.mean(points[side] ** 2, axis=0), [0.5, 1 / 3, 0.5], rtol=0.02)
    sphere, _, _ = sdf.sample_boundary(make_sphere(radius=1), count, 0)
    np.testing.assert_allclose(np.cov(sphere.T), np.eye(3) / 3, atol=0.004)
    pair = PrimitiveSet.concatenate([make_sphere(radius=1), make_sphere((9, 0, 0), 2), make_half_space()])
    _, _, index = sdf.sample_boundary(pair, count, 0)
    np.testing.assert_allclose(np.bincount(index, minlength=3) / count, [0.2, 0.8, 0], atol=0.004)


def test_sampling_without_area_is_refused():
    with pytest.raises(ValueError, match="give half_space_size"):
        sdf.sample_boundary(make_half_space(), 10, 0)
    points, _, _ = sdf.sample_boundary(make_half_space((0, 2, 0)), 1000, 0, half_space_size=6.0)
    assert np.all(points[:, 1] == 2) and 2.9 < np.abs(points[:, [0, 2]]).max() <= 3


def test_areas_and_volumes_are_those_of_meshes():
    primitives = PrimitiveSet.concatenate(
        [
            make_box(size=(1, 2, 3)),
            make_sphere(radius=2),
            make_cylinder(radius=0.5, height=3),
            make_plane(size_x=2, size_z=1, thickness=0.05),
        ]
    )
    meshes = [
        trimesh.creation.box((1, 2, 3)),
        trimesh.creation.icosphere(5, 2.0),
        trimesh.creation.cylinder(0.5, 3.0, sections=1024),
        trimesh.creation.box((2, 0.05, 1)),
    ]
    np.testing.assert_allclose(sdf.boundary_area(primitives), [m.area for m in meshes], rtol=1e-3)
    np.testing.assert_allclose(sdf.volume(primitives), [m.volume for m in meshes], rtol=1e-3)
    assert sdf.boundary_area(make_half_space(), 3.0)[0] == 9 and sdf.boundary_area(make_half_space())[0] == 0
    assert sdf.volume(make_half_space())[0] == np.inf
