"""Rays that are counted, line by line, and the moves that close what leaks."""

from __future__ import annotations

import numpy as np
import pytest

from fit.build import Scope, Sources
from fit.close import close_leaks
from fit.objective import Targets, error, leaking_lines, thin
from fit.polish import polish
from fit.primitives import Kind
from fit.shapes import Shapes, are_of, join, make_shapes, moved, no_shapes, to_primitives
from fit.spans import cross, entries_of_one
from fit.trace import first_hits

REACH, SLACK = 2.0, 0.1


def box(center: tuple[float, float, float], halves: tuple[float, float, float]) -> Shapes:
    return make_shapes(Kind.BOX, np.array([center]), np.eye(3), np.array(halves))


def lines_down(count: int, *, late: float = 0.0, seed: int = 0) -> Targets:
    """Rays from y = 1 to the floor y = 0 within |x|, |z| < 1; all blocked cost 1, all leaking `late`."""
    points = np.random.default_rng(seed).uniform(-1, 1, (count, 3))
    points[:, 1] = 1
    return Targets(
        points, np.zeros(count), np.full(count, 1 / count), np.tile([0.0, 1, 0], (count, 1)),
        np.full(count, -1), np.full(count, REACH), np.tile([0.0, -1 - SLACK, 0], (count, 1)),
        np.ones(count, bool), np.full(count, late / count), np.zeros(count), REACH, 1e-3, 0.1, SLACK,
    )  # fmt: skip


@pytest.mark.parametrize("kind", [Kind.BOX, Kind.SPHERE, Kind.CYLINDER])
def test_rays_enter_a_shape_where_they_first_hit_it(kind: Kind) -> None:
    rng = np.random.default_rng(2)
    halves = {Kind.BOX: [0.5, 0.2, 0.8], Kind.SPHERE: [0.6] * 3, Kind.CYLINDER: [0.4, 0.9, 0.4]}[kind]
    step = np.zeros((1, 9))
    step[0, 3:6] = rng.normal(size=3)
    shape = moved(make_shapes(kind, np.array([[0.1, -0.2, 0.3]]), np.eye(3), np.array(halves)), step)
    origins, directions = rng.uniform(-2, 2, (3000, 3)), rng.normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    entries = entries_of_one(shape, 0, origins, directions)
    np.testing.assert_allclose(entries, first_hits(to_primitives(shape), origins, directions), atol=1e-9)
    assert 0.02 < np.isfinite(entries).mean() < 0.9
    np.testing.assert_array_equal(cross(shape, 0, origins, 1.5 * directions), entries < 1.5)


def test_rays_along_a_cylinder_are_inside_between_its_caps_or_never() -> None:
    cylinder = make_shapes(Kind.CYLINDER, np.zeros((1, 3)), np.eye(3), np.array([3.0, 1, 3]))
    origins, down = np.array([[2.0, 5, 0], [5.0, 5, 0]]), np.tile([0.0, -1, 0], (2, 1))
    np.testing.assert_array_equal(entries_of_one(cylinder, 0, origins, down), [4, np.inf])


def test_a_thin_sheet_across_a_door_costs_every_ray_that_it_stops() -> None:
    lines = lines_down(400)
    sheet, half = box((0, 0.5, 0), (2, 1e-4, 2)), box((-1, 0.5, 0), (1, 1e-4, 2))
    assert error(no_shapes(), lines) == 0
    assert error(box((0, 0, 0), (2, 0.05, 2)), lines) == 0, "the floor is where they should be stopped"
    assert error(sheet, lines) == pytest.approx(1)
    assert error(half, lines) == pytest.approx((lines.points[:, 0] < 0).mean())
    assert error(join([sheet, half]), lines) == pytest.approx(1), "stopped once is stopped"


def test_a_line_leaks_when_nothing_stops_it_near_the_surface() -> None:
    lines = lines_down(400, late=3)
    half, sheet = box((-1, -0.05, 0), (1, 1e-4, 2)), box((0, -0.05, 0), (2, 1e-4, 2))
    assert error(no_shapes(), lines) == pytest.approx(3)
    assert error(sheet, lines) == 0, "a sheet a little behind the surface stops them in time"
    assert error(half, lines) == pytest.approx(3 * (lines.points[:, 0] > 0).mean())
    assert error(box((0, -0.3, 0), (2, 0.05, 2)), lines) == pytest.approx(3), "too far behind is too late"


def test_closing_moves_a_face_to_where_lines_are_stopped() -> None:
    lines, floor = lines_down(2000, late=3), box((-0.3, -0.05, 0), (0.9, 0.05, 2))
    assert error(floor, lines) > 0.5
    closed = close_leaks(floor, lines, cell=0.4, free=np.ones(1, bool), steps=(1.0, 0.5, 0.25))
    assert error(closed, lines) < 0.01
    assert (closed.centers + closed.halves)[0, 0] > 0.99, "the floor reaches the last line"
    held = close_leaks(floor, lines, cell=0.4, free=np.zeros(1, bool))
    np.testing.assert_array_equal(held.halves, floor.halves)


def test_closing_opens_a_door_that_a_box_reaches_into() -> None:
    lines, lid = lines_down(2000, late=3), box((0, 0.5, 0), (0.5, 0.01, 2))
    floor = box((0, -0.05, 0), (2, 0.05, 2))
    blocked = error(join([floor, lid]), lines)
    free = np.array([False, True])
    opened = close_leaks(join([floor, lid]), lines, cell=0.4, free=free, steps=(1.0, 1.0, 0.5, 0.25))
    assert error(opened, lines) < 0.3 * blocked
    np.testing.assert_array_equal(opened.halves[0], floor.halves[0])


def test_closing_widens_a_sheet_however_thin() -> None:
    lines, sheet = lines_down(2000, late=3), box((-0.3, -0.05, 0), (0.9, 1e-5, 2))
    closed = close_leaks(sheet, lines, cell=0.4, free=np.ones(1, bool))
    assert error(closed, lines) < 0.01 < error(sheet, lines)
    assert closed.halves.min() >= 1e-5


def test_closing_leaves_a_plane_a_plane_where_no_boxes_may_be() -> None:
    lines, sheet = lines_down(500, late=3), box((0, -0.2, 0), (2, 0.01, 2))
    free = np.ones(1, bool)
    assert not are_of(close_leaks(sheet, lines, cell=0.4, free=free), ("plane",)).all()
    assert are_of(close_leaks(sheet, lines, cell=0.4, free=free, kinds=("plane",)), ("plane",)).all()


def test_leaking_lines_are_counted() -> None:
    lines = lines_down(4000, late=3)
    half = box((-1, -0.05, 0), (1, 0.01, 2))
    assert leaking_lines(no_shapes(), lines) == 1
    assert leaking_lines(half, lines) == pytest.approx((lines.points[:, 0] > 0).mean())
    assert leaking_lines(no_shapes(), lines_down(10)) == 0, "lines that may leak are not counted"


def test_thinned_lines_stand_for_all() -> None:
    lines = lines_down(4000, late=3)
    half = box((-1, -0.05, 0), (1, 0.01, 2))
    assert error(half, thin(lines, 4)) == pytest.approx(error(half, lines), rel=0.1)


def test_polish_moves_an_idle_shape_to_where_lines_leak() -> None:
    lines = lines_down(2000, late=3)
    left, right = box((-0.5, -0.05, 0), (0.5, 0.05, 2)), box((0.5, -0.05, 0), (0.5, 0.05, 2))
    idle = box((5, 5, 5), (0.1, 0.1, 0.1))
    sources = Sources(right, np.ones(1), {})

    def polished(scope: Scope) -> Shapes:
        return polish(join([left, idle]), lines, lines, sources, scope, limit=2, cell=0.01)

    assert error(polished(Scope()), lines) < 0.01
    assert error(polished(Scope(steps=("parts",))), lines) > 1, "without teleportation faces alone move"


def test_polish_keeps_what_is_kept() -> None:
    lines = lines_down(500, late=3)
    lamp = box((0, 0.5, 0), (0.3, 0.01, 0.3))
    sources = Sources(box((0, -0.05, 0), (2, 0.05, 2)), np.ones(1), {})
    grown = polish(lamp, lines, lines, sources, Scope(), limit=2, cell=0.4, kept=1)
    np.testing.assert_array_equal(grown.halves[0], lamp.halves[0])
    assert error(grown, lines) <= error(lamp, lines)
    alone = polish(lamp, lines, lines, Sources(no_shapes(), np.zeros(0), {}), Scope(), limit=1, cell=0.4)
    assert error(alone, lines) <= error(lamp, lines), "a set of one shape, too, can be moved"
    assert len(polish(no_shapes(), lines, lines, sources, Scope(), limit=0, cell=0.4)) == 0
