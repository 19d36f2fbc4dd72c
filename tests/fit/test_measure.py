"""The report's figures: nothing for a perfect set, the known amount for a known error."""

import json
from dataclasses import asdict

import numpy as np
import pytest
import trimesh

from fit.air import find_air
from fit.gltf import load
from fit.measure import measure, measure_each, place_probes
from fit.primitives import (
    PrimitiveSet,
    make_box,
    make_cylinder,
    make_half_space,
    make_plane,
    make_sphere,
)
from fit.sdf import union_distance
from fit.surface import from_scene, from_triangles
from fit.trace import first_hits

REPORT_KEYS = [
    "surface_to_set_mean_m",
    "surface_to_set_p95_m",
    "surface_to_set_max_m",
    "covered_25cm",
    "covered_half_pct",
    "set_to_surface_mean_m",
    "false_solid",
    "air_distance_error_m",
    "air_distance_error_pct",
    "leaks",
    "blocked",
    "hit_error_pct",
    "largest_hole_m",
    "diag_m",
    "iou",
    "volume_error",
]


@pytest.fixture(autouse=True)
def fewer_samples(monkeypatch):
    for name, count in (("SURFACE_SAMPLES", 4000), ("BOUNDARY_SAMPLES", 8000), ("AIR_POINTS", 8000)):
        monkeypatch.setattr(f"fit.measure.{name}", count)


def box(size, center=(0, 0, 0)):
    return np.array(trimesh.creation.box(size, trimesh.transformations.translation_matrix(center)).triangles)


def air_around(surface, **options):
    return find_air(surface, resolution=90, **options)


def walls_of_a_room(size=3.0, thickness=0.2):
    """Sizes and centres of six slabs around an empty cube."""
    for axis in range(3):
        for side in (-1, 1):
            extent, center = np.full(3, size + 2 * thickness), np.zeros(3)
            extent[axis], center[axis] = thickness, side * (size + thickness) / 2
            yield extent, center


def room_surface(**options):
    return from_triangles(
        np.concatenate([box(extent, center) for extent, center in walls_of_a_room(**options)])
    )


def room_set(**options):
    return [make_box(center, extent) for extent, center in walls_of_a_room(**options)]


def assert_perfect(metrics, tolerance=1e-5):
    values = asdict(metrics)
    assert values.pop("covered_25cm") == values.pop("covered_half_pct") == 1.0
    assert values.pop("diag_m") > 0
    iou, volume_error = values.pop("iou"), values.pop("volume_error")
    assert iou is None or iou > 1 - tolerance
    assert volume_error is None or volume_error < tolerance
    assert all(0 <= value <= tolerance for value in values.values()), values


# ---------------------------------------------------------------------------------------- perfect: nothing


def test_keys_are_the_reports_and_go_into_json():
    surface = from_triangles(box((1, 1, 1)))
    metrics = asdict(measure(make_box(), surface, air_around(surface)))
    assert list(metrics) == REPORT_KEYS
    assert json.loads(json.dumps(metrics)) == metrics


def test_a_box_for_a_box_is_perfect():
    surface = from_triangles(box((2, 1, 3), (5, 6, 7)))
    metrics = measure(make_box((5, 6, 7), (2, 1, 3)), surface, air_around(surface))
    assert_perfect(metrics)
    assert metrics.iou == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize("seeds", [(), ("outside",), ("0,0,0",)])
def test_a_sealed_room_of_six_slabs_is_perfect(seeds):
    surface = room_surface()
    assert_perfect(measure(PrimitiveSet.concatenate(room_set()), surface, air_around(surface, seeds=seeds)))


def test_what_lies_behind_a_sheet_is_free_of_charge():
    """Walls modelled as sheets seen from inside: thick boxes behind them are as good as thin ones."""
    surface = from_triangles(box((3, 3, 3))[:, ::-1])
    thick = PrimitiveSet.concatenate(room_set(thickness=1.0))
    metrics = measure(thick, surface, air_around(surface))
    assert_perfect(metrics)
    assert metrics.iou is None


def test_overlapping_primitives_are_one_union():
    surface = from_triangles(box((2, 1, 1)))
    halves = [make_box((-0.25, 0, 0), (1.5, 1, 1)), make_box((0.25, 0, 0), (1.5, 1, 1))]
    assert_perfect(measure(PrimitiveSet.concatenate(halves), surface, air_around(surface)))


def test_metrics_repeat():
    surface = room_surface()
    air = air_around(surface)
    shifted = PrimitiveSet.concatenate(room_set(size=2.9))
    assert measure(shifted, surface, air, seed=3) == measure(shifted, surface, air, seed=3)
    assert measure(shifted, surface, air, seed=3) != measure(shifted, surface, air, seed=4)


# ------------------------------------------------------------------------------------- known errors, measured


def test_a_sphere_too_large_by_a_known_amount():
    surface = from_triangles(trimesh.creation.icosphere(5, 1.0).triangles)
    air = air_around(surface)
    metrics = measure(make_sphere(radius=1.1), surface, air)
    assert metrics.surface_to_set_mean_m == pytest.approx(0.1, abs=1e-3)
    assert metrics.surface_to_set_max_m == pytest.approx(0.1, abs=1e-3)
    assert metrics.set_to_surface_mean_m == pytest.approx(0.1, abs=1e-3)
    assert metrics.air_distance_error_m == pytest.approx(0.1, abs=1e-3)
    assert metrics.air_distance_error_pct == pytest.approx(100 * 0.1 / metrics.diag_m, rel=0.02)
    assert (metrics.covered_25cm, metrics.covered_half_pct) == (1.0, 0.0)
    assert metrics.leaks == 0
    radius, clear = 1.1, 1 + 1.4 * air.cell
    solid = 4 / 3 * np.pi * (radius**3 - clear**3)
    space = air.free.size * air.cell**3 - 4 / 3 * np.pi * clear**3
    assert metrics.false_solid == pytest.approx(solid / space, rel=0.1)
    assert metrics.volume_error == pytest.approx(1.1**3 - 1, abs=2e-3)
    assert metrics.iou == pytest.approx(1 / 1.1**3, abs=2e-3)


def test_a_missing_wall_leaks_its_share_of_the_light():
    surface = room_surface()
    air = air_around(surface, seeds=[(0, 0, 0)])
    open_room = PrimitiveSet.concatenate(room_set()[:5])
    metrics = measure(open_room, surface, air)
    assert metrics.leaks == pytest.approx(1 / 6, abs=0.015)
    assert metrics.blocked == 0
    assert metrics.surface_to_set_max_m > 1
    assert metrics.covered_half_pct == pytest.approx(5 / 6, abs=0.02)
    # The wall's diagonal, less what a few hundred random hits leave free in its corners.
    assert 0.9 * 3 * np.sqrt(2) < metrics.largest_hole_m < 3 * np.sqrt(2) + 1e-6


def test_what_floats_in_a_room_blocks():
    surface = room_surface()
    air = air_around(surface, seeds=[(0, 0, 0)])
    full = PrimitiveSet.concatenate([*room_set(), make_sphere(radius=0.5)])
    metrics = measure(full, surface, air)
    ball = 4 / 3 * np.pi * 0.5**3
    room = (3 - 2.8 * air.cell) ** 3
    assert metrics.false_solid == pytest.approx(ball / room, rel=0.2)
    assert metrics.blocked > metrics.false_solid
    assert metrics.leaks == 0
    assert metrics.set_to_surface_mean_m > 0.05
    assert metrics.surface_to_set_max_m < 1e-6


def test_a_louvre_covers_but_is_found_out_by_its_holes():
    surface = room_surface()
    air = air_around(surface, seeds=[(0, 0, 0)])
    slats = [make_box((1.6, y, 0), (0.2, 0.05, 3.4)) for y in np.arange(-1.5, 1.55, 0.1)]
    metrics = measure(PrimitiveSet.concatenate([*room_set()[:1], *room_set()[2:], *slats]), surface, air)
    assert metrics.covered_25cm == 1
    assert metrics.false_solid == 0
    assert metrics.leaks > 0.01


def test_holes_are_apart_where_the_set_stops_light_between_them():
    """Two openings of 0.6 x 0.6 m in one wall, 1.2 m apart."""
    surface = room_surface()
    air = air_around(surface, seeds=[(0, 0, 0)])
    posts = [make_box((1.6, 0, z), (0.2, 3.4, w)) for z, w in ((-1.35, 0.6), (0, 1.2), (1.35, 0.6))]
    beams = [make_box((1.6, y, 0), (0.2, 1.4, 3.4)) for y in (-1, 1)]
    metrics = measure(
        PrimitiveSet.concatenate([*room_set()[:1], *room_set()[2:], *posts, *beams]), surface, air
    )
    assert 0.5 < metrics.largest_hole_m < 1.0


def test_each_primitive_answers_for_its_own_errors():
    surface = room_surface()
    air = air_around(surface, seeds=[(0, 0, 0)])
    slabs = room_set()
    slabs[0] = make_box((-1.5, 0, 0), (0.2, 3.4, 3.4))  # 10 cm too far inside
    probes = place_probes(surface, air)
    errors = measure_each(PrimitiveSet.concatenate([*slabs, make_sphere(radius=0.5)]), probes)
    assert [e.kind for e in errors] == ["box"] * 6 + ["sphere"]
    assert errors[0].surface_to_set_mean_m == pytest.approx(0.1, abs=0.01)
    strips = 4 * 0.1 * 3.0  # of the four walls around it, which it swallows
    assert errors[0].surface_share == pytest.approx((9 + strips) / 54, abs=0.03)
    assert max(e.surface_to_set_max_m for e in errors[2:6]) < 0.1
    assert errors[6].surface_share == 0
    whole = measure(PrimitiveSet.concatenate([*slabs, make_sphere(radius=0.5)]), surface, air, probes=probes)
    assert sum(e.false_solid for e in errors) == pytest.approx(whole.false_solid)
    assert errors[6].false_solid > 0.01


def test_a_surface_within_overlapping_primitives_is_as_deep_as_the_union():
    """A floor sunk into two overlapping boxes: the nearest way out of each one ends in the other."""
    sheet = from_triangles(np.array([[[-1, 0, -1], [1, 0, -1], [0, 0, 1]]], float))
    deep = PrimitiveSet.concatenate([make_box((0, 0.2, 0), (9, 0.6, 9)), make_box((0, -0.2, 0), (9, 0.6, 9))])
    metrics = measure(deep, sheet, air_around(sheet))
    assert metrics.surface_to_set_mean_m == pytest.approx(0.5, abs=0.03)
    assert metrics.false_solid == 1


def test_an_empty_set_misses_everything_by_a_diagonal():
    surface = from_triangles(box((1, 1, 1)))
    metrics = measure(PrimitiveSet.empty(), surface, air_around(surface))
    assert metrics.leaks == 1
    assert metrics.surface_to_set_mean_m == pytest.approx(np.sqrt(3))
    assert (metrics.iou, metrics.false_solid, metrics.blocked) == (0.0, 0.0, 0.0)


def test_a_half_space_stands_for_the_ground():
    ground = from_triangles(
        np.array([[[-5, 0, -5], [-5, 0, 5], [5, 0, 5]], [[-5, 0, -5], [5, 0, 5], [5, 0, -5]]], float)
    )
    air = air_around(ground)
    below = measure(make_half_space((0, 0, 0)), ground, air)
    assert below.surface_to_set_max_m < 1e-9
    assert below.leaks == 0
    assert below.false_solid == pytest.approx(0.5, abs=0.03)


# ---------------------------------------------------------------------------------------------- first hits


def mixed_set(seed=0):
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(9, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    places = rng.uniform(-2, 2, (9, 3))
    kinds = [make_box, make_cylinder, make_plane]
    sizes = [
        {"size": (1.0, 0.3, 0.6)},
        {"radius": 0.4, "height": 1.2},
        {"size_x": 1.5, "size_z": 1.0, "thickness": 0.02},
    ]
    parts = [kinds[i % 3](places[i], rotation=turns[i], **sizes[i % 3]) for i in range(9)]
    return PrimitiveSet.concatenate(
        [*parts, make_sphere((1, 1, 1), 0.5), make_half_space((0, -2.5, 0), (np.sin(0.1), 0, 0, np.cos(0.1)))]
    )


def test_first_hits_lie_on_the_boundary_and_nothing_lies_before_them():
    primitives = mixed_set()
    rng = np.random.default_rng(1)
    origins = rng.uniform(-3, 3, (3000, 3))
    directions = rng.normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    hits = first_hits(primitives, origins, directions)
    start = union_distance(primitives, origins)[0]
    np.testing.assert_array_equal(hits[start < 0], 0)
    outside, hit = start > 0, np.isfinite(hits)
    assert (outside & hit).sum() > 500
    assert (outside & ~hit).sum() > 500
    at = origins + np.where(hit, hits, 0)[:, None] * directions
    np.testing.assert_allclose(union_distance(primitives, at[outside & hit])[0], 0, atol=1e-9)
    for share in np.linspace(0.02, 0.999, 60):
        reach = np.where(hit, hits, 12.0)[outside]
        before = origins[outside] + share * reach[:, None] * directions[outside]
        assert union_distance(primitives, before)[0].min() > -1e-9


def test_axis_parallel_rays_meet_faces_or_pass_beside_them():
    hits = first_hits(make_box(), np.array([[-2.0, 0, 0], [-2, 0.6, 0]]), np.tile([1.0, 0, 0], (2, 1)))
    np.testing.assert_array_equal(hits, [1.5, np.inf])


# --------------------------------------------------------------------------------------------- real scenes


def test_sponza_is_measured(shared_assets):
    scene = load(shared_assets / "Sponza" / "Sponza.gltf")
    surface = from_scene(scene)
    air = find_air(surface, scene)
    lower, upper = surface.bounds
    metrics = measure(make_box((lower + upper) / 2, upper - lower), surface, air)
    assert metrics.diag_m == pytest.approx(46.37, abs=0.01)
    assert metrics.iou is None
    assert metrics.false_solid > 0.25
    assert metrics.blocked > 0.3
    assert metrics.leaks < 0.01
