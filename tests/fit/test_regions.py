"""Regions of the surface, and the candidates that stand for them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import trimesh

from fit.air import find_air
from fit.merge_regions import hierarchy
from fit.objective import error, set_distances
from fit.partition import Samples, link, partition
from fit.primitives import Kind
from fit.regions import Regions, find_regions, propose_slabs
from fit.shapes import Shapes, distances_to_one, make_shapes, no_shapes, rotation_matrices
from fit.slabs import best_rectangle
from fit.spaces import Air
from fit.surface import from_triangles
from fit.targets import Targets, make_targets, see_surface

TILT = rotation_matrices(np.array([[0.0, 0.0, 0.2]]))[0]
"""A slope of 11 degrees that no axis of the world serves."""


def sheet(lower, upper, cuts: int = 6) -> np.ndarray:
    """Triangles (t, 3, 3) of an upward rectangle in the plane y = 0 between two corners (x, z)."""
    x, z = np.linspace(lower[0], upper[0], cuts + 1), np.linspace(lower[1], upper[1], cuts + 1)
    corner = np.stack(np.meshgrid(x, [0.0], z, indexing="ij"), axis=-1)[:, 0]
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    return np.concatenate(
        [np.stack([a, c, b], axis=2).reshape(-1, 3, 3), np.stack([a, d, c], axis=2).reshape(-1, 3, 3)]
    )


def seen_by_air(*pieces: np.ndarray) -> tuple[Air, Targets]:
    surface = from_triangles(np.concatenate(pieces))
    air = find_air(surface, resolution=90, seeds=("outside",))
    seen = see_surface(air, 1200, 0)
    return air, make_targets(seen, air, seen.weights, 2000, 0)


def mesh_triangles(mesh: trimesh.Trimesh, at=(0, 0, 0)) -> np.ndarray:
    return np.array(mesh.triangles, np.float64) + at


def best_alone(candidates: Shapes, targets: Targets) -> Shapes:
    errors = [error(candidates.select(np.array([i])), targets) for i in range(len(candidates))]
    return candidates.select(np.array([int(np.argmin(errors))]))


def samples_of(points: np.ndarray, normals: np.ndarray) -> Samples:
    return link(points, normals, np.full(len(points), 1 / len(points)))


@pytest.fixture(scope="module")
def cube() -> tuple[Samples, np.ndarray]:
    """Samples of a cube of ten cells, and the face that each lies on."""
    rng = np.random.default_rng(3)
    points, normals, faces = [], [], []
    for number, (axis, sign) in enumerate(itertools.product(range(3), (-1, 1))):
        own = rng.uniform(-5, 5, (200, 3))
        own[:, axis] = 5 * sign
        points.append(own)
        normals.append(np.tile(sign * np.eye(3)[axis], (200, 1)))
        faces.append(np.full(200, number))
    return samples_of(np.concatenate(points), np.concatenate(normals)), np.concatenate(faces)


def test_regions_do_not_run_over_edges(cube) -> None:
    samples, face = cube
    label = partition(samples, 30, np.random.default_rng(0))
    assert 6 <= label.max() + 1 <= 30
    for region in range(label.max() + 1):
        assert len(np.unique(face[label == region])) == 1


def test_merging_ends_at_the_faces_before_it_joins_two(cube) -> None:
    samples, face = cube
    label = partition(samples, 30, np.random.default_rng(0))
    nodes, costs = hierarchy(samples, label)
    count = label.max() + 1
    flat = [node for node, cost in zip(nodes, costs, strict=True) if cost < 1e-9]
    whole = {tuple(np.unique(label[face == f])) for f in range(6)}
    assert whole <= {tuple(sorted(node)) for node in flat}
    assert len(nodes) == 2 * count - 1 and sorted(nodes[-1]) == list(range(count))


def test_coplanar_regions_merge_across_a_gap() -> None:
    rng = np.random.default_rng(1)
    left, right = rng.uniform(0, 10, (300, 3)), rng.uniform([30, 0, 0], [40, 10, 10], (300, 3))
    roof = rng.uniform(0, 10, (300, 3))
    points = np.concatenate([left, right, roof])
    points[:600, 1], points[600:, 1] = 0, 8
    samples = samples_of(points, np.tile([0.0, 1.0, 0.0], (900, 1)))
    label = np.repeat([0, 1, 2], 300)
    nodes, costs = hierarchy(samples, label)
    assert tuple(sorted(nodes[3])) == (0, 1) and costs[3] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("shape", [(6, 9), (9, 6), (1, 7), (5, 5)])
def test_the_best_rectangle_is_the_best_of_all(shape) -> None:
    values = np.random.default_rng(shape[0]).normal(size=shape)
    score, (u0, u1, v0, v1) = best_rectangle(values)
    every = (
        values[a:b, c:d].sum()
        for a, b in itertools.combinations(range(shape[0] + 1), 2)
        for c, d in itertools.combinations(range(shape[1] + 1), 2)
    )
    assert score == pytest.approx(max(every)) and values[u0:u1, v0:v1].sum() == pytest.approx(score)


@pytest.fixture(scope="module")
def roof() -> tuple[Air, Targets]:
    """A tilted sheet in two components, on a base that makes the grid no thinner than it is."""
    halves = [sheet((-4, -3), (0, 3)) @ TILT.T, sheet((0.05, -3), (4, 3)) @ TILT.T]
    return seen_by_air(*halves, mesh_triangles(trimesh.creation.box((1.0, 1.0, 1.0)), (0, -4, 0)))


def test_one_tilted_slab_stands_for_two_components(roof) -> None:
    air, targets = roof
    best = best_alone(find_regions(air, targets).standing, targets)
    thin = int(np.argmin(best.halves[0]))
    assert abs(best.frames[0][:, thin] @ TILT[:, 1]) > 0.9999
    sides = np.sort(best.halves[0])
    assert sides[1:] == pytest.approx([3, 4.02], abs=1.5 * air.cell)
    on_sheet = np.flatnonzero(targets.is_surface & (targets.points[:, 1] > -1.5))
    assert np.abs(distances_to_one(best, 0, targets.points[on_sheet])).mean() < 0.1 * air.cell


def test_candidates_are_the_same_bytes_each_time(roof) -> None:
    air, targets = roof
    one, two = find_regions(air, targets, seed=5).standing, find_regions(air, targets, seed=5).standing
    for name in ("kinds", "centers", "frames", "halves"):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()


@pytest.fixture(scope="module")
def wall_with_door() -> tuple[Air, Targets]:
    """A tilted wall of 8 m by 6 m with a door of 2 m by 4 m in its middle, open at the bottom."""
    pieces = [sheet((-4, -3), (-1, 3)), sheet((1, -3), (4, 3)), sheet((-1, 1), (1, 3))]
    return seen_by_air(*[piece @ TILT.T for piece in pieces])


def test_doors_stay_open(wall_with_door) -> None:
    air, targets = wall_with_door
    candidates = find_regions(air, targets).standing
    x, z = np.meshgrid(np.linspace(-0.6, 0.6, 9), np.linspace(-2.6, 0.6, 9))
    door = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1) @ TILT.T
    for i in range(len(candidates)):
        assert np.mean(distances_to_one(candidates, i, door) < 1e-3) < 0.1  # a slab's face lies in the door
    regions = find_regions(air, targets)
    chosen: list[Shapes] = []
    assert covered(regions, targets, chosen) > 0.95


def covered(regions: Regions, targets: Targets, chosen: list[Shapes]) -> float:
    """Share of the surface within half a cell after the best candidate was taken four times."""
    current = set_distances(no_shapes(), targets)
    for _ in range(4):
        offers = propose_slabs(regions, targets, current)
        alone = [
            np.minimum(current, set_distances(offers.select(np.array([i])), targets))
            for i in range(len(offers))
        ]
        surface = [np.abs(a[targets.is_surface]).mean() for a in alone]
        current = alone[int(np.argmin(surface))]
    return float(np.mean(np.abs(current[targets.is_surface]) < 0.5 * regions.air.cell))


def test_what_a_set_lacks_is_proposed_next(roof) -> None:
    air, targets = roof
    regions = find_regions(air, targets)
    half = make_shapes(Kind.BOX, (np.array([[-2.0, -0.1, 0.0]]) @ TILT.T), TILT, np.array([[2.0, 0.1, 3.0]]))
    current = set_distances(half, targets)
    known = {tuple(np.round(c, 9)) for c in regions.standing.centers}
    offers = propose_slabs(regions, targets, current)
    new = np.flatnonzero([tuple(np.round(c, 9)) not in known for c in offers.centers])
    own = offers.select(new)
    on_sheet = np.flatnonzero(np.abs((own.centers @ TILT)[:, 1]) < 0.5)
    assert len(on_sheet) and (own.centers @ TILT)[on_sheet, 0].max() > 1.5
    best = best_alone(own.select(on_sheet), targets.select(np.flatnonzero(current > air.cell)))
    assert (best.centers @ TILT)[0] == pytest.approx([2, 0, 0], abs=2 * air.cell)


def test_round_regions_become_cylinders_and_spheres() -> None:
    column = trimesh.creation.cylinder(radius=1.0, height=8.0, sections=32)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=1.5)
    air, targets = seen_by_air(mesh_triangles(column), mesh_triangles(ball, (6, 0, 0)))
    offers = find_regions(air, targets).standing
    cylinders = offers.select(np.flatnonzero(offers.kinds == Kind.CYLINDER))
    spheres = offers.select(np.flatnonzero(offers.kinds == Kind.SPHERE))
    cylinder, sphere = best_alone(cylinders, targets), best_alone(spheres, targets)
    assert abs(cylinder.frames[0][2, 1]) > 0.999 and cylinder.halves[0, 0] == pytest.approx(1.0, abs=0.05)
    assert np.linalg.norm(cylinder.centers[0][:2]) < 0.05 and cylinder.halves[0, 1] > 3.5
    assert sphere.centers[0] == pytest.approx([6, 0, 0], abs=0.05)
    assert sphere.halves[0, 0] == pytest.approx(1.5, abs=0.05)


def test_nothing_seen_gives_nothing(roof) -> None:
    air, targets = roof
    blind = targets.select(np.flatnonzero(~targets.is_surface))
    assert len(find_regions(air, blind).standing) == 0
