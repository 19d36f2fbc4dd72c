"""Candidates for the set from regions of the surface, at every scale: slabs along planes, round shapes.

A hybrid variational approximation (Cohen-Steiner, Alliez and Desbrun 2004; Wu and Kobbelt 2005) for open
sheets: the partition and its merges say *where* one primitive could do, the free air says how far that
primitive may reach. The choice of candidates (`fit.choose`) does the rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fit.merge_regions import hierarchy
from fit.objective import Targets, penalties
from fit.partition import link, partition
from fit.scene import Float64
from fit.shapes import Shapes, distances_to_one, join, no_shapes
from fit.slabs import slabs
from fit.spaces import Air
from fit.targets import Seen

REGIONS = 400
"""Facets that the surface is first cut into."""

MOST_CANDIDATES = 600

MOST_TOO_NEAR = 0.05
"""Of its gain, that a candidate may cost where it is nearer than the surface: unlike what it leaves out, no
later shape can mend that. On a large scene at 64 shapes, 0.1 leaves an error of 192, 0.05 of 138."""

_LOOKED_AT = 6000
"""Targets, evenly out of all, by which candidates are compared before the choice sees them."""

_SAME = 0.25
"""Of a cell: candidates of nearly equal corners are one."""


def propose_regions(air: Air, seen: Seen, targets: Targets, *, seed: int = 0) -> Shapes:
    """At most `MOST_CANDIDATES` boxes, cylinders and spheres (none exact), the most useful alone first."""
    rows = np.flatnonzero(targets.is_surface)
    if len(rows) < 3:
        return no_shapes()
    points = (targets.points[rows] - air.origin) / air.cell
    samples = link(points, targets.normals[rows], targets.weights[rows])
    label = partition(samples, REGIONS, np.random.default_rng(seed))
    nodes, _ = hierarchy(samples, label)
    order = np.argsort(label, kind="stable")
    starts = np.searchsorted(label[order], np.arange(int(label.max()) + 2))
    found = []
    for regions in nodes:
        members = np.sort(np.concatenate([order[starts[r] : starts[r + 1]] for r in regions]))
        found.append(slabs(samples, members, air))
    return _most_useful(join(found), targets, air.cell)


def _most_useful(candidates: Shapes, targets: Targets, cell: float) -> Shapes:
    """Those that lower the empty set's error most, without near doubles and those that reach into the air."""
    thinned = targets.select(np.arange(0, len(targets), max(1, len(targets) // _LOOKED_AT)))
    gains, losses = _gains(candidates, thinned)
    order = np.argsort(-gains, kind="stable")
    order = order[losses[order] < MOST_TOO_NEAR * gains[order]]
    corners = np.abs(candidates.frames * candidates.halves[:, None, :])
    key = np.concatenate([candidates.centers, corners.sum(axis=2), corners.max(axis=2)], axis=1)
    key = np.rint(key[order] / (_SAME * cell)).astype(np.int64)
    _, first = np.unique(key, axis=0, return_index=True)
    return candidates.select(order[np.sort(first)][:MOST_CANDIDATES])


def _gains(candidates: Shapes, targets: Targets) -> tuple[Float64, Float64]:
    """What each alone takes off the empty set's error (n,), and what it adds where it is too near (n,)."""
    standing = penalties(targets, np.full(len(targets), targets.reach))
    gains, losses = np.zeros(len(candidates)), np.zeros(len(candidates))
    for i in range(len(candidates)):
        near = _near(candidates, i, targets)
        distances = np.minimum(distances_to_one(candidates, i, targets.points[near]), targets.reach)
        penalty = penalties(targets, distances, near)
        gains[i] = float((standing[near] - penalty).sum())
        losses[i] = float(penalty[distances < targets.distances[near]].sum())
    return gains, losses


def _near(candidates: Shapes, which: int, targets: Targets) -> NDArray[np.int64]:
    """Rows of the targets within reach of a candidate's bounding sphere."""
    radius = float(np.linalg.norm(candidates.halves[which])) + targets.reach
    return np.flatnonzero(((targets.points - candidates.centers[which]) ** 2).sum(axis=1) < radius * radius)
