"""Patches of facets, what fits of them need, and the box of which a patch shows a part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.facets import Bool, Facets, Int64
from fit.primitives import Kind
from fit.scene import Float64
from fit.shapes import Shapes, make_shapes, right_handed

EXACT = 12
"""Times the tolerance: how far a vertex may lie off the primitive that it is said to be on."""

STRAY = 2e-3
"""Of a patch's area, or of its ridges' length: what booleans and rounding may have left askew."""

_UPRIGHT = 0.01
"""Radians: faces of a box that are off their right angle by more are no second direction."""


@dataclass(frozen=True)
class Fragment:
    """A primitive as far as its facets show it.

    frame (3, 3), columns; low, high (3,): its extents as x . frame (all three of a sphere; 0 and 2 are a
    cylinder's diameter, 1 its axis), which reach as far as the facets where none shows the end; inner:
    inscribed radius of the tessellation over the radius, 1 for a box; facets (k,): rows that lie on it.
    """

    kind: Kind
    frame: Float64
    low: Float64
    high: Float64
    inner: float
    facets: Int64

    def shape(self) -> Shapes:
        middle, halves = (self.low + self.high) / 2, (self.high - self.low) / 2
        return make_shapes(self.kind, (self.frame @ middle)[None], self.frame, halves[None], exact=True)

    @property
    def radius(self) -> float:
        return float(self.high[0] - self.low[0]) / 2


@dataclass(frozen=True)
class Patches:
    """Facets by patch, of_facet (f,), and what all fits need of them.

    corner_start (f + 1,): rows of corner_points (c, 3) that are each facet's corners; edges (e,): the patch
    that has both facets of an edge, else -1; whole_points (w, 3): vertices where at least three facets meet,
    all of one patch, whole_patch (w,), and no edge is concave: no intersection has cut them.
    """

    facets: Facets
    of_facet: Int64
    corner_start: Int64
    corner_points: Float64
    edges: Int64
    whole_points: Float64
    whole_patch: Int64

    def __len__(self) -> int:
        return int(self.of_facet.max(initial=-1)) + 1

    def corners(self, rows: Int64) -> Float64:
        """Corners (k, 3) of facets."""
        return self.corner_points[self.corner_rows(rows)[0]]

    def corner_rows(self, rows: Int64) -> tuple[Int64, Int64]:
        """Rows of `corner_points` that belong to facets, and where each facet's begin among them."""
        counts = self.corner_start[rows + 1] - self.corner_start[rows]
        first = np.cumsum(counts) - counts
        return np.repeat(self.corner_start[rows] - first, counts) + np.arange(counts.sum()), first


def gather(facets: Facets, of_facet: Int64) -> Patches:
    """Facets by patch (f,), with their corners and edges in tables."""
    rows = np.flatnonzero(facets.of_triangle >= 0)
    key = facets.of_triangle[rows, None] * len(facets.points) + facets.triangles[rows]
    facet, vertex = np.divmod(np.unique(key), len(facets.points))
    start = np.searchsorted(facet, np.arange(len(facets) + 1))
    ends = of_facet[facets.pair]
    edges = np.where(ends[:, 0] == ends[:, 1], ends[:, 0], -1)
    count = np.bincount(vertex, minlength=len(facets.points))
    lowest = np.full(len(facets.points), len(facets))
    highest = np.full(len(facets.points), -1)
    np.minimum.at(lowest, vertex, of_facet[facet])
    np.maximum.at(highest, vertex, of_facet[facet])
    cut = np.zeros(len(facets.points), bool)
    cut[facets.edge_vertices[facets.is_concave()]] = True
    whole = np.flatnonzero((count >= 3) & (lowest == highest) & ~cut)
    return Patches(facets, of_facet, start, facets.points[vertex], edges, facets.points[whole], lowest[whole])


def nearly_all(on: Bool, weights: Float64) -> bool:
    """Whether the weights of what is not `on` are negligible."""
    return bool(weights[~on].sum() <= STRAY * weights.sum())


# ------------------------------------------------------------------------------------------------- boxes


def fit_box(patches: Patches, members: Int64) -> Fragment | None:
    """Facets along two or three directions at right angles, each on the outermost plane of its direction."""
    facets = patches.facets
    normals, areas = facets.normals[members], facets.areas[members]
    first = normals[np.argmax(areas)]
    across = np.abs(normals @ first) <= np.minimum(2 * facets.slack()[members], _UPRIGHT)
    if not across.any():
        return None
    second = normals[across][np.argmax(areas[across])]
    frame = right_handed(np.stack([first, second], axis=1))
    return box_in_frame(patches, members, frame)


def box_in_frame(patches: Patches, members: Int64, frame: Float64) -> Fragment | None:
    """The box of a given frame, if all facets lie on its faces."""
    facets = patches.facets
    turned = facets.normals[members] @ frame
    axis = np.abs(turned).argmax(axis=1)
    along = turned[np.arange(len(members)), axis]
    straight = np.sqrt(np.maximum(1 - along**2, 0.0)) <= 2 * facets.slack()[members] + 1e-5
    if not straight.any():
        return None
    local = patches.corners(members[straight]) @ frame
    box = Fragment(Kind.BOX, frame, local.min(axis=0), local.max(axis=0), 1.0, members)
    return box if nearly_all(on_box(patches, members, box), facets.areas[members]) else None


def on_box(patches: Patches, members: Int64, box: Fragment) -> Bool:
    """Which facets (k,) are on the faces of a box."""
    facets = patches.facets
    slack = facets.slack()[members]
    turned = facets.normals[members] @ box.frame
    axis = np.abs(turned).argmax(axis=1)
    along = turned[np.arange(len(members)), axis]
    level = np.sign(along) * facets.offsets[members]
    end = np.where(along > 0, box.high[axis], box.low[axis])
    reach = EXACT * facets.tolerance + np.minimum(slack, 1e-4)
    straight = np.sqrt(np.maximum(1 - along**2, 0.0)) <= 2 * slack + 1e-5
    return straight & (np.abs(level - end) <= reach)
