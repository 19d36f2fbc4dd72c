"""A closed body as few solids: started from its volume, fitted by the volume in which they differ.

The points inside fall into clusters (Lloyd's iterations), more than asked for. Each becomes the box of its
moments; all descend together; kinds change where another kind fits better; the least useful shapes go until
the count is right; then, round by round, some of the least useful move to where most is missing.
"""

from __future__ import annotations

import heapq
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fit.descend import descend_alone, descend_together
from fit.inscribe import inscribe
from fit.occupancy import (
    BAND_CELLS,
    Occupancy,
    difference,
    distance_table,
    nearest,
    sample_occupancy,
    worths,
)
from fit.primitives import Kind
from fit.scene import Float64
from fit.shapes import Shapes, join, make_shapes, no_shapes
from fit.solid import Solid
from fit.spaces import Air

OVER = 1.5
"""Clusters at the start for one shape at the end: dropping the least useful beats growing to the count."""

SHRINK = 0.9
"""Most shapes kept from one descent to the next on the way to the count."""

POINTS_PER_SHAPE, LEAST_POINTS, MOST_POINTS = 400, 5_000, 40_000
"""Near the surface, while searching. Fewer are overfitted: 9 parameters a shape."""

FAR_SHARE = 2
"""Points near the surface for one that is deep inside, and for one far outside, while searching."""

FINAL_POINTS, START_POINTS = 2, 2
"""Times as many in the last descent, and that share of them at the start."""

ROUNDS, SWAP_ROUND, PATIENCE = 12, 3, 2
"""Rounds of moving at most; the one that also swaps kinds; how many in a row may fail."""

MOVED = 1 / 8
"""Share of the shapes that a round may move."""

INSCRIBED_SEEDS, INSCRIBED_IN_GAPS = 150, 6
"""Points inside that shapes are inscribed around, at the start and in a round."""

CHOICE_POINTS = 5_000
"""On which the first choice among many candidates is made."""

_CLUSTER_POINTS = 5_000
_LLOYD_STEPS = 12
_LEAST_CLUSTER = 6


def fit_body(solid: Solid, air: Air, limit: int, *, seed: int = 0) -> Shapes:
    """At most `limit` shapes whose union is nearly the solid."""
    rng = np.random.default_rng(seed)
    near = int(np.clip(POINTS_PER_SHAPE * limit, LEAST_POINTS, MOST_POINTS))
    final = sample_occupancy(solid, air, FINAL_POINTS * near, near // FAR_SHARE, seed)
    occupancy = final.select(slice(None, None, FINAL_POINTS), 1 / FINAL_POINTS)
    if not occupancy.inside.any():
        return no_shapes()
    coarse = occupancy.select(slice(None, None, START_POINTS), 1 / START_POINTS)
    wide = replace(coarse, band=BAND_CELLS * air.cell)
    count = int(OVER * limit)
    starts = [_clustered(wide, count, rng), _inscribed(solid, wide, count, rng)]
    best = min(starts, key=lambda shapes: difference(shapes, wide))
    shapes = shrink(best, coarse, limit)
    swapped = descend_together(swap_kinds(shapes, occupancy), occupancy, 12)
    shapes = min(shapes, swapped, key=lambda shapes: difference(shapes, occupancy))
    shapes = _move(solid, shapes, occupancy, limit, rng)
    return descend_together(shapes, final, 30)


def _clustered(occupancy: Occupancy, count: int, rng: np.random.Generator) -> Shapes:
    rows = np.flatnonzero(occupancy.inside)
    chance = occupancy.volumes[rows] / occupancy.volumes[rows].sum()
    points = occupancy.points[rows[rng.choice(len(rows), _CLUSTER_POINTS, p=chance)]]
    label = _lloyd(points, count, rng)
    clusters = [points[label == k] for k in range(int(label.max()) + 1)]
    boxes = [of_moments(c, Kind.BOX) for c in clusters if len(c) >= _LEAST_CLUSTER]
    shapes = descend_together(join(boxes), occupancy, 10)
    return descend_together(swap_kinds(shapes, occupancy), occupancy, 8)


def _inscribed(solid: Solid, occupancy: Occupancy, count: int, rng: np.random.Generator) -> Shapes:
    """Those of all shapes inscribed around points inside that together fill it best."""
    rows = np.flatnonzero(occupancy.inside)
    chance = occupancy.volumes[rows] / occupancy.volumes[rows].sum()
    seeds = occupancy.points[rows[rng.choice(len(rows), INSCRIBED_SEEDS, p=chance)]]
    share = min(1.0, CHOICE_POINTS / len(occupancy))
    thin = occupancy.select(slice(None, None, max(1, round(1 / share))), share)
    shapes = choose(no_shapes(), inscribe(solid, seeds), thin, count)
    return descend_together(shapes, occupancy, 15)


def choose(shapes: Shapes, candidates: Shapes, occupancy: Occupancy, count: int) -> Shapes:
    """The shapes and up to `count` candidates, each the one that then takes off most of the difference.

    Lazy (Minoux 1978): a gain can hardly rise as others are taken.
    """
    distances = nearest(shapes, occupancy)[1]
    table = distance_table(candidates, occupancy)
    rows = [np.flatnonzero(row < distances) for row in table]

    def gain(i: int) -> float:
        before = occupancy.differences_at(rows[i], distances[rows[i]])
        after = occupancy.differences_at(rows[i], np.minimum(distances[rows[i]], table[i, rows[i]]))
        return float((before - after).sum())

    queue = [(-gain(i), i) for i in range(len(candidates))]
    heapq.heapify(queue)
    chosen: list[int] = []
    while queue and len(chosen) < count:
        _, i = heapq.heappop(queue)
        fresh = gain(i)
        if fresh <= 0:
            continue
        if queue and -fresh > queue[0][0]:
            heapq.heappush(queue, (-fresh, i))
            continue
        chosen.append(i)
        distances[rows[i]] = np.minimum(distances[rows[i]], table[i, rows[i]])
    return join([shapes, candidates.select(np.array(chosen, np.int64))])


def _lloyd(points: Float64, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """The cluster (p,) of each point: k-means, seeded by k-means++ (Arthur and Vassilvitskii 2007)."""
    centers = points[rng.integers(len(points), size=1)]
    squared = ((points - centers[0]) ** 2).sum(axis=1)
    while len(centers) < count and squared.sum() > 0:
        chosen = points[rng.choice(len(points), p=squared / squared.sum())]
        centers = np.concatenate([centers, chosen[None]])
        squared = np.minimum(squared, ((points - chosen) ** 2).sum(axis=1))
    for _ in range(_LLOYD_STEPS):
        label = cKDTree(centers).query(points)[1]
        size = np.bincount(label, minlength=len(centers))
        sums = np.stack([np.bincount(label, points[:, k], len(centers)) for k in range(3)], axis=1)
        centers = np.where(size[:, None] > 0, sums / np.maximum(size, 1)[:, None], centers)
    return label.astype(np.int64)


def of_moments(points: Float64, kind: Kind) -> Shapes:
    """The shape of a kind with the centre and about the second moments of the points (p, 3)."""
    center = points.mean(axis=0)
    offset = points - center
    moments, axes = np.linalg.eigh(offset.T @ offset / len(points))
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    moments = np.maximum(moments, 1e-4 * max(float(moments[-1]), np.finfo(float).tiny))
    around = 0 if moments[1] * moments[1] > moments[0] * moments[2] else 2  # the axis unlike the others
    return _with_moments(kind, center, axes, moments, around)


def _with_moments(kind: Kind, center: Float64, frame: Float64, moments: Float64, axis: int) -> Shapes:
    if kind == Kind.BOX:
        halves = np.sqrt(3 * moments)
    elif kind == Kind.SPHERE:
        halves = np.full(3, np.sqrt(5 * moments.mean()))
    else:
        order = [(axis + 2) % 3, axis, (axis + 1) % 3]
        frame, moments = frame[:, order], moments[order]
        radius = np.sqrt(2 * (moments[0] + moments[2]))
        halves = np.array([radius, np.sqrt(3 * moments[1]), radius])
    return make_shapes(kind, center[None], frame, halves)


def other_kinds(shapes: Shapes, which: int) -> list[Shapes]:
    """The other kinds with about the moments of one shape: of a box, the cylinders along its three axes."""
    kind, halves = shapes.kinds[which], shapes.halves[which]
    spread = {Kind.BOX: (3, 3, 3), Kind.SPHERE: (5, 5, 5), Kind.CYLINDER: (4, 3, 4)}[Kind(kind)]
    moments = halves**2 / np.array(spread)
    place = shapes.centers[which], shapes.frames[which], moments
    axes = (0, 1, 2) if kind == Kind.BOX else (1,)
    found = [_with_moments(Kind.CYLINDER, *place, axis) for axis in axes if kind != Kind.CYLINDER]
    return found + [_with_moments(k, *place, 1) for k in (Kind.BOX, Kind.SPHERE) if k != kind]


def swap_kinds(shapes: Shapes, occupancy: Occupancy) -> Shapes:
    """The set with each shape of the kind that serves best beside the others."""
    table = distance_table(shapes, occupancy)
    owners = table.argmin(axis=0)
    first, second = (
        np.partition(table, 1, axis=0)[:2] if len(table) > 1 else (table[0], np.full(table.shape[1], np.inf))
    )
    trials: list[Shapes] = []
    owner: list[int] = []
    rests: list[Float64] = []
    for i in range(len(shapes)):
        rest = np.where(owners == i, second, first)
        trials += [shapes.select(np.array([i])), *other_kinds(shapes, i)]
        owner += [i] * (len(trials) - len(owner))
        rests += [rest] * (len(trials) - len(rests))
    fitted, gains = descend_alone(join(trials), rests, occupancy, 10)
    chosen: list[Shapes] = []
    for i in range(len(shapes)):
        own = np.flatnonzero(np.array(owner) == i)
        chosen.append(fitted.select(own[[int(gains[own].argmax())]]))
    return join(chosen)


def shrink(shapes: Shapes, occupancy: Occupancy, limit: int) -> Shapes:
    """The set without its least useful shapes, all others descending after each few."""
    while len(shapes) > limit:
        target = max(limit, min(len(shapes) - 1, int(SHRINK * len(shapes))))
        while len(shapes) > target:
            worth = worths(shapes, occupancy)
            drop = max(1, (len(shapes) - target) // 3)
            shapes = shapes.select(np.sort(np.argsort(worth, kind="stable")[drop:]))
        shapes = descend_together(shapes, occupancy, 6)
    return shapes


def _move(solid: Solid, shapes: Shapes, occupancy: Occupancy, limit: int, rng: np.random.Generator) -> Shapes:
    """Rounds in which the least useful shapes move to where most is missing, where that pays."""
    lowest = difference(shapes, occupancy)
    count = max(1, int(MOVED * len(shapes)))
    failed = 0
    for round in range(ROUNDS):
        worth = worths(shapes, occupancy)
        rest = shapes.select(np.sort(np.argsort(worth, kind="stable")[count:]))
        trial = add_missing(solid, rest, occupancy, limit - len(rest), rng)
        trial = descend_together(trial, occupancy, 12)
        if round == SWAP_ROUND:
            trial = descend_together(swap_kinds(trial, occupancy), occupancy, 12)
        reached = difference(trial, occupancy)
        if reached < lowest:
            shapes, lowest, failed = trial, reached, 0
            continue
        count, failed = max(1, (2 * count) // 3), failed + 1
        if failed > PATIENCE:
            break
    return shapes


SEEDS_PER_SHAPE, LEAST_SEEDS = 3, 20


def add_missing(
    solid: Solid, shapes: Shapes, occupancy: Occupancy, count: int, rng: np.random.Generator
) -> Shapes:
    """The set and up to `count` more shapes, fitted to what it leaves empty; the best ones are taken."""
    distances = nearest(shapes, occupancy, bands=2.0)[1]
    candidates = _candidates(solid, occupancy, distances, max(SEEDS_PER_SHAPE * count, LEAST_SEEDS), rng)
    candidates, _ = descend_alone(candidates, [distances] * len(candidates), occupancy, 12)
    return choose(shapes, candidates, occupancy, count)


def _candidates(
    solid: Solid, occupancy: Occupancy, distances: Float64, count: int, rng: np.random.Generator
) -> Shapes:
    """A box, a sphere and a cylinder of the missing points around each of some of them."""
    gap = np.where(occupancy.inside, np.clip(distances, 0.0, 2 * occupancy.band), 0.0) * occupancy.volumes
    rows = np.flatnonzero(gap > 0)
    if len(rows) == 0:
        return no_shapes()
    seeds = rng.choice(rows, size=min(count, len(rows)), replace=False, p=gap[rows] / gap[rows].sum())
    tree = cKDTree(occupancy.points[rows])
    found = [inscribe(solid, occupancy.points[seeds[:INSCRIBED_IN_GAPS]])]
    for seed in np.sort(seeds):
        radius = 2 * max(-float(occupancy.distances[seed]), min(float(distances[seed]), 4 * occupancy.band))
        cluster = rows[tree.query_ball_point(occupancy.points[seed], radius, return_sorted=True)]
        if len(cluster) < _LEAST_CLUSTER:
            ball = np.full(3, max(-float(occupancy.distances[seed]), 0.3 * occupancy.band))
            found.append(make_shapes(Kind.SPHERE, occupancy.points[seed][None], np.eye(3), ball))
            continue
        found += [of_moments(occupancy.points[cluster], k) for k in (Kind.BOX, Kind.SPHERE, Kind.CYLINDER)]
    return join(found)
