"""What a set is fitted to: distances that are known at surfaces (zero) and in the free air (to the surface).

One error serves every step of the method, from the choice of candidates to the joint refinement:

    E(S) = sum_i w_i rho(min(d_S(x_i), cap_i) - D_i)
    rho(r) = sqrt(r^2 + soft^2) - soft, times `STICKS_OUT` for r < 0

Where neither surface nor free air is, nothing is asked for: a wall seen from one side may be as thick as it
likes, and a solid may be one box however hollow it was modelled.

Rays are targets too. A ray leaks when it runs on for a certain *way* behind the surface that it hit and meets
no primitive there. So what counts is the distance of the set from that way, and it saturates: a leak is a
leak, however near the set lies.

    rho(r) = e / (1 + e / leak), e = sqrt(max(r, 0)^2 + soft^2) - soft

Before that surface the ray must pass: what stops it there costs as much as a leak. No distance tells of a
thin sheet across a door; only the ray does. So whole rays are targets as well, *lines*, whose distance is how
much farther than the surface they meet the set: they are charged for meeting it too early, or too late.

Of air inside the set it counts once more, in the same saturating way, that it is `filled`: a place is, or it
is not.

Of points inside a solid (D < 0) only what is farther out counts: a union's distance there is a bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.scene import Float64
from fit.shapes import Shapes, distances_to_one
from fit.spans import cross, entries_of_one

STICKS_OUT = 1.3
"""Error of a set nearer than the surface (it darkens the air) against one that is farther (it leaks)."""

PLACES = (0.0, 0.5, 1.0)
"""Where along a ray's way the set's distance is taken; the least of them is the ray's."""

RUN = 64
"""Targets on end that are searched together; `fit.targets` puts neighbours in space side by side."""

MOST_KNOWN = 4096
"""Shapes whose distances from the targets are remembered: 50 MB, and eight sets of the largest budget."""

_SCALARS = ("reach", "soft", "leak", "slack")

Rows = NDArray[np.integer] | slice


@dataclass(frozen=True)
class Targets:
    """p points (p, 3) whose distance to the surface is known: distances (p,), weights (p,); normals (p, 3)
    toward the air, zero where there is none to tell; sample (p,) row of the surface samples that a point is,
    else -1; caps (p,): farther distances count as this one, at most `reach`; ways (p, 3): of rays, to where
    they have leaked, from the hit or, is_line (p,) bool, from their start; late (p,): what a line costs that
    leaks, and `weights` what it costs when stopped by more than `slack` before the surface; filled (p,): what
    air inside the set counts beside its distance, in units of `leak`; soft: errors far below count as none;
    leak: distance from which a ray's error hardly grows."""

    points: Float64
    distances: Float64
    weights: Float64
    normals: Float64
    sample: NDArray[np.int64]
    caps: Float64
    ways: Float64
    is_line: NDArray[np.bool_]
    late: Float64
    filled: Float64
    reach: float
    soft: float
    leak: float
    slack: float

    def __len__(self) -> int:
        return len(self.points)

    @property
    def is_surface(self) -> NDArray[np.bool_]:
        return self.sample >= 0

    @cached_property
    def is_ray(self) -> NDArray[np.bool_]:
        """Rays behind their hits, where something must stop them."""
        return np.asarray(self.ways.any(axis=1)) & ~self.is_line

    @cached_property
    def one_sided(self) -> NDArray[np.bool_]:
        """Where the set may be nearer, or deeper, at no cost."""
        return self.is_ray | self.is_line | (self.distances < 0)

    @property
    def places(self) -> tuple[Float64, NDArray[np.int64]]:
        """All points (q, 3) at which distances are taken, and the target (q,) that each belongs to."""
        rays = np.flatnonzero(self.is_ray)
        further = [self.points[rays] + share * self.ways[rays] for share in PLACES[1:]]
        rows = [np.arange(len(self)), *[rays] * len(further)]
        return np.concatenate([self.points, *further]), np.concatenate(rows)

    @cached_property
    def runs(self) -> tuple[Float64, Float64]:
        """Bounds (k, 3) of each `RUN` rows on end, with the ways of rays, but for lines."""
        starts, lines = np.arange(0, len(self), RUN), self.is_line[:, None]
        lower, upper = np.where(lines, np.inf, self._bounds[0]), np.where(lines, -np.inf, self._bounds[1])
        return np.minimum.reduceat(lower, starts), np.maximum.reduceat(upper, starts)

    @cached_property
    def lines(self) -> tuple[NDArray[np.int64], Float64, Float64]:
        """Rows (f,) of the lines, and their bounds (3, f)."""
        rows = np.flatnonzero(self.is_line)
        lower, upper = (np.ascontiguousarray(bound[rows].T) for bound in self._bounds)
        return rows, lower, upper

    @property
    def _bounds(self) -> tuple[Float64, Float64]:
        ends = self.points + self.ways
        return np.minimum(self.points, ends), np.maximum(self.points, ends)

    @cached_property
    def known(self) -> dict[bytes, tuple[NDArray[np.int64], Float64]]:
        """What `near_distances` has found for the shapes asked for last, by their bytes."""
        return {}

    def select(self, index: NDArray[np.generic] | slice) -> Targets:
        rows = {f.name: getattr(self, f.name)[index] for f in fields(self) if f.name not in _SCALARS}
        return replace(self, **rows)


def join_targets(several: Sequence[Targets]) -> Targets:
    """All rows of targets that agree about their scalars."""
    names = [f.name for f in fields(Targets) if f.name not in _SCALARS]
    rows: dict[str, Any] = {k: np.concatenate([getattr(t, k) for t in several]) for k in names}
    return replace(several[0], **rows)


def thin(targets: Targets, every: int) -> Targets:
    """One target of so many, which stands for them all."""
    few = targets.select(slice(None, None, every))
    return replace(few, weights=few.weights * every, late=few.late * every)


def penalties(targets: Targets, distances: Float64, rows: Rows = slice(None)) -> Float64:
    """Weighted error (k,) of the targets `rows` when the set is at these signed distances (k,)."""
    is_line = targets.is_line[rows]
    if is_line.all():
        early, late = distances < -targets.slack, distances > targets.slack
        return targets.weights[rows] * early + targets.late[rows] * late
    residual, error = _residuals(targets, distances, rows)
    error = np.where(targets.is_ray[rows], error / (1 + error / targets.leak), error)
    error *= np.where(residual < 0, STICKS_OUT, 1.0)
    depth = np.clip(-distances, 0.0, targets.reach)
    error = targets.weights[rows] * (error + targets.filled[rows] * depth / (1 + depth / targets.leak))
    if is_line.any():
        index = np.arange(len(targets))[rows][is_line]
        error[is_line] = penalties(targets, distances[is_line], index)
    return error


def penalty_slopes(targets: Targets, distances: Float64, rows: Rows = slice(None)) -> Float64:
    """Derivative (k,) of `penalties` by the distance."""
    residual, error = _residuals(targets, distances, rows)
    slope = residual / (error + targets.soft)
    slope = np.where(targets.is_ray[rows], slope / (1 + error / targets.leak) ** 2, slope)
    slope *= np.where(residual < 0, STICKS_OUT, 1.0)
    depth = np.maximum(-distances, 0.0)
    slope -= np.where(depth > 0, targets.filled[rows] / (1 + depth / targets.leak) ** 2, 0.0)
    slope[targets.is_line[rows] | (distances >= targets.caps[rows]) | (distances <= -targets.reach)] = 0.0
    return targets.weights[rows] * slope


def _residuals(targets: Targets, distances: Float64, rows: Rows) -> tuple[Float64, Float64]:
    """Signed residual and soft absolute error (k,)."""
    residual = np.clip(distances, -targets.reach, targets.caps[rows]) - targets.distances[rows]
    residual = np.where(targets.one_sided[rows], np.maximum(residual, 0.0), residual)
    return residual, np.sqrt(residual * residual + targets.soft**2) - targets.soft


def near_rows(shapes: Shapes, which: int, targets: Targets, within: float) -> NDArray[np.int64]:
    """Rows, sorted, among which are all targets nearer to one shape than `within`, and the lines it stops.

    Each run has a bound, and so has each line, which may be long.
    """
    lower, upper = targets.runs
    half = np.abs(shapes.frames[which]) @ shapes.halves[which]
    low, high = shapes.centers[which] - half, shapes.centers[which] + half
    gap = np.maximum(lower - high, low - upper)
    near = np.flatnonzero((np.maximum(gap, 0.0) ** 2).sum(axis=1) < within * within)
    rows = (near[:, None] * RUN + np.arange(RUN)).ravel()
    rows = rows[: np.searchsorted(rows, len(targets))]
    lines, lower, upper = targets.lines
    if len(lines) == 0:
        return rows
    met = (lower[0] < high[0]) & (upper[0] > low[0])
    for axis in (1, 2):
        met &= (lower[axis] < high[axis]) & (upper[axis] > low[axis])
    is_near = np.zeros(len(targets), bool)
    is_near[rows] = True
    is_near[lines[met]] = True
    return np.flatnonzero(is_near)


def distances_from(shapes: Shapes, which: int, targets: Targets, rows: Rows = slice(None)) -> Float64:
    """Signed distance (k,) of one shape from targets: from points, or the nearest place of rays' ways.

    Of lines it is how far behind the surface they enter the shape, `reach` where they don't.
    """
    points, is_ray, is_line = targets.points[rows], targets.is_ray[rows], targets.is_line[rows]
    if is_line.all():
        return _behind(shapes, which, points, targets.ways[rows], targets)
    if is_line.any():
        distances = np.empty(len(points))
        distances[~is_line] = distances_to_one(shapes, which, points[~is_line])
        distances[is_line] = _behind(shapes, which, points[is_line], targets.ways[rows][is_line], targets)
    else:
        distances = distances_to_one(shapes, which, points)
    rays = np.flatnonzero(is_ray)
    if len(rays):
        starts, ways = points[rays], targets.ways[rows][rays]
        for share in PLACES[1:]:
            behind = distances_to_one(shapes, which, starts + share * ways)
            distances[rays] = np.minimum(distances[rays], behind)
    return distances


def _behind(shapes: Shapes, which: int, starts: Float64, ways: Float64, targets: Targets) -> Float64:
    """How far (k,) behind the surface lines enter one shape; their ways (k, 3) end `slack` behind it."""
    share = np.minimum(entries_of_one(shapes, which, starts, ways), 2.0)
    behind = (share - 1) * np.linalg.norm(ways, axis=1) + targets.slack
    return np.where(share <= 1, np.maximum(behind, -targets.reach), targets.reach)


def near_distances(shapes: Shapes, which: int, targets: Targets) -> tuple[NDArray[np.int64], Float64]:
    """Rows (k,), sorted, of the targets nearer to one shape than `reach`, and its signed distances (k,).

    They are remembered: most shapes of a set outlast a step, and candidates are on offer again and again.
    """
    columns = shapes.kinds, shapes.centers, shapes.frames, shapes.halves
    key = b"".join(column[which].tobytes() for column in columns)
    found = targets.known.pop(key, None)
    if found is None:
        rows = near_rows(shapes, which, targets, targets.reach)
        distances = distances_from(shapes, which, targets, rows)
        near = np.flatnonzero(distances < targets.reach)
        found = rows[near], distances[near]
        if len(targets.known) >= MOST_KNOWN:
            del targets.known[next(iter(targets.known))]
    targets.known[key] = found
    return found


def distance_table(shapes: Shapes, targets: Targets, dtype: type[np.floating] = np.float64) -> NDArray[Any]:
    """Signed distances (n, p) of each shape from each target, no more than `reach`."""
    table = np.full((len(shapes), len(targets)), targets.reach, dtype)
    for i in range(len(shapes)):
        rows, distances = near_distances(shapes, i, targets)
        table[i, rows] = distances
    return table


def set_distances(shapes: Shapes, targets: Targets) -> Float64:
    """Signed distance (p,) of the union from the targets, no more than `reach`."""
    distances = np.full(len(targets), targets.reach)
    for i in range(len(shapes)):
        rows, own = near_distances(shapes, i, targets)
        distances[rows] = np.minimum(distances[rows], own)
    return distances


def leak_share(shapes: Shapes, targets: Targets) -> float:
    """Share of the rays that leak: no shape stops them on their way, nor is one as near as makes no odds.

    E looks at three places of the way alone. Told of every sheet in between, which has no slope to follow,
    the set of Sponza came out worse in all but that.
    """
    rays = targets.select(targets.is_ray)
    leaking = set_distances(shapes, rays) > targets.soft
    for i in range(len(shapes)):
        leaking[leaking] = ~cross(shapes, i, rays.points[leaking], rays.ways[leaking])
    return float(leaking.mean()) if len(rays) else 0.0


def leaking_lines(shapes: Shapes, targets: Targets) -> float:
    """Share of the lines that meet the surface which the set lets pass it by more than `slack`."""
    lines = targets.select(np.flatnonzero(targets.is_line & (targets.late > 0)))
    return float((set_distances(shapes, lines) > targets.slack).mean()) if len(lines) else 0.0


def error(shapes: Shapes, targets: Targets) -> float:
    """E(S)."""
    return float(penalties(targets, set_distances(shapes, targets)).sum())
