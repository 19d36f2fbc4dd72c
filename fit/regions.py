"""Candidates for the set from regions of the surface, at every scale: slabs along planes, round shapes.

Variational shape approximation (Cohen-Steiner, Alliez and Desbrun 2004) for open sheets. The partition knows
planes alone; spheres and cylinders (as in Wu and Kobbelt 2005) come in where its facets are merged. Both say
*where* one primitive could do, the free air says how far that primitive may reach. The choice of candidates
(`fit.choose`) does the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.merge_regions import hierarchy
from fit.objective import Targets, near_distances, penalties
from fit.partition import link, partition
from fit.round_regions import round_shapes
from fit.scene import Float64
from fit.shapes import Shapes, join, no_shapes
from fit.slabs import Patch, make_patch, slabs
from fit.spaces import Air

Int64 = NDArray[np.int64]

REGIONS, SAMPLES_PER_REGION = 400, 15
"""Facets at most that the surface is first cut into, and samples that each has on average at least."""

MOST_STANDING, MOST_ROUND, MOST_NEW = 600, 100, 200
"""Slabs and round shapes found for the empty set, which stay on offer, and slabs for what a set lacks."""

MOST_PATCHES = 80
"""Patches asked in one round, those whose surface lacks most, once there is a set."""

MOST_TOO_NEAR = 0.03
"""Of its gain, that a candidate may cost where it is nearer than the surface: unlike what it leaves out, no
later shape can mend that. Of 96 shapes chosen on a large scene, those under 0.1 leave an error of
494, under 0.05 of 436, under 0.02 of 417."""

SAME_NODE = 0.9
"""Of a node's weight: one of its parts that has as much offers as good candidates."""

_SAME = 0.25
"""Of a cell: candidates of nearly equal corners are one."""


@dataclass(frozen=True)
class Regions:
    """The surface targets as samples (rows (p,) of the targets), patches of it at every scale, and the
    candidates that stand for them while there is no set."""

    air: Air
    rows: Int64
    patches: tuple[Patch, ...]
    standing: Shapes


def find_regions(air: Air, targets: Targets, *, seed: int = 0) -> Regions:
    """Facets of the surface, and merges of them that a plane or round shape explains, up to whole walls."""
    rows = np.flatnonzero(targets.is_surface)
    if len(rows) < 3:
        return Regions(air, rows, (), no_shapes())
    points = (targets.points[rows] - air.origin) / air.cell
    samples = link(points, targets.normals[rows], targets.weights[rows])
    label = partition(samples, min(REGIONS, len(rows) // SAMPLES_PER_REGION + 6), np.random.default_rng(seed))
    order = np.argsort(label, kind="stable")
    starts = np.searchsorted(label[order], np.arange(int(label.max()) + 2))
    patches, found, rounded = [], [], []
    everything = np.ones(len(rows))
    own_weights = np.bincount(label, samples.weights).astype(np.float64)
    for regions in _distinct(hierarchy(samples, label)[0], own_weights):
        members = np.sort(np.concatenate([order[starts[r] : starts[r + 1]] for r in regions]))
        patch = make_patch(samples, members, air)
        if patch is not None:
            patches.append(patch)
            found.append(slabs(patch, everything, air))
        rounded.append(round_shapes(samples, members, air))
    far = np.full(len(targets), targets.reach)
    standing = [
        _most_useful(join(several), targets, far, air.cell, most)
        for several, most in ((found, MOST_STANDING), (rounded, MOST_ROUND))
    ]
    return Regions(air, rows, tuple(patches), join(standing))


def _distinct(nodes: list[tuple[int, ...]], weights: Float64) -> list[tuple[int, ...]]:
    """The nodes of a hierarchy without those that are hardly more than one that they were merged from."""
    largest: dict[int, float] = {}
    kept = []
    for regions in nodes:
        weight = float(weights[list(regions)].sum())
        if max(largest.get(r, 0.0) for r in regions) < SAME_NODE * weight:
            kept.append(regions)
            largest.update(dict.fromkeys(regions, weight))
    return kept


def propose_slabs(regions: Regions, targets: Targets, distances: Float64) -> Shapes:
    """The standing candidates, and slabs where the set at signed `distances` (p,) lacks surface."""
    far = np.full(len(targets), targets.reach)
    current = np.minimum(distances, far)
    missing = np.where(current > 0, penalties(targets, current), 0.0)[regions.rows]
    need = missing / np.maximum(penalties(targets, far)[regions.rows], np.finfo(float).tiny)
    if not (need < 1).any():
        return regions.standing
    lacks = np.array([float(missing[p.members].sum()) for p in regions.patches])
    worst = [i for i in np.argsort(-lacks, kind="stable")[:MOST_PATCHES] if lacks[i] > 0]
    found = join([slabs(regions.patches[i], need, regions.air) for i in worst])
    new = _most_useful(found, targets, current, regions.air.cell, MOST_NEW)
    return join([regions.standing, new])


def _most_useful(candidates: Shapes, targets: Targets, current: Float64, cell: float, most: int) -> Shapes:
    """Those that lower the error most, without near doubles and those that reach into the air."""
    gains, losses = _gains(candidates, targets, current)
    order = np.argsort(-gains, kind="stable")
    order = order[losses[order] < MOST_TOO_NEAR * gains[order]]
    corners = np.abs(candidates.frames * candidates.halves[:, None, :])
    key = np.concatenate([candidates.centers, corners.sum(axis=2), corners.max(axis=2)], axis=1)
    key = np.rint(key[order] / (_SAME * cell)).astype(np.int64)
    _, first = np.unique(key, axis=0, return_index=True)
    return candidates.select(order[np.sort(first)][:most])


def _gains(candidates: Shapes, targets: Targets, current: Float64) -> tuple[Float64, Float64]:
    """What each takes off the error of a set at `current` (n,), and what it costs where too near (n,)."""
    standing = penalties(targets, current)
    gains, losses = np.zeros(len(candidates)), np.zeros(len(candidates))
    for i in range(len(candidates)):
        rows, distances = near_distances(candidates, i, targets)
        closer = distances < current[rows]
        rows, distances = rows[closer], distances[closer]
        penalty = penalties(targets, distances, rows)
        gains[i] = float((standing[rows] - penalty).sum())
        losses[i] = float(penalty[distances < targets.distances[rows]].sum())
    return gains, losses
