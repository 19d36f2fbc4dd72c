"""Candidates for the set from regions of the surface, at every scale: slabs along planes, round shapes.

A hybrid variational approximation (Cohen-Steiner, Alliez and Desbrun 2004; Wu and Kobbelt 2005) for open
sheets: the partition and its merges say *where* one primitive could do, the free air says how far that
primitive may reach. The choice of candidates (`fit.choose`) does the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.merge_regions import hierarchy
from fit.objective import Targets, penalties
from fit.partition import Samples, link, partition
from fit.scene import Float64
from fit.shapes import Shapes, distances_to_one, join
from fit.slabs import Patch, make_patch, slabs
from fit.spaces import Air
from fit.targets import Seen

Int64 = NDArray[np.int64]

REGIONS = 400
"""Facets that the surface is first cut into."""

MOST_CANDIDATES = 800

MOST_PATCHES = 150
"""Patches asked in one round, those whose surface lacks most, once there is a set."""

MOST_TOO_NEAR = 0.05
"""Of its gain, that a candidate may cost where it is nearer than the surface: unlike what it leaves out, no
later shape can mend that. On a large scene at 64 shapes, 0.1 leaves an error of 192, 0.05 of 138."""

_LOOKED_AT = 6000
"""Targets, evenly out of all, by which candidates are compared before the choice sees them."""

_SAME = 0.25
"""Of a cell: candidates of nearly equal corners are one."""


@dataclass(frozen=True)
class Regions:
    """The surface targets as samples (rows (p,) of the targets), and patches of it at every scale."""

    air: Air
    rows: Int64
    samples: Samples
    patches: tuple[Patch, ...]


def find_regions(air: Air, targets: Targets, *, seed: int = 0) -> Regions:
    """Regions that a plane, sphere or cylinder explains, and their merges up to whole walls."""
    rows = np.flatnonzero(targets.is_surface)
    points = (targets.points[rows] - air.origin) / air.cell
    samples = link(points, targets.normals[rows], targets.weights[rows])
    if len(rows) < 3:
        return Regions(air, rows, samples, ())
    label = partition(samples, REGIONS, np.random.default_rng(seed))
    order = np.argsort(label, kind="stable")
    starts = np.searchsorted(label[order], np.arange(int(label.max()) + 2))
    patches = []
    for regions in hierarchy(samples, label)[0]:
        members = np.sort(np.concatenate([order[starts[r] : starts[r + 1]] for r in regions]))
        patches.append(make_patch(samples, members, air))
    return Regions(air, rows, samples, tuple(p for p in patches if p is not None))


def propose_regions(
    air: Air, seen: Seen, targets: Targets, *, seed: int = 0, distances: Float64 | None = None
) -> Shapes:
    """At most `MOST_CANDIDATES` boxes, cylinders and spheres (none exact) for a set at `distances` (p,)."""
    return propose_slabs(find_regions(air, targets, seed=seed), targets, distances)


def propose_slabs(regions: Regions, targets: Targets, distances: Float64 | None = None) -> Shapes:
    """Slabs where the set at signed `distances` (p,) from the targets lacks surface; None: the empty set."""
    far = np.full(len(targets), targets.reach)
    current = far if distances is None else np.minimum(distances, far)
    missing = np.where(current > 0, penalties(targets, current), 0.0)[regions.rows]
    need = missing / np.maximum(penalties(targets, far)[regions.rows], np.finfo(float).tiny)
    patches = list(regions.patches)
    if distances is not None:
        lacks = np.array([float(missing[p.members].sum()) for p in patches])
        patches = [patches[i] for i in np.argsort(-lacks, kind="stable")[:MOST_PATCHES] if lacks[i] > 0]
    found = join([slabs(patch, need, regions.air) for patch in patches])
    return _most_useful(found, targets, current, regions.air.cell)


def _most_useful(candidates: Shapes, targets: Targets, current: Float64, cell: float) -> Shapes:
    """Those that lower the error most, without near doubles and those that reach into the air."""
    thin = np.arange(0, len(targets), max(1, len(targets) // _LOOKED_AT))
    gains, losses = _gains(candidates, targets.select(thin), current[thin])
    order = np.argsort(-gains, kind="stable")
    order = order[losses[order] < MOST_TOO_NEAR * gains[order]]
    corners = np.abs(candidates.frames * candidates.halves[:, None, :])
    key = np.concatenate([candidates.centers, corners.sum(axis=2), corners.max(axis=2)], axis=1)
    key = np.rint(key[order] / (_SAME * cell)).astype(np.int64)
    _, first = np.unique(key, axis=0, return_index=True)
    return candidates.select(order[np.sort(first)][:MOST_CANDIDATES])


def _gains(candidates: Shapes, targets: Targets, current: Float64) -> tuple[Float64, Float64]:
    """What each takes off the error of a set at `current` (n,), and what it costs where too near (n,)."""
    standing = penalties(targets, current)
    gains, losses = np.zeros(len(candidates)), np.zeros(len(candidates))
    for i in range(len(candidates)):
        radius = float(np.linalg.norm(candidates.halves[i])) + targets.reach
        offset = targets.points - candidates.centers[i]
        rows = np.flatnonzero(np.einsum("pk,pk->p", offset, offset) < radius * radius)
        distances = distances_to_one(candidates, i, targets.points[rows])
        closer = distances < current[rows]
        rows, distances = rows[closer], distances[closer]
        penalty = penalties(targets, distances, rows)
        gains[i] = float((standing[rows] - penalty).sum())
        losses[i] = float(penalty[distances < targets.distances[rows]].sum())
    return gains, losses
