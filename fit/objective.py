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
thin sheet across a door; only the ray does.

Of air inside the set it counts once more, in the same saturating way, that it is filled.

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
from fit.shapes import Shapes, cross, distances_to_one

STICKS_OUT = 1.3
"""Error of a set nearer than the surface (it darkens the air) against one that is farther (it leaks)."""

FILLED = 40.0
"""Error of air inside the set, beside that of its distance: a place is filled or it is not."""

PLACES = (0.0, 0.5, 1.0)
"""Where along a ray's way the set's distance is taken; the least of them is the ray's."""

RUN = 64
"""Targets on end that are searched together; `fit.targets` puts neighbours in space side by side."""

_SCALARS = ("reach", "soft", "leak")

Rows = NDArray[np.integer] | slice


@dataclass(frozen=True)
class Targets:
    """p points (p, 3) whose distance to the surface is known: distances (p,), weights (p,); normals (p, 3)
    toward the air, zero where there is none to tell; sample (p,) row of the surface samples that a point is,
    else -1; caps (p,): farther distances count as this one, at most `reach`; ways (p, 3): of rays, from the
    hit to where the ray has leaked, zero for all but rays; passing (p,) bool: ways from where a ray starts to
    short of its hit, which must be free; soft: errors far below count as none; leak: distance
    from which a ray's error hardly grows."""

    points: Float64
    distances: Float64
    weights: Float64
    normals: Float64
    sample: NDArray[np.int64]
    caps: Float64
    ways: Float64
    passing: NDArray[np.bool_]
    reach: float
    soft: float
    leak: float

    def __len__(self) -> int:
        return len(self.points)

    @property
    def is_surface(self) -> NDArray[np.bool_]:
        return self.sample >= 0

    @cached_property
    def is_ray(self) -> NDArray[np.bool_]:
        """Rays behind their hits, where something must stop them."""
        return np.asarray(self.ways.any(axis=1)) & ~self.passing

    @cached_property
    def one_sided(self) -> NDArray[np.bool_]:
        """Where the set may be nearer, or deeper, at no cost."""
        return self.is_ray | self.passing | (self.distances < 0)

    @property
    def places(self) -> tuple[Float64, NDArray[np.int64]]:
        """All points (q, 3) at which distances are taken, and the target (q,) that each belongs to."""
        rays = np.flatnonzero(self.is_ray)
        further = [self.points[rays] + share * self.ways[rays] for share in PLACES[1:]]
        rows = [np.arange(len(self)), *[rays] * len(further)]
        return np.concatenate([self.points, *further]), np.concatenate(rows)

    @cached_property
    def runs(self) -> tuple[Float64, Float64]:
        """Bounds (k, 3) of each `RUN` rows on end, the rays' ways among them."""
        starts = np.arange(0, len(self), RUN)
        ends = self.points + self.ways
        lower, upper = np.minimum(self.points, ends), np.maximum(self.points, ends)
        return np.minimum.reduceat(lower, starts), np.maximum.reduceat(upper, starts)

    def select(self, index: NDArray[np.generic] | slice) -> Targets:
        rows = {f.name: getattr(self, f.name)[index] for f in fields(self) if f.name not in _SCALARS}
        return replace(self, **rows)


def join_targets(several: Sequence[Targets]) -> Targets:
    """All rows of targets that agree about reach, soft and leak."""
    names = [f.name for f in fields(Targets) if f.name not in _SCALARS]
    rows: dict[str, Any] = {k: np.concatenate([getattr(t, k) for t in several]) for k in names}
    return replace(several[0], **rows)


def penalties(targets: Targets, distances: Float64, rows: Rows = slice(None)) -> Float64:
    """Weighted error (k,) of the targets `rows` when the set is at these signed distances (k,)."""
    residual, error = _residuals(targets, distances, rows)
    error = np.where(targets.is_ray[rows], error / (1 + error / targets.leak), error)
    error *= np.where(residual < 0, STICKS_OUT, 1.0)
    error = np.where(targets.passing[rows], targets.leak * (distances < 0), error)
    depth = np.where(targets.distances[rows] > 0, np.clip(-distances, 0.0, targets.reach), 0.0)
    return targets.weights[rows] * (error + FILLED * depth / (1 + depth / targets.leak))


def penalty_slopes(targets: Targets, distances: Float64, rows: Rows = slice(None)) -> Float64:
    """Derivative (k,) of `penalties` by the distance."""
    residual, error = _residuals(targets, distances, rows)
    slope = residual / (error + targets.soft)
    slope = np.where(targets.is_ray[rows], slope / (1 + error / targets.leak) ** 2, slope)
    slope *= np.where(residual < 0, STICKS_OUT, 1.0)
    depth = np.where(targets.distances[rows] > 0, np.maximum(-distances, 0.0), 0.0)
    slope -= np.where(depth > 0, FILLED / (1 + depth / targets.leak) ** 2, 0.0)
    slope[targets.passing[rows] | (distances >= targets.caps[rows]) | (distances <= -targets.reach)] = 0.0
    return targets.weights[rows] * slope


def _residuals(targets: Targets, distances: Float64, rows: Rows) -> tuple[Float64, Float64]:
    """Signed residual and soft absolute error (k,)."""
    residual = np.clip(distances, -targets.reach, targets.caps[rows]) - targets.distances[rows]
    residual = np.where(targets.one_sided[rows], np.maximum(residual, 0.0), residual)
    return residual, np.sqrt(residual * residual + targets.soft**2) - targets.soft


def near_rows(shapes: Shapes, which: int, targets: Targets, within: Float64 | float) -> NDArray[np.int64]:
    """Rows, sorted, among which are all targets nearer to one shape than `within`: a bound for each run."""
    lower, upper = targets.runs
    half = np.abs(shapes.frames[which]) @ shapes.halves[which]
    gap = np.maximum(lower - (shapes.centers[which] + half), (shapes.centers[which] - half) - upper)
    near = np.flatnonzero((np.maximum(gap, 0.0) ** 2).sum(axis=1) < within * within)
    rows = (near[:, None] * RUN + np.arange(RUN)).ravel()
    return rows[: np.searchsorted(rows, len(targets))]


def distances_from(shapes: Shapes, which: int, targets: Targets, rows: Rows = slice(None)) -> Float64:
    """Signed distance (k,) of one shape from targets: from points, or the nearest place of rays' ways.

    A way that must be free is known only to be so or not: `reach`, or minus that.
    """
    points, is_ray = targets.points[rows], targets.is_ray[rows]
    distances = distances_to_one(shapes, which, points)
    passing = np.flatnonzero(targets.passing[rows])
    if len(passing):
        stopped = cross(shapes, which, points[passing], targets.ways[rows][passing])
        distances[passing] = np.where(stopped, -targets.reach, targets.reach)
    rays = np.flatnonzero(is_ray)
    if len(rays):
        starts, ways = points[rays], targets.ways[rows][rays]
        for share in PLACES[1:]:
            behind = distances_to_one(shapes, which, starts + share * ways)
            distances[rays] = np.minimum(distances[rays], behind)
    return distances


def distance_table(shapes: Shapes, targets: Targets) -> Float64:
    """Signed distances (n, p) of each shape from each target, no more than `reach`."""
    table = np.full((len(shapes), len(targets)), targets.reach)
    for i in range(len(shapes)):
        rows = near_rows(shapes, i, targets, targets.reach)
        table[i, rows] = np.minimum(distances_from(shapes, i, targets, rows), targets.reach)
    return table


def set_distances(shapes: Shapes, targets: Targets) -> Float64:
    """Signed distance (p,) of the union from the targets, no more than `reach`."""
    distances = np.full(len(targets), targets.reach)
    for i in range(len(shapes)):
        rows = near_rows(shapes, i, targets, targets.reach)
        distances[rows] = np.minimum(distances[rows], distances_from(shapes, i, targets, rows))
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


def error(shapes: Shapes, targets: Targets) -> float:
    """E(S)."""
    return float(penalties(targets, set_distances(shapes, targets)).sum())
