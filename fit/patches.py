"""The box, cylinder or sphere of which a patch of facets shows a part.

A tessellated cylinder meets its round one along the ridges between its side facets, a sphere at the vertices
that no intersection has cut: there the radius is exact, however coarse the tessellation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fit.facets import Bool, Facets, Int64
from fit.primitives import Kind
from fit.scene import Float64
from fit.shapes import Shapes, make_shapes, right_handed

WIDEST_TURN = np.radians(46)
"""Between neighbouring side facets: cylinders and spheres of 8 segments and more are round."""

WIDEST_ON_SPHERE = np.radians(65)
"""Between its facets: bands of latitude are often wider than segments (4 bands: 60 degrees; an octahedron's 71)."""

FLATTEST_SPHERE = 0.78
"""Of the radius: nearest facet of a sphere (8 segments: 0.816; a box's faces are at 0.58 or nearer)."""

_EXACT = 12
"""Times the tolerance: how far a vertex may lie off the primitive that it is said to be on."""

_STRAY = 2e-3
"""Of a patch's area, or of its ridges' length: what booleans and rounding may have left askew."""

_MOST_CUT, _LEAST_CUT, _TRIALS = 60, 6, 100
"""Facets at most, points at least and draws of four points, for a sphere by the vertices it would have."""

_UPRIGHT = 0.01
"""Radians: faces of a box that are off their right angle by more are no second direction."""

_ROUNDS = 6
"""Gauss-Newton steps; two suffice from the linear start."""


@dataclass(frozen=True)
class Fragment:
    """A primitive as far as its facets show it.

    frame (3, 3), columns; low, high (3,): its extents as x . frame (all three of a sphere; 0 and 2 are a
    cylinder's diameter, 1 its axis); shown (3, 2) bool: whether a facet fixes the low and the high end,
    what is not shown reaches as far as the facets do; inner: inscribed radius of the tessellation over the
    radius, 1 for a box; facets (k,): rows that lie on it.
    """

    kind: Kind
    frame: Float64
    low: Float64
    high: Float64
    shown: Bool
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


def fit_patch(patches: Patches, patch: int) -> Fragment | None:
    """The one primitive that all facets of a patch lie on; None where there is none, or too little shows."""
    members = np.flatnonzero(patches.of_facet == patch)
    edges = np.flatnonzero(patches.edges == patch)
    whole = patches.whole_points[patches.whole_patch == patch]
    return (
        fit_box(patches, members)
        or fit_cylinder(patches, members, edges)
        or fit_sphere(patches, members, edges, whole)
    )


def join_facets(patches: Patches, fragment: Fragment, members: Int64) -> Fragment | None:
    """The fragment with further facets, if those lie on the same primitive."""
    together = np.concatenate([fragment.facets, members])
    if fragment.kind is Kind.BOX:
        both = box_in_frame(patches, together, fragment.frame)
        on = on_box(patches, members, both) if both else None
    elif fragment.kind is Kind.CYLINDER:
        both = cylinder_on(patches, together, fragment)
        on = on_cylinder(patches, members, both) if both else None
    else:
        both = sphere_on(patches, together, fragment)
        on = on_sphere(patches, members, both) if both else None
    return both if on is not None and nearly_all(on, patches.facets.areas[members]) else None


def nearly_all(on: Bool, weights: Float64) -> bool:
    """Whether the weights of what is not `on` are negligible."""
    return bool(weights[~on].sum() <= _STRAY * weights.sum())


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
    box = Fragment(
        Kind.BOX, frame, local.min(axis=0), local.max(axis=0), np.zeros((3, 2), bool), 1.0, members
    )
    on = on_box(patches, members, box)
    if not nearly_all(on, facets.areas[members]):
        return None
    box.shown[axis[on], (along[on] > 0).astype(np.int64)] = True
    return box


def on_box(patches: Patches, members: Int64, box: Fragment) -> Bool:
    """Which facets (k,) are on the faces of a box."""
    facets = patches.facets
    slack = facets.slack()[members]
    turned = facets.normals[members] @ box.frame
    axis = np.abs(turned).argmax(axis=1)
    along = turned[np.arange(len(members)), axis]
    level = np.sign(along) * facets.offsets[members]
    end = np.where(along > 0, box.high[axis], box.low[axis])
    reach = _EXACT * facets.tolerance + np.minimum(slack, 1e-4)
    straight = np.sqrt(np.maximum(1 - along**2, 0.0)) <= 2 * slack + 1e-5
    return straight & (np.abs(level - end) <= reach)


# --------------------------------------------------------------------------------------------- cylinders


def fit_cylinder(patches: Patches, members: Int64, edges: Int64) -> Fragment | None:
    """Axis along the ridges, centre and radius by the ridges' places and directions, ends by the caps."""
    facets = patches.facets
    turn = facets.angles[edges]
    ridges = edges[(turn > 0) & (turn < WIDEST_TURN)]
    if len(ridges) < 2:
        return None
    ends = facets.points[facets.edge_vertices[ridges]]
    along = ends[:, 1] - ends[:, 0]
    axis = np.linalg.eigh(along.T @ along)[1][:, 2]
    astray = np.linalg.norm(along - np.outer(along @ axis, axis), axis=1)
    if astray.sum() > _STRAY * np.linalg.norm(along, axis=1).sum():
        return None
    fitted = _fit_rods(facets, ridges, axis)
    if fitted is None:
        return None
    axis, center, radius = fitted
    frame = right_handed(np.stack([np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))]), axis], axis=1))
    local = center @ frame
    reach = np.array([radius, 0.0, radius])
    start = Fragment(
        Kind.CYLINDER, frame, local - reach, local + reach, np.ones((3, 2), bool), np.cos(WIDEST_TURN / 2),
        members,
    )  # fmt: skip
    return cylinder_on(patches, members, start)


def cylinder_on(patches: Patches, members: Int64, rod: Fragment) -> Fragment | None:
    """The cylinder about the axis of another one that ends where these facets end, if all lie on it."""
    facets = patches.facets
    on = on_cylinder(patches, members, rod)
    if not nearly_all(on, facets.areas[members]):
        return None
    middle = (rod.low + rod.high) / 2
    height = patches.corners(members[on]) @ rod.frame[:, 1]
    low, high = rod.low.copy(), rod.high.copy()
    low[1], high[1] = height.min(), height.max()
    lift = facets.normals[members] @ rod.frame[:, 1]
    cap = on & (np.abs(lift) > 0.5)
    level = np.sign(lift) * facets.offsets[members]
    end = np.where(lift > 0, high[1], low[1])
    slack = np.minimum(facets.slack()[members], 1e-3)
    at_end = np.abs(level - end) <= _EXACT * facets.tolerance + slack * rod.radius
    if not nearly_all(at_end | ~cap, facets.areas[members]):
        return None
    shown = np.ones((3, 2), bool)
    shown[1] = (cap & (lift < 0)).any(), (cap & (lift > 0)).any()
    around = facets.offsets[members] - facets.normals[members] @ (rod.frame @ (middle * [1, 0, 1]))
    inner = float((around[on & ~cap] / rod.radius).min(initial=1.0))
    return replace(rod, low=low, high=high, shown=shown, inner=inner, facets=members)


def on_cylinder(patches: Patches, members: Int64, rod: Fragment) -> Bool:
    """Which facets (k,) are caps or side facets of an endless cylinder."""
    facets = patches.facets
    normals, slack = facets.normals[members], facets.slack()[members]
    lift = np.abs(normals @ rod.frame[:, 1])
    cap = lift > 1 - 1e-6 - slack**2
    side = lift <= 2 * slack + 1e-5
    middle = (rod.low + rod.high) / 2 * [1, 0, 1]
    around = facets.offsets[members] - normals @ (rod.frame @ middle)
    reach = _EXACT * facets.tolerance + (2 * slack + 1e-5) * rod.radius
    nearest = np.cos(WIDEST_TURN / 2) * rod.radius
    corners, first = patches.corner_rows(members)
    offset = (patches.corner_points[corners] @ rod.frame - middle)[:, [0, 2]]
    beyond = np.maximum.reduceat(np.linalg.norm(offset, axis=1), first) - rod.radius
    on = cap | (side & (around <= rod.radius + reach) & (around >= nearest - reach))
    return on & (beyond <= _EXACT * facets.tolerance + 1e-5 * rod.radius)


def _fit_rods(facets: Facets, ridges: Int64, axis: Float64) -> tuple[Float64, Float64, float] | None:
    """Axis, a point on it and radius, from ridges (e,): each lies at the radius, midway between the normals
    of its facets (the polygon is regular), so p = c + r u, linear in c and r; then Gauss-Newton.
    """
    pair = facets.pair[ridges]
    points = facets.points[facets.edge_vertices[ridges]].reshape(-1, 3)
    toward = facets.normals[pair].sum(axis=1)
    spread = np.repeat(facets.slack()[pair].max(axis=1), 2)
    radius = 0.0
    center = points.mean(axis=0)
    origin = center.copy()
    for step in range(_ROUNDS):
        frame = right_handed(np.stack([np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))]), axis], axis=1))
        across = frame[:, [0, 2]]
        flat = toward @ across
        length = np.linalg.norm(flat, axis=1)
        if (length < 0.5).any():
            return None
        unit = np.repeat(flat / length[:, None], 2, axis=0)
        offset = points - center
        place, height = offset @ across, offset @ axis
        wide = max(radius, float(np.linalg.norm(place, axis=1).max()), 10 * facets.tolerance)
        sideways = facets.tolerance + spread * wide
        normal = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
        if step == 0:
            rows = [
                np.column_stack([unit, np.ones(len(unit))]) / facets.tolerance,
                np.column_stack([normal, np.zeros(len(unit))]) / sideways[:, None],
            ]
            right = [np.einsum("pk,pk->p", place, unit) / facets.tolerance,
                     np.einsum("pk,pk->p", place, normal) / sideways]  # fmt: skip
            solution = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
            center = center + across @ solution[:2]
            radius = float(solution[2])
            continue
        distance = np.maximum(np.linalg.norm(place, axis=1), facets.tolerance)
        out = place / distance[:, None]
        # A tilt (a, b) moves the axis at height h by h (a, b) across it.
        radial = np.column_stack([-out, -out * height[:, None], -np.ones(len(out))]) / facets.tolerance
        bisect = np.column_stack([-normal, -normal * height[:, None], np.zeros(len(out))])
        jacobian = np.concatenate([radial, bisect / sideways[:, None]])
        residual = np.concatenate(
            [(distance - radius) / facets.tolerance, np.einsum("pk,pk->p", place, normal) / sideways]
        )
        change = np.linalg.lstsq(jacobian, -residual, rcond=1e-12)[0]
        center = center + across @ change[:2]
        axis = axis + across @ change[2:4]
        axis = axis / np.linalg.norm(axis)
        radius += float(change[4])
    if not (np.isfinite(radius) and radius > 10 * facets.tolerance):
        return None
    offset = points - center
    distance = np.linalg.norm(offset - np.outer(offset @ axis, axis), axis=1)
    on = np.abs(distance - radius) <= _EXACT * facets.tolerance + 1e-5 * radius
    lengths = np.repeat(np.linalg.norm(points[1::2] - points[::2], axis=1), 2)
    if not nearly_all(on, lengths):
        return None
    return axis, center + axis * ((origin - center) @ axis), radius


# ----------------------------------------------------------------------------------------------- spheres


def fit_sphere(patches: Patches, members: Int64, edges: Int64, whole: Float64) -> Fragment | None:
    """The sphere through the vertices (w, 3) that no intersection has cut, else through those that it has."""
    facets = patches.facets
    turn = facets.angles[edges]
    if len(edges) < 3 or turn.max() > WIDEST_ON_SPHERE:
        return None
    ball = _sphere_through(whole, facets.tolerance)
    fitted = sphere_on(patches, members, ball) if ball else None
    if fitted is None:
        ball = _sphere_of_cut_vertices(facets, members, edges)
        fitted = sphere_on(patches, members, ball) if ball else None
    return fitted


def sphere_on(patches: Patches, members: Int64, ball: Fragment) -> Fragment | None:
    """The sphere again, with the facets that show it, if all lie on it."""
    facets = patches.facets
    on = on_sphere(patches, members, ball)
    if not nearly_all(on, facets.areas[members]):
        return None
    center = (ball.low + ball.high) / 2
    broad = on & (facets.slack()[members] < 0.01)
    around = facets.offsets[members] - facets.normals[members] @ center
    inner = float((around[broad] / ball.radius).min(initial=1.0))
    return replace(ball, inner=inner, facets=members)


def on_sphere(patches: Patches, members: Int64, ball: Fragment) -> Bool:
    """Which facets (k,) are chords of a sphere: no corner beyond the radius, none too far within."""
    facets = patches.facets
    center = (ball.low + ball.high) / 2
    reach = _EXACT * facets.tolerance + 1e-5 * ball.radius
    slack = facets.slack()[members]
    around = facets.offsets[members] - facets.normals[members] @ center
    nearest = (1 - 2.2 * (1 - ball.inner)) * ball.radius if ball.inner < 1 else FLATTEST_SPHERE * ball.radius
    is_chord = (around <= ball.radius + reach) & (around >= nearest - reach) | (slack > 0.01)
    corners, first = patches.corner_rows(members)
    distance = np.linalg.norm(patches.corner_points[corners] - center, axis=1)
    farthest, closest = np.maximum.reduceat(distance, first), np.minimum.reduceat(distance, first)
    return is_chord & (farthest <= ball.radius + reach) & (closest >= nearest - reach)


def _sphere_through(points: Float64, tolerance: float) -> Fragment | None:
    """Least squares of |x|^2 = 2 c . x + k; None unless all points lie on it."""
    if len(points) < 4:
        return None
    middle = points.mean(axis=0)
    offset = points - middle
    scale = float(np.abs(offset).max())
    if scale <= 10 * tolerance:
        return None
    unit = offset / scale
    system = np.column_stack([2 * unit, np.ones(len(unit))])
    solution, _, rank, _ = np.linalg.lstsq(system, np.einsum("pk,pk->p", unit, unit), rcond=1e-6)
    square = solution[3] + solution[:3] @ solution[:3]
    if rank < 4 or not square > 0:
        return None
    center, radius = middle + scale * solution[:3], scale * float(np.sqrt(square))
    if np.abs(np.linalg.norm(points - center, axis=1) - radius).max() > _EXACT * tolerance + 1e-5 * radius:
        return None
    return Fragment(
        Kind.SPHERE,
        np.eye(3),
        center - radius,
        center + radius,
        np.ones((3, 2), bool),
        1.0,
        np.zeros(0, np.int64),
    )


def _sphere_of_cut_vertices(facets: Facets, members: Int64, edges: Int64) -> Fragment | None:
    """The sphere through where neighbouring edges of its facets meet, be it inside another primitive.

    Two edges of a triangle meet at a vertex of the sphere, two of a quadrilateral mostly: most points agree.
    """
    if len(members) > _MOST_CUT:
        return None
    points = []
    for facet in members:
        own = edges[(facets.pair[edges] == facet).any(axis=1)]
        near = np.unique(facets.pair[own].sum(axis=1) - facet)
        for i, j in ((i, j) for i in near for j in near if i < j):
            planes = facets.normals[[facet, i, j]]
            if abs(np.linalg.det(planes)) > 1e-4:
                points.append(np.linalg.solve(planes, facets.offsets[[facet, i, j]]))
    if len(points) < _LEAST_CUT:
        return None
    spots = np.array(points)
    rng = np.random.default_rng(0)
    best, most = None, 0
    for _ in range(_TRIALS):
        chosen = spots[rng.choice(len(spots), 4, replace=False)]
        ball = _sphere_through(chosen, facets.tolerance)
        if ball is None:
            continue
        off = np.abs(np.linalg.norm(spots - (ball.low + ball.high) / 2, axis=1) - ball.radius)
        near = off <= 100 * facets.tolerance + 1e-4 * ball.radius
        if near.sum() > most:
            best, most = near, int(near.sum())
    if best is None or most < max(_LEAST_CUT, 0.5 * len(spots)):
        return None
    return _sphere_through(spots[best], 20 * facets.tolerance)
