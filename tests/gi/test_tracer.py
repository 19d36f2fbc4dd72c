"""The tracer against equations: hits, normals, colours, visibility, candidate lists, starts."""

import numpy as np
import pytest

from fit import sdf
from fit.primitives import (
    PrimitiveSet,
    make_box,
    make_cylinder,
    make_half_space,
    make_plane,
    make_sphere,
    pack_gpu,
    unpack_gpu,
)
from runtime.clusters import find_clusters, pack_clusters
from runtime.encoder import Recorder
from runtime.timing import Timer
from runtime.tracer import STRIDES, Tracer
from runtime.twins import reference
from runtime.twins.candidates import candidate_surplus, nearest_in_clusters
from runtime.twins.march import march_by_strides
from runtime.world import CULLINGS, World, WorldSettings

RAYS = 20_000


def random_scene(count: int, seed: int, *, ground: bool = True) -> PrimitiveSet:
    """Primitives of every kind, turned at random, coloured by face."""
    rng = np.random.default_rng(seed)
    parts = [make_half_space((0, -4, 0), albedo=(0.2, 0.4, 0.6))] if ground else []
    for i in range(count):
        place, turn = rng.uniform(-4, 4, 3), rng.normal(size=4)
        turn /= np.linalg.norm(turn)
        faces = {
            "albedo": rng.uniform(0, 1, (6, 3)),
            "emission": rng.integers(0, 2, (6, 1)) * np.ones((6, 3)),
        }
        match i % 4:
            case 0:
                parts.append(make_box(place, rng.uniform(0.1, 1.5, 3), turn, **faces))
            case 1:
                parts.append(make_sphere(place, rng.uniform(0.1, 0.8), albedo=rng.uniform(0, 1, 3)))
            case 2:
                radius, height = rng.uniform(0.1, 0.6), rng.uniform(0.1, 2)
                parts.append(make_cylinder(place, radius, height, turn, **faces))
            case 3:
                parts.append(make_plane(place, *rng.uniform(0.5, 2, 2), 0.01, turn, **faces))
    return PrimitiveSet.concatenate(parts)


def random_rays(primitives: PrimitiveSet, seed: int = 0):
    """Rays from free places, some of them far outside."""
    rng = np.random.default_rng(seed)
    origins = rng.uniform(-6, 6, (RAYS, 3))
    origins[::10] *= 5
    directions = rng.normal(size=(RAYS, 3))
    directions[::10] = -origins[::10] + rng.normal(size=origins[::10].shape)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    free = sdf.union_distance(primitives, origins)[0] > 1e-3
    return origins[free], directions[free]


def stored(primitives: PrimitiveSet) -> PrimitiveSet:
    """The set with the record's precision."""
    return unpack_gpu(pack_gpu(primitives))


@pytest.mark.parametrize("culling", CULLINGS)
@pytest.mark.parametrize("count", [1, 40])
def test_hits_are_those_of_the_equations(gpu, culling, count):
    primitives = random_scene(count, seed=count)
    origins, directions = random_rays(primitives)
    hits = Tracer(gpu, World(gpu, None, primitives, settings=WorldSettings(culling=culling))).trace(
        origins, directions
    )
    t, index = reference.intersect(primitives, origins, directions)
    same = hits.primitive == index
    assert same.mean() > 0.9985  # grazing rays may stop a hair beside an edge
    is_hit = same & (index >= 0)
    assert is_hit.mean() > 0.1
    error = np.abs(hits.t - t)[is_hit]
    assert np.percentile(error, 99) < 2e-3
    exact = stored(primitives)
    position, owner = hits.position[is_hit], index[is_hit]
    np.testing.assert_allclose(np.linalg.norm(hits.normal[is_hit], axis=1), 1, atol=1e-4)
    agreement = np.sum(sdf.gradient(exact, position, owner) * hits.normal[is_hit], axis=1)
    assert np.mean(agreement > 0.999) > 0.998
    face = sdf.primitive_face(exact, position, owner)
    right = np.abs(hits.albedo[is_hit] - exact.albedo[owner, face]).max(axis=1) < 1e-4
    glow = np.abs(hits.emission[is_hit] - exact.emission[owner, face]).max(axis=1) < 1e-4
    assert right.mean() > 0.998
    assert glow.mean() > 0.998


def crowd(count: int, seed: int) -> PrimitiveSet:
    """Small primitives, turned at random, many of which overlap."""
    return random_scene(count, seed).transformed(np.diag([3.0, 3.0, 3.0, 1.0]))


SETS = {
    "one box": make_box((0, 0, 0), (1, 2, 3)),
    "two boxes in one place": PrimitiveSet.concatenate([make_box((1, 0, 0), (3, 2, 3))] * 2),
    "half-spaces": PrimitiveSet.concatenate([make_half_space((0, -7, 0)), make_half_space((0, -8, 0))]),
    "turned and overlapping": random_scene(60, seed=5),
    "200 apart": crowd(200, seed=6),
    "1,000": crowd(1000, seed=7),
}


@pytest.mark.parametrize("name", SETS)
def test_all_cullings_give_the_same_hits(gpu, name):
    primitives = SETS[name]
    rays = tuple(column[:800] for column in random_rays(primitives))
    by_culling = [
        Tracer(gpu, World(gpu, None, primitives, settings=WorldSettings(culling=culling))).trace(*rays)
        for culling in CULLINGS
    ]
    truth = by_culling[CULLINGS.index("none")]
    assert (truth.primitive >= 0).mean() > 0.02
    for hits in by_culling:
        assert np.mean(hits.primitive == truth.primitive) > 0.997 or name == "two boxes in one place"
        assert np.mean((hits.primitive < 0) == (truth.primitive < 0)) > 0.999
        both = (hits.primitive == truth.primitive) & (hits.primitive >= 0)
        assert np.percentile(np.abs(hits.t - truth.t)[both], 99.9) < 1e-3
        if name == "1,000":
            assert hits.asked.sum() < 0.3 * truth.asked.sum() or hits is truth


@pytest.mark.parametrize("strides", STRIDES)
def test_all_strides_give_the_hits_of_plain_ones(gpu, strides):
    """But for rays that plain strides do not bring to their end: longer ones are right more often there."""
    primitives = crowd(200, seed=11)
    world = World(gpu, None, primitives)
    rays = tuple(column[:3000] for column in random_rays(primitives))
    plain = Tracer(gpu, world, "plain").trace(*rays)
    hits = Tracer(gpu, world, strides).trace(*rays)
    arrived = plain.steps < 128
    assert np.mean(hits.primitive[arrived] == plain.primitive[arrived]) > 0.9995
    both = (hits.primitive == plain.primitive) & (hits.primitive >= 0)
    assert np.percentile(np.abs(hits.t - plain.t)[both], 99) < 3e-5 * world.diagonal
    truth = reference.intersect(primitives, *rays)[1]
    assert np.count_nonzero(hits.primitive != truth) <= np.count_nonzero(plain.primitive != truth)
    if strides != "plain":
        assert hits.steps.sum() < 0.95 * plain.steps.sum()


@pytest.mark.parametrize("strides", STRIDES)
def test_steps_are_those_of_the_twin(gpu, strides):
    primitives = random_scene(40, seed=13, ground=False)
    world = World(gpu, None, primitives, settings=WorldSettings(culling="none"))
    origins, directions = (column[:2000] for column in random_rays(primitives))
    inside = np.all(np.abs(origins) < 4, axis=1)
    origins, directions = origins[inside], directions[inside]
    hits = Tracer(gpu, world, strides).trace(origins, directions, 3.0)
    twin = march_by_strides(
        STRIDES.index(strides),
        primitives,
        origins,
        directions,
        np.full(len(origins), 3.0),
        1e-5 * world.diagonal,
    )
    assert np.mean(hits.primitive == twin.primitive) > 0.99
    met = (hits.primitive == twin.primitive) & (twin.primitive >= 0)
    assert met.sum() > 50
    np.testing.assert_allclose(hits.t[met], twin.t[met], atol=1e-3)
    assert np.mean(hits.steps[met] == twin.steps[met]) > 0.95


@pytest.mark.parametrize("count", [1, 300])
def test_lists_are_those_of_the_twin(gpu, count):
    """What is listed is nearer than the reach, what is not is farther, in rising order."""
    primitives = random_scene(count, seed=count)
    world = World(gpu, None, primitives, settings=WorldSettings(cells=3000))
    world.bindings()
    finite = primitives.select(world.order[: world.finite_count])
    grid = world.grid
    surplus = candidate_surplus(finite, grid.lower + world.origin, grid.cell, grid.size)
    lists = grid.lists()
    assert len(lists) == len(surplus) == grid.cells
    listed = np.zeros(surplus.shape, bool)
    for row, found in zip(listed, lists, strict=True):
        assert np.all(np.diff(found.astype(int)) > 0)
        row[found] = True
    doubtful = np.abs(surplus) < 1e-4
    np.testing.assert_array_equal(listed[~doubtful], (surplus <= 0)[~doubtful])
    assert world.list_statistics().mean == pytest.approx(listed.sum(axis=1).mean())


def test_clusters_are_asked_as_by_the_twin(gpu):
    """By rays too short to meet anything: where they do not leave what is nearest, they ask once."""
    primitives = crowd(150, seed=3).select(np.arange(1, 151))
    settings = WorldSettings(culling="clusters", clusters=12)
    world = World(gpu, None, primitives, origin=(0, 0, 0), settings=settings)
    radii = primitives.bounding_radii()
    records = pack_clusters(world.clustering, primitives.positions, radii)
    balls, labels = records["ball"].astype(np.float64), world.clustering.labels
    outside = np.linalg.norm(primitives.positions - balls[labels, :3], axis=1) + radii - balls[labels, 3]
    assert len(balls) == 12 and outside.max() < 1e-5
    points, directions = (column[:500] for column in random_rays(primitives))
    hits = Tracer(gpu, world).trace(points, directions, 1e-6)
    _, index, asked = nearest_in_clusters(primitives, balls, labels, points, np.full(len(points), np.inf))
    once = hits.steps == 1
    assert once.sum() > 100
    assert np.mean(hits.asked[once] == asked[once]) > 0.99 and asked.mean() < 100
    np.testing.assert_array_equal(index, sdf.union_distance(primitives, points)[1])


def test_visibility_is_blocked_exactly_by_what_lies_between(gpu):
    primitives = random_scene(40, seed=3)
    rng = np.random.default_rng(4)
    a, b = rng.uniform(-4, 4, (2, RAYS, 3))
    free = (sdf.union_distance(primitives, a)[0] > 0.01) & (sdf.union_distance(primitives, b)[0] > 0.01)
    a, b = a[free], b[free]
    reach = np.linalg.norm(b - a, axis=1)
    direction = (b - a) / reach[:, None]
    hits = Tracer(gpu, World(gpu, None, primitives)).trace(a, direction, reach)
    blocked = reference.intersect(primitives, a, direction, reach)[1] >= 0
    assert np.mean((hits.visibility == 0) == blocked) > 0.998
    leaked = (hits.visibility > 0) & blocked
    assert not leaked.any()


def test_penumbra_darkens_ways_past_an_edge_only(gpu):
    """A wall's edge at y = 0: the way from 1 m before it to 1 m behind it passes it by at `height` metres."""
    primitives = make_box((0, -1, 0), (0.02, 2, 4))
    tracer = Tracer(gpu, World(gpu, None, primitives))
    height = np.array([-0.01, 0.002, 0.01, 0.05, 0.2])
    start = np.stack([np.full(5, -1.0), height, np.zeros(5)], axis=1)
    seen = tracer.trace(start, np.tile([1.0, 0, 0], (5, 1)), 2.0, softness=0.02).visibility
    assert seen[0] == 0
    assert 0 < seen[1] < seen[2] < 1
    np.testing.assert_allclose(seen[3:], 1)


def test_grazing_a_wall_does_not_darken_it(gpu):
    """From just above a floor towards points at 0.5 to 90 degrees: nothing lies between, nothing is lost."""
    floor = make_box((0, -0.5, 0), (40, 1, 40))
    angle = np.radians(np.linspace(0.5, 90, 300))
    start = np.tile([0.0, 0.005, 0.0], (300, 1))
    direction = np.stack([np.cos(angle), np.sin(angle), np.zeros(300)], axis=1)
    hits = Tracer(gpu, World(gpu, None, floor)).trace(start, direction, 5.0, softness=0.05)
    np.testing.assert_allclose(hits.visibility, 1)
    assert hits.steps.max() < 40


def test_far_origins_keep_their_precision(gpu):
    near = random_scene(20, seed=8, ground=False)
    move = np.eye(4)
    move[:3, 3] = (1e6, -3e5, 2e6)
    rays = random_rays(near)
    a = Tracer(gpu, World(gpu, None, near)).trace(*rays)
    b = Tracer(gpu, World(gpu, None, near.transformed(move))).trace(rays[0] + move[:3, 3], rays[1])
    assert np.mean(a.primitive == b.primitive) > 0.999
    both = (a.primitive == b.primitive) & (a.primitive >= 0)
    assert np.percentile(np.abs(a.t - b.t)[both], 99) < 1e-3


def test_lists_are_shorter_than_the_set_and_grow_when_they_must(gpu, caplog):
    primitives = random_scene(200, seed=2)
    world = World(gpu, None, primitives)
    short = world.list_statistics()
    assert short.overflowing == 0
    assert short.mean < 20 < len(primitives)
    with caplog.at_level("INFO", logger="runtime.candidate_grid"):
        grown = World(gpu, None, primitives, settings=WorldSettings(list_length=2)).list_statistics()
    assert "candidate lists grow" in caplog.text
    assert grown.overflowing == 0
    assert grown.longest == short.longest <= grown.room


def test_an_overflowing_list_is_slow_but_right(gpu):
    """Moved primitives crowd into few cells; until the room grows, those cells ask every primitive."""
    apart = random_scene(60, seed=6, ground=False)
    world = World(gpu, None, apart, settings=WorldSettings(list_length=6))
    world.bindings()
    shrink = np.diag([0.05, 0.05, 0.05, 1.0])
    crowd = PrimitiveSet.concatenate([apart.select(slice(0, 59)).transformed(shrink), apart.select([59])])
    world.update(crowd)
    rays = random_rays(crowd)
    hits = Tracer(gpu, world).trace(*rays)
    index = reference.intersect(crowd, *rays)[1]
    assert np.mean(hits.primitive == index) > 0.9985
    assert world.list_statistics().overflowing > 0
    assert "have no room and ask all 60 primitives" in world.notes()[0]
    later = Tracer(gpu, world).trace(*rays)
    assert world.list_statistics().overflowing == 0 and world.notes() == ()
    assert later.asked.sum() < hits.asked.sum()
    np.testing.assert_array_equal(later.primitive, hits.primitive)


def test_nothing_is_made_or_read_while_primitives_move(gpu, monkeypatch):
    """Nor while some of them vanish: buffers and lists are there since the first frame."""
    primitives = random_scene(60, seed=6)
    turn = np.array([[0.0, 0, 1, 0.3], [0, 1, 0, 0.1], [-1, 0, 0, 0], [0, 0, 0, 1]])
    timer = Timer(gpu)
    for culling in CULLINGS:
        world = World(gpu, None, primitives, settings=WorldSettings(culling=culling))
        world.bindings()
        with monkeypatch.context() as patched:
            for owner, name in ((gpu.wgpu_device, "create_buffer"), (gpu.queue, "read_buffer")):
                patched.setattr(owner, name, lambda *a, **k: pytest.fail("a buffer was made or read"))
            for moved in (primitives.transformed(turn), primitives.select(slice(0, 50)), primitives):
                world.update(moved)
                rec = Recorder(gpu, timer)
                world.record(rec)
                rec.submit()


def test_clusters_go_on_from_those_of_the_frame_before(gpu):
    rng = np.random.default_rng(3)
    points = rng.uniform(-5, 5, (200, 3))
    first, again = (find_clusters(points, 20, seed=4) for _ in range(2))
    np.testing.assert_array_equal(first.labels, again.labels)
    assert not np.array_equal(first.labels, find_clusters(points, 20, seed=5).labels)
    moved = find_clusters(points + rng.normal(0, 0.01, points.shape), 20, 4, first)
    assert np.mean(moved.labels == first.labels) > 0.9
    assert np.linalg.norm(moved.means - first.means, axis=1).max() < 1
    within = np.linalg.norm(points - first.means[first.labels], axis=1)
    every = np.linalg.norm(points[:, None] - first.means, axis=2)
    np.testing.assert_allclose(
        within, every.min(axis=1), err_msg="each is in the cluster of the nearest mean"
    )
    few = find_clusters(points[[0, 0, 1]], 3)
    assert len(few.means) == 2 and few.labels[0] == few.labels[1] != few.labels[2]


def test_update_moves_the_primitives_without_new_pipelines(gpu):
    world = World(gpu, None, make_sphere((0, 0, 0), 1.0), origin=(0, 0, 0))
    tracer = Tracer(gpu, world)
    ray = np.array([[-5.0, 0, 0]]), np.array([[1.0, 0, 0]])
    assert tracer.trace(*ray).t[0] == pytest.approx(4.0, abs=1e-3)
    pipeline = tracer._kernel.pipeline
    world.update(PrimitiveSet.concatenate([make_sphere((2, 0, 0), 1.0), make_box((9, 9, 9))]))
    assert tracer.trace(*ray).t[0] == pytest.approx(6.0, abs=1e-3)
    world.update(PrimitiveSet.empty())
    assert tracer.trace(*ray).primitive[0] == -1
    assert tracer._kernel.pipeline is pipeline
