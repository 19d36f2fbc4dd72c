"""Growth under a budget: it never gets worse, merges, cuts, and closes what rays leak through."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from fit.build import Enough, Sources, build
from fit.choose import without_least
from fit.cut import cut_worst
from fit.merge import thin_out
from fit.objective import Targets, error, join_targets, leak_share, penalties, penalty_slopes
from fit.primitives import Kind
from fit.refine import refine
from fit.settings import FitSettings
from fit.shapes import Shapes, join, make_shapes, no_shapes
from fit.targets import along_a_curve

REACH = 2.0


def box(center: tuple[float, float, float], halves: tuple[float, float, float]) -> Shapes:
    return make_shapes(Kind.BOX, np.array([center]), np.eye(3), np.array(halves))


def points_on(truth: Shapes, count: int = 1500, seed: int = 0) -> Targets:
    """Points in the air around boxes that do not meet, with their distances, and points on the boxes."""
    rng = np.random.default_rng(seed)
    lower = (truth.centers - truth.halves).min(axis=0) - 1
    upper = (truth.centers + truth.halves).max(axis=0) + 1
    air = rng.uniform(lower, upper, (count, 3))
    which = rng.integers(len(truth), size=count)
    local = rng.uniform(-1, 1, (count, 3))
    axis = rng.integers(3, size=count)
    local[np.arange(count), axis] = np.sign(local[np.arange(count), axis])
    surface = truth.centers[which] + local * truth.halves[which]
    points = np.concatenate([air, surface])
    outside = np.maximum(np.abs(points[:, None] - truth.centers) - truth.halves, 0)
    distances = np.linalg.norm(outside, axis=2).min(axis=1)
    distances[count:] = 0
    kept = np.flatnonzero((distances > 0) | (np.arange(2 * count) >= count))
    rows = len(kept)
    sample = np.where(kept >= count, kept - count, -1)
    blank = np.zeros((rows, 3))
    targets = Targets(
        points[kept], np.minimum(distances[kept], REACH), np.full(rows, 1 / rows), blank, sample,
        np.full(rows, REACH), blank, np.zeros(rows, bool), np.zeros(rows), 40.0 * (distances[kept] > 0),
        REACH, 1e-3, 0.1, 0.1,
    )  # fmt: skip
    return along_a_curve(targets)


def rays_down(count: int, seed: int = 0) -> Targets:
    """Rays that hit the floor y = 0 from above within |x|, |z| < 1, and leak after 0.2."""
    rng = np.random.default_rng(seed)
    points = np.zeros((count, 3))
    points[:, [0, 2]] = rng.uniform(-1, 1, (count, 2))
    return Targets(
        points, np.zeros(count), np.full(count, 1 / count), np.tile([0.0, 1, 0], (count, 1)),
        np.full(count, -1), np.full(count, REACH), np.tile([0.0, -0.2, 0], (count, 1)),
        np.zeros(count, bool), np.zeros(count), np.zeros(count), REACH, 1e-3, 0.1, 0.1,
    )  # fmt: skip


def test_rays_leak_where_the_set_leaves_their_way_open() -> None:
    rays = rays_down(400)
    floor, half = box((0, -0.15, 0), (2, 0.05, 2)), box((-1, -0.15, 0), (1, 0.05, 2))
    assert error(floor, rays) == 0, "the set may lie anywhere on the way"
    assert leak_share(floor, rays) == 0
    assert leak_share(half, rays) == pytest.approx(0.5, abs=0.1)
    assert leak_share(no_shapes(), rays) == 1
    sheet = box((0, -0.05, 0), (2, 1e-5, 2))
    assert leak_share(sheet, rays) == 0, "a sheet between two of the places stops the ray as well"
    below = box((0, -0.5, 0), (2, 0.05, 2))
    assert error(below, rays) > 0.7 * rays.leak * 0.7, "a leak hardly grows with its distance"
    assert error(no_shapes(), rays) < rays.leak


def test_slopes_of_rays_and_of_filled_air_match_finite_differences() -> None:
    air = points_on(box((0, 0, 0), (1, 1, 1)), 200)
    targets = join_targets([rays_down(200), air])
    distances = np.random.default_rng(1).uniform(-1.5, 1.5, len(targets))
    numeric = (penalties(targets, distances + 1e-7) - penalties(targets, distances - 1e-7)) / 2e-7
    np.testing.assert_allclose(penalty_slopes(targets, distances), numeric, atol=1e-6)


TWO_HALVES = [box((-1, 0, 0), (1, 0.1, 1)), box((1, 0, 0), (1, 0.1, 1))]


def test_two_halves_of_a_wall_merge_at_no_cost() -> None:
    wall, pillar = box((0, 0, 0), (2, 0.1, 1)), box((0, 2, 0), (0.2, 1, 0.2))
    targets = points_on(join([wall, pillar]))
    fewer = thin_out(join([*TWO_HALVES, pillar]), targets, count=1)
    assert len(fewer) == 2
    assert error(fewer, targets) < 1e-6
    apart = thin_out(join([*TWO_HALVES, pillar]), targets, count=1, merging=False)
    assert error(apart, targets) > 0.01


def test_shapes_that_are_kept_are_not_thinned_out() -> None:
    targets = points_on(TWO_HALVES[0])
    both = join(TWO_HALVES)
    kept = thin_out(both, targets, count=1, kept=1)
    np.testing.assert_array_equal(kept.centers, both.centers[:1])


def test_a_box_over_two_is_cut() -> None:
    truth = join([box((-1.5, 0, 0), (0.5, 1, 1)), box((1.5, -0.5, 0), (0.5, 0.5, 1))])
    targets = points_on(truth)

    def refined(shapes: Shapes, free: np.ndarray) -> Shapes:
        return refine(shapes, targets, max_step=0.5, evaluations=60, free=free, passes=3)

    one = refined(box((0, 0, 0), (2, 1, 1)), np.ones(1, bool))
    two = cut_worst(one, targets, refined, most=2)
    assert len(two) == 2
    assert error(two, targets) < 0.3 * error(one, targets)
    assert len(cut_worst(one, targets, refined, most=1)) == 1


def blocks(count: int, seed: int = 3) -> Shapes:
    rng = np.random.default_rng(seed)
    places = 3.0 * np.array([[x, y, z] for x in range(3) for y in range(2) for z in range(3)], float)
    halves = rng.uniform(0.3, 1.2, (count, 3))
    return join([box(tuple(c), tuple(h)) for c, h in zip(places[:count], halves, strict=True)])


@pytest.fixture(scope="module")
def sources() -> Sources:
    """Boxes around the true ones, none of them right."""
    rng = np.random.default_rng(5)
    truth = blocks(14)
    several = [
        box(tuple(c), tuple(h)) for c, h in zip(
            np.repeat(truth.centers, 4, axis=0) + rng.uniform(-0.3, 0.3, (56, 3)),
            np.repeat(truth.halves, 4, axis=0) * rng.uniform(0.5, 1.2, (56, 3)), strict=True,
        )
    ]  # fmt: skip
    return Sources(join(several), np.ones(56), {})


def test_no_budget_is_worse_than_a_smaller_one(sources: Sources) -> None:
    targets = points_on(blocks(14), 800)
    limits, errors = (1, 3, 4, 5, 7, 8, 9, 11, 12, 13, 16), []
    for limit in limits:
        shapes = build(targets, sources, no_shapes(), limit=limit, max_step=0.3, enough=Enough(1e-5))
        assert len(shapes) <= limit
        errors.append(error(shapes, targets))
    assert all(after <= before for before, after in pairwise(errors)), errors
    assert errors[-1] < 0.1 * errors[2]


def test_leaks_keep_the_growth_going(sources: Sources) -> None:
    targets = points_on(blocks(14), 800)
    rays = replace(
        targets.select(targets.is_surface), ways=np.tile([0.0, 0.05, 0], (int(targets.is_surface.sum()), 1)),
        sample=np.full(int(targets.is_surface.sum()), -1),
    )  # fmt: skip
    targets = along_a_curve(join_targets([targets, rays]))
    sparing = build(targets, sources, no_shapes(), limit=16, max_step=0.3, enough=Enough(0.1))
    closing = build(
        targets, sources, no_shapes(), limit=16, max_step=0.3,
        enough=Enough(0.1, least_gain_leaking=1e-5, most_leaks=0.05),
    )  # fmt: skip
    assert len(closing) > len(sparing)
    assert leak_share(closing, targets) < leak_share(sparing, targets)


def test_good_enough_sets_are_as_small_as_they_may_be(sources: Sources) -> None:
    targets = points_on(blocks(14), 800)
    bound = 0.3 * error(no_shapes(), targets)
    enough = Enough(1e-5, good=lambda shapes: error(shapes, targets) <= bound)
    shapes = build(targets, sources, no_shapes(), limit=16, max_step=0.3, enough=enough)
    assert error(shapes, targets) <= bound
    assert error(without_least(shapes, targets, 0)[0], targets) > bound


def test_every_cap_is_a_budget() -> None:
    """So many bytes ask for the same set as so many primitives."""
    by_count, by_bytes = FitSettings(max_primitives=64), FitSettings(max_bytes=4096)
    assert by_bytes.limit() == by_count.limit() == 64
    assert by_bytes.least_gain() == by_count.least_gain() < FitSettings().least_gain()


@pytest.mark.parametrize(
    "wrong", [{"resolution": 0}, {"kinds": ()}, {"skip_below": -1.0}, {"max_leaks": -0.1}]
)
def test_settings_without_sense_are_refused(wrong: dict) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        FitSettings(**wrong)
