"""The points that a set is fitted to, drawn from the surfaces that air touches and from the air itself."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fit.bvh import morton_code
from fit.objective import Targets, join_targets
from fit.sample import Samples, random_directions, sample_surface
from fit.scene import Float64
from fit.spaces import Air
from fit.surface import Surface

REACH_CELLS = 6
"""Cells of the air's grid beyond which a distance is only 'far': walls are fitted by what is near them."""

SOFT_CELLS = 0.05
"""Errors below this share of a cell are not worth a move."""

NEAR_CELLS = 3
"""Half of the air's points are drawn nearer to a surface than this: there the set can be wrong in detail."""

RAYS = 6_000
"""Rays that the set must stop where the surface does, neither after nor before."""

LEAKS_WEIGHT = 20.0
"""Of all rays together, behind their hits; surface and air weigh 1 each."""

FILLED, FILLED_CLEAR = 40.0, 180.0
"""Errors of air inside the set while it is grown, and once rays are counted where it is clear of any surface:
to fill the air must cost more than the leaks that it closes."""

CLEAR_CELLS = 1.4
"""Cells from a surface beyond which air is clear of it."""

BLOCKED_PRICE = 0.055
"""Of the diagonal: what it costs when all rays are stopped before their hits."""

LEAK_SHARE = 0.01
"""Of the diagonal: a ray that goes on for longer behind its hit has leaked."""

SLACK_REACH = 0.5
"""Of the reach: the most that a line may go on for in a finer grid, or it could not be told from a leak."""

LEAK_CELLS = 0.5
"""A ray that passes the set at this distance costs half of what any leak costs at most."""

LINES = 120_000
"""Rays that are counted: fewer are learned by heart, and others go on leaking."""

_OWN_RAYS, _OWN_LINES = 7_919, 15_485_863
"""Added to the seed: rays that the set is measured with are others."""

_RUN_REACH = 0.25
"""Of the reach: edge of the cells by which targets are ordered."""

RAYS_PER_POINT = 4
"""Rays from each point of the air: more of them make the projected areas of small parts certain."""


@dataclass(frozen=True)
class Seen:
    """The surface as the air sees it: p samples, their normals toward the air, weights that sum to 1.

    Half of the weight is uniform by area, half goes to the first hits of uniform rays from uniform points of
    the air: what light and probes see. by_area (p,) bool tells the first half from the second; projected (t,)
    is each wall triangle's share of those first hits, its *projected area*.
    """

    samples: Samples
    normals: Float64
    weights: Float64
    by_area: NDArray[np.bool_]
    projected: Float64

    def __len__(self) -> int:
        return len(self.samples)


def see_surface(air: Air, count: int, seed: int) -> Seen:
    """About `count` samples of the surface that air touches; a sheet with air on both sides is seen twice."""
    by_area, area_normals = _by_area(air.walls, air, count // 2, seed)
    by_rays, ray_normals, projected = _by_rays(air, count // 2, seed)
    joined = Samples(
        *(
            np.concatenate([getattr(by_area, k), getattr(by_rays, k)])
            for k in ("points", "normals", "triangle", "barycentric")
        )
    )
    weights = np.concatenate([np.full(len(s), 1.0 / max(len(s), 1)) for s in (by_area, by_rays)])
    weights /= max(float(weights.sum()), 1.0)
    is_by_area = np.arange(len(joined)) < len(by_area)
    return Seen(joined, np.concatenate([area_normals, ray_normals]), weights, is_by_area, projected)


def _by_area(surface: Surface, air: Air, count: int, seed: int) -> tuple[Samples, Float64]:
    samples = sample_surface(surface, count, seed)
    side = air.touches(samples.points, samples.normals)
    front, back = np.flatnonzero((side == 1) | (side == 2)), np.flatnonzero((side == -1) | (side == 2))
    rows = np.concatenate([front, back])
    normals = np.concatenate([samples.normals[front], -samples.normals[back]])
    return samples.select(rows), normals


def _by_rays(air: Air, count: int, seed: int) -> tuple[Samples, Float64, Float64]:
    surface = air.walls
    origins = np.repeat(air.random_points(2 * count, seed), RAYS_PER_POINT, axis=0)
    directions = random_directions(len(origins), seed + 1)
    distance, triangle = air.rays.first_hit(origins, directions)
    hit = np.flatnonzero(triangle >= 0)
    projected = np.bincount(triangle[hit], minlength=len(surface)) / max(len(hit), 1)
    hit = hit[np.linspace(0, len(hit) - 1, min(count, len(hit))).astype(np.int64)]
    triangle = triangle[hit]
    points = origins[hit] + distance[hit, None] * directions[hit]
    barycentric = _barycentric(surface.vertices[triangle], points)
    points = np.einsum("pc,pck->pk", barycentric, surface.vertices[triangle])
    normals = surface.normals[triangle]
    facing = np.where(np.einsum("pk,pk->p", normals, directions[hit]) > 0, -1.0, 1.0)
    return Samples(points, normals, triangle, barycentric), normals * facing[:, None], projected


def _barycentric(corners: Float64, points: Float64) -> Float64:
    """Weights (p, 3), not negative, of the corners (p, 3, 3) at points in their planes (Ericson 2005)."""
    a, b, p = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], points - corners[:, 0]
    aa, ab, bb = (np.einsum("pk,pk->p", u, v) for u, v in ((a, a), (a, b), (b, b)))
    pa, pb = np.einsum("pk,pk->p", p, a), np.einsum("pk,pk->p", p, b)
    determinant = np.maximum(aa * bb - ab * ab, np.finfo(float).tiny)
    v, w = (bb * pa - ab * pb) / determinant, (aa * pb - ab * pa) / determinant
    weights = np.clip(np.stack([1 - v - w, v, w], axis=1), 0.0, 1.0)
    return weights / np.maximum(weights.sum(axis=1, keepdims=True), np.finfo(float).tiny)


def make_targets(seen: Seen, air: Air, weights: Float64, count: int, seed: int) -> Targets:
    """Targets of the seen samples of non-zero `weights` (p,), `count` cells of the free air, and rays."""
    rows = np.flatnonzero(weights > 0)
    surface = _rows(air, seen.samples.points[rows], weights[rows], normals=seen.normals[rows], sample=rows)
    points, distances = _air_points(air, count, seed)
    free = _rows(air, points, np.full(len(points), 1.0 / max(len(points), 1)), distances=distances)
    return along_a_curve(join_targets([surface, free, *_ray_targets(air, seed)]))


def _rows(
    air: Air,
    points: Float64,
    weights: Float64,
    *,
    distances: Float64 | None = None,
    normals: Float64 | None = None,
    sample: NDArray[np.int64] | None = None,
    ways: Float64 | None = None,
) -> Targets:
    """Targets at points (p, 3); what is not given is zero, and no sample."""
    reach, blank = REACH_CELLS * air.cell, np.zeros((len(points), 3))
    return Targets(
        points=points,
        distances=np.zeros(len(points)) if distances is None else distances,
        weights=weights,
        normals=blank if normals is None else normals,
        sample=np.full(len(points), -1) if sample is None else sample,
        caps=np.full(len(points), reach),
        ways=blank if ways is None else ways,
        is_line=np.zeros(len(points), bool),
        late=np.zeros(len(points)),
        filled=np.zeros(len(points)) if distances is None else np.full(len(points), FILLED),
        reach=reach,
        soft=SOFT_CELLS * air.cell,
        leak=LEAK_CELLS * air.cell,
        slack=min(LEAK_SHARE * air.walls.diagonal, SLACK_REACH * reach),
    )


def _ray_targets(air: Air, seed: int) -> tuple[Targets, Targets]:
    """Random rays behind their hits, by distance, and the same rays as lines that must pass before them."""
    origins = air.random_points(RAYS, seed + _OWN_RAYS)
    directions = random_directions(len(origins), seed + _OWN_RAYS)
    ends, triangle = air.rays.first_hit(origins, directions)
    missed = LEAK_SHARE * air.walls.diagonal
    hit = np.flatnonzero(triangle >= 0)
    points = origins[hit] + ends[hit, None] * directions[hit]
    normals = air.walls.normals[triangle[hit]]
    normals = normals * -np.copysign(1.0, np.einsum("pk,pk->p", normals, directions[hit]))[:, None]
    weights = np.full(len(hit), LEAKS_WEIGHT / max(len(hit), 1))
    behind = _rows(air, points, weights, normals=normals, ways=missed * directions[hit])
    return behind, _lines(air, origins, directions, ends, 0.0, BLOCKED_PRICE)


def count_rays(targets: Targets, air: Air, seed: int, leak_price: float, blocked_price: float) -> Targets:
    """The targets with `LINES` rays that are counted, one by one, in the place of all rays.

    Air that is clear of surfaces costs more to fill: near them faces move to close what leaks.
    leak_price, blocked_price: shares of the diagonal, what it costs when all leak and when all are blocked.
    """
    starts = air.random_points(LINES // RAYS_PER_POINT, seed + _OWN_LINES)
    origins = np.repeat(starts, RAYS_PER_POINT, axis=0)
    directions = random_directions(len(origins), (seed + _OWN_LINES, 1))
    ends = air.rays.first_hit(origins, directions)[0]
    points = targets.select(np.flatnonzero(~targets.is_line & ~targets.is_ray))
    clear = points.distances > CLEAR_CELLS * air.cell
    points = replace(points, filled=np.where(clear, FILLED_CLEAR, points.filled))
    lines = _lines(air, origins, directions, ends, leak_price, blocked_price)
    return along_a_curve(join_targets([points, lines]))


def _lines(
    air: Air, origins: Float64, directions: Float64, ends: Float64, leak_price: float, blocked_price: float
) -> Targets:
    """Lines along rays that meet the surface at `ends` (p,); where it is never met they can't leak."""
    diagonal, met = air.walls.diagonal, np.isfinite(ends)
    blank = _rows(air, origins, np.full(len(ends), blocked_price * diagonal / max(len(ends), 1)))
    late = np.where(met, leak_price * diagonal / max(int(met.sum()), 1), 0.0)
    ways = (np.where(met, ends, diagonal) + blank.slack)[:, None] * directions
    return replace(blank, ways=ways, is_line=np.ones(len(ends), bool), late=late)


def along_a_curve(targets: Targets) -> Targets:
    """The same targets, neighbours in space side by side: runs of rows are compact, strides spread evenly.

    The lines come last, by themselves.
    """
    lower = targets.points.min(axis=0, initial=np.inf)
    cells = ((targets.points - lower) / (_RUN_REACH * targets.reach)).astype(np.int64)
    return targets.select(np.lexsort([morton_code(cells.T), targets.is_line]))


def _air_points(air: Air, count: int, seed: int) -> tuple[Float64, Float64]:
    """Centres of free cells, half of them near a surface, and their distances to it, `reach` at most.

    Those beyond the reach matter as well: without them a sheet across an open court would cost nothing.
    """
    rng = np.random.default_rng(seed)
    steps = ndimage.distance_transform_cdt(air.label > 0, "chessboard")  # cells to the nearest solid one
    near = steps <= NEAR_CELLS
    drawn: list[NDArray[np.int64]] = []
    for stratum in (near, ~near):
        cells = np.flatnonzero((air.free & stratum).ravel())
        if len(cells):
            drawn.append(np.sort(rng.choice(cells, size=min(count // 2, len(cells)), replace=False)))
    index = np.concatenate([*drawn, np.zeros(0, np.int64)])
    points = air.grid.centers(np.stack(np.unravel_index(index, air.grid.shape), axis=1))
    reach = REACH_CELLS * air.cell
    return points, np.minimum(air.tree.nearest(points, reach)[0], reach)
