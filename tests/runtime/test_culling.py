"""Primitives that are left out because they are far and small: which, and what that may change."""

from __future__ import annotations

import numpy as np
import pytest

from fit import sdf
from fit.primitives import PrimitiveSet, make_box, make_half_space, make_sphere
from runtime.culling import cull, may_shadow, solid_angles
from runtime.lights import Point, Sun
from runtime.tracer import Tracer
from runtime.twins import reference
from runtime.world import World, WorldSettings

VOLUME = (np.array([-5.0, 0.0, -5.0]), np.array([5.0, 4.0, 5.0]))


@pytest.fixture(scope="module")
def scattered() -> PrimitiveSet:
    """Ground, a house in the volume, and 300 balloons up to 200 m away."""
    rng = np.random.default_rng(4)
    parts = [make_half_space((0, 0, 0)), make_box((1, 1, 1), (2, 2, 2))]
    for _ in range(300):
        angle, away = rng.uniform(0, 2 * np.pi), rng.uniform(9, 200)
        place = (away * np.cos(angle), rng.uniform(1, 20), away * np.sin(angle))
        parts.append(make_sphere(place, rng.uniform(0.1, 0.8), albedo=(0.9, 0.2, 0.1)))
    return PrimitiveSet.concatenate(parts)


def points_of(volume, count: int, primitives: PrimitiveSet):
    points = np.random.default_rng(7).uniform(*volume, (count, 3))
    return points[sdf.union_distance(primitives, points)[0] > 0.05]


def test_solid_angle_is_the_largest_in_the_box():
    """Against counted directions from the box's nearest point, and never less from any other."""
    centre, radius = np.array([[9.0, 2.0, 1.0]]), np.array([1.5])
    bound = solid_angles(centre, radius, VOLUME)[0]
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(200_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)

    def seen(point):
        along = directions @ (centre[0] - point)
        beside = np.linalg.norm(centre[0] - point - along[:, None] * directions, axis=1)
        return 4 * np.pi * np.mean((along > 0) & (beside < radius[0]))

    assert seen(np.array([5.0, 2.0, 1.0])) == pytest.approx(bound, rel=0.03)
    assert max(seen(point) for point in rng.uniform(*VOLUME, (20, 3))) < 1.03 * bound
    assert solid_angles(np.array([[5.5, 2, 0]]), np.array([1.0]), VOLUME)[0] == np.inf


@pytest.mark.parametrize("share", [0.003, 0.03])
def test_irradiance_changes_by_no_more_than_the_share(scattered, share):
    """Under a sky of 1 with black balloons, the worst case: E of points in the volume, with and without."""
    culled = cull(scattered, VOLUME, share)
    assert 10 < culled.count < len(scattered) - 2
    assert 0.5 * share < culled.share <= share
    kept = scattered.select(~culled.is_culled)
    points = points_of(VOLUME, 40, scattered)
    rng = np.random.default_rng(1)
    normals = rng.normal(size=points.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    samples = 400
    starts, facing = np.repeat(points, samples, axis=0), np.repeat(normals, samples, axis=0)
    ways = reference.cosine_directions(facing, rng.random((len(starts), 2)))
    is_open, stays_open = (reference.intersect(each, starts, ways)[1] < 0 for each in (scattered, kept))
    change = (is_open != stays_open).reshape(len(points), samples).mean(axis=1)
    assert change.max() <= culled.share + 3 * np.sqrt(culled.share / samples)
    assert change.sum() > 0, "no ray met what is left out: the test would see no fault"


def test_what_shines_shadows_or_is_near_stays(scattered):
    lamp = make_sphere((60, 3, 0), 0.05, emission=(5, 5, 5))
    mast = make_sphere((30, 30, 0), 0.05)
    primitives = PrimitiveSet.concatenate([lamp, mast, scattered])
    sun = Sun((1, 1, 0), 3.0)
    is_culled = cull(primitives, VOLUME, 0.05, [sun]).is_culled
    assert not is_culled[:4].any(), "lamp, mast before the sun, ground, house"
    assert cull(primitives, VOLUME, 0.05).is_culled[1], "without the sun the mast may go"
    assert cull(scattered, VOLUME, 0.0).count == 0


def test_shadows_of_lamps_are_found():
    """By segments from the lamp to points of the box: where one is blocked, the ball may shadow."""
    rng = np.random.default_rng(5)
    lamp = Point((20.0, 12.0, 0.0), 1.0)
    centres, radii = rng.uniform((-9, -3, -9), (22, 14, 9), (400, 3)), rng.uniform(0.1, 2.0, 400)
    outside = np.linalg.norm(centres - np.clip(centres, *VOLUME), axis=1) > radii
    away = np.linalg.norm(centres - lamp.position, axis=1) > radii
    found = may_shadow(centres, radii, VOLUME, lamp)
    targets = rng.uniform(*VOLUME, (2000, 3))
    way = targets - np.array(lamp.position)
    along = np.clip(((centres[:, None] - lamp.position) * way).sum(-1) / (way**2).sum(-1), 0, 1)
    beside = np.linalg.norm(centres[:, None] - lamp.position - along[..., None] * way, axis=-1)
    blocks = (beside < radii[:, None]).any(axis=1) & outside & away
    assert blocks.sum() > 5
    assert found[blocks].all()
    assert found.mean() < 0.9
    assert not may_shadow(centres, radii, VOLUME, Point((0.0, 1.0, 0.0), 1.0)).any()


def test_a_world_leaves_out_what_is_far_wherever_the_camera_looks(gpu, scattered):
    """Its version stays, hits on what is kept are the same, and it says what it did."""
    world = World(gpu, None, scattered, settings=WorldSettings(culled_share=0.01))
    whole = World(gpu, None, scattered)
    version = world.version
    assert len(world.order) == len(scattered) and world.notes() == ()
    world.watch(VOLUME, [])
    assert world.version == version
    assert 0 < len(world.order) == len(scattered) - world.culled.count
    assert f"{world.culled.count} of {len(scattered)} primitives are left out" in world.notes()[0]
    points = points_of(VOLUME, 3000, scattered)
    ways = np.random.default_rng(2).normal(size=points.shape)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    found, truth = (Tracer(gpu, each).trace(points, ways) for each in (world, whole))
    gone = np.isin(truth.primitive, np.flatnonzero(world.culled.is_culled))
    assert np.mean(found.primitive[~gone] == truth.primitive[~gone]) > 0.999
    assert not np.isin(found.primitive, np.flatnonzero(world.culled.is_culled)).any()
    world.update(scattered)
    assert len(world.order) < len(scattered), "an update keeps to the volume"
