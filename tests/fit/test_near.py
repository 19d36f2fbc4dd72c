"""Which targets a shape is near: found by bounds and remembered, but as if all were looked at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fit.merge import find_merges
from fit.objective import (
    MOST_KNOWN,
    RUN,
    Targets,
    distance_table,
    distances_from,
    error,
    near_distances,
    near_rows,
)
from fit.primitives import Kind
from fit.shapes import Shapes, join, make_shapes, moved

REACH = 0.15


def scattered(count: int, seed: int = 0) -> Targets:
    """Points, rays and ways that must be free, in no order, in the unit cube."""
    rng = np.random.default_rng(seed)
    kind = rng.integers(3, size=count)
    points, ways = rng.random((count, 3)), 0.05 * rng.normal(size=(count, 3))
    ways[kind == 0] = 0
    ways[kind == 2] *= 20
    return Targets(
        points=points, distances=np.zeros(count), weights=np.ones(count), normals=np.zeros((count, 3)),
        sample=np.where(kind == 0, 0, -1), caps=np.full(count, REACH), ways=ways, is_line=kind == 2,
        late=np.zeros(count), filled=np.zeros(count), reach=REACH, soft=0.001, leak=0.01, slack=0.02,
    )  # fmt: skip


def turned_shapes() -> Shapes:
    """A box, a cylinder and a sphere, turned any way."""
    rng = np.random.default_rng(1)
    several = [
        make_shapes(kind, rng.random((1, 3)), np.eye(3), np.array(halves))
        for kind, halves in (
            (Kind.BOX, [0.3, 0.01, 0.2]),
            (Kind.CYLINDER, [0.1, 0.4, 0.1]),
            (Kind.SPHERE, 0.1),
        )
    ]
    step = np.zeros((3, 9))
    step[:, 3:6] = rng.normal(size=(3, 3))
    return moved(join(several), step)


@pytest.mark.parametrize("which", [0, 1, 2])
def test_all_that_is_near_is_found(which: int) -> None:
    targets, shapes = scattered(20 * RUN + 5), turned_shapes()
    everywhere = distances_from(shapes, which, targets)
    rows, distances = near_distances(shapes, which, targets)
    np.testing.assert_array_equal(rows, np.flatnonzero(everywhere < REACH))
    np.testing.assert_array_equal(distances, everywhere[rows])
    assert targets.is_line[rows].any() and targets.is_ray[rows].any() and targets.is_surface[rows].any()


def test_long_lines_are_looked_at_only_where_they_pass() -> None:
    targets = scattered(20 * RUN)
    small = make_shapes(Kind.SPHERE, np.full((1, 3), 0.5), np.eye(3), np.full(3, 0.02))
    looked_at = near_rows(small, 0, targets.select(targets.is_line), REACH)
    assert 0 < len(looked_at) < 0.3 * targets.is_line.sum()


def test_what_is_remembered_is_one_shapes_own() -> None:
    targets, shapes = scattered(20 * RUN), turned_shapes()
    rows, distances = near_distances(shapes, 0, targets)
    assert near_distances(shapes, 0, targets)[0] is rows
    for other in (
        replace(shapes, kinds=np.full(3, Kind.CYLINDER, np.uint8)),
        replace(shapes, centers=shapes.centers + 1e-3),
        replace(shapes, halves=1.01 * shapes.halves),
        shapes.select(np.array([1])),
    ):
        found = near_distances(other, 0, targets)
        np.testing.assert_array_equal(found[1], distances_from(other, 0, targets)[found[0]])
        assert not np.array_equal(found[1], distances)


def test_only_the_shapes_asked_for_last_are_remembered() -> None:
    targets = scattered(4)
    balls = make_shapes(
        Kind.SPHERE, np.random.default_rng(2).random((MOST_KNOWN + 2, 3)), np.eye(3), np.full(3, 0.01)
    )
    first = near_distances(balls, 0, targets)
    for i in range(MOST_KNOWN):
        near_distances(balls, i, targets)
    assert len(targets.known) == MOST_KNOWN
    near_distances(balls, 0, targets)
    near_distances(balls, MOST_KNOWN, targets)
    assert near_distances(balls, 0, targets)[0] is first[0]
    near_distances(balls, 1, targets)
    assert len(targets.known) == MOST_KNOWN


def test_a_merge_costs_what_the_error_rises_by() -> None:
    """Whichever of the two, or of the others, was the nearest and the second nearest before."""
    targets, rng = scattered(20 * RUN), np.random.default_rng(3)
    boxes = make_shapes(Kind.BOX, 0.3 + 0.4 * rng.random((5, 3)), np.eye(3), rng.uniform(0.05, 0.2, (5, 3)))
    steps = find_merges(boxes, distance_table(boxes, targets), targets, kept=0)
    assert len(steps) >= 5
    for rise, pair, merged in steps:
        assert merged is not None
        after = join([boxes.select(np.setdiff1d(np.arange(5), pair)), merged])
        assert rise == pytest.approx(error(after, targets) - error(boxes, targets), abs=1e-9)
