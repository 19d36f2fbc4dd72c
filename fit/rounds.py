"""The cylinder or sphere of which a patch of facets shows a part.

A tessellated cylinder meets its round one along the ridges between its side facets, a sphere at the vertices
that no intersection has cut: there the radius is exact, however coarse the tessellation.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fit.facets import Bool, Facets, Int64
from fit.patches import EXACT, STRAY, Fragment, Patches, nearly_all
from fit.primitives import Kind
from fit.scene import Float64
from fit.shapes import right_handed

WIDEST_TURN = np.radians(46)
"""Between neighbouring side facets: cylinders and spheres of 8 segments and more are round."""

WIDEST_ON_SPHERE = np.radians(65)
"""Between its facets: bands of latitude may be wider than segments (4 bands: 60; an octahedron: 71)."""

FLATTEST_SPHERE = 0.78
"""Of the radius: nearest facet of a sphere (8 segments: 0.816; a box's faces are at 0.58 or nearer)."""

_MOST_CUT, _LEAST_CUT, _TRIALS = 60, 6, 100
"""Facets at most, points at least and draws of four points, for a sphere by the vertices it would have."""

_ROUNDS = 6
"""Gauss-Newton steps; two suffice from the linear start."""


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
    if astray.sum() > STRAY * np.linalg.norm(along, axis=1).sum():
        return None
    fitted = _fit_rods(facets, ridges, axis)
    if fitted is None:
        return None
    axis, center, radius = fitted
    frame = right_handed(np.stack([np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))]), axis], axis=1))
    local = center @ frame
    reach = np.array([radius, 0.0, radius])
    inner = float(np.cos(WIDEST_TURN / 2))
    start = Fragment(Kind.CYLINDER, frame, local - reach, local + reach, inner, members)
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
    at_end = np.abs(level - end) <= EXACT * facets.tolerance + slack * rod.radius
    if not nearly_all(at_end | ~cap, facets.areas[members]):
        return None
    around = facets.offsets[members] - facets.normals[members] @ (rod.frame @ (middle * [1, 0, 1]))
    inner = float((around[on & ~cap] / rod.radius).min(initial=1.0))
    return replace(rod, low=low, high=high, inner=inner, facets=members)


def on_cylinder(patches: Patches, members: Int64, rod: Fragment) -> Bool:
    """Which facets (k,) are caps or side facets of an endless cylinder."""
    facets = patches.facets
    normals, slack = facets.normals[members], facets.slack()[members]
    lift = np.abs(normals @ rod.frame[:, 1])
    cap = lift > 1 - 1e-6 - slack**2
    side = lift <= 2 * slack + 1e-5
    middle = (rod.low + rod.high) / 2 * [1, 0, 1]
    around = facets.offsets[members] - normals @ (rod.frame @ middle)
    reach = EXACT * facets.tolerance + (2 * slack + 1e-5) * rod.radius
    nearest = np.cos(WIDEST_TURN / 2) * rod.radius
    corners, first = patches.corner_rows(members)
    offset = (patches.corner_points[corners] @ rod.frame - middle)[:, [0, 2]]
    beyond = np.maximum.reduceat(np.linalg.norm(offset, axis=1), first) - rod.radius
    on = cap | (side & (around <= rod.radius + reach) & (around >= nearest - reach))
    return on & (beyond <= EXACT * facets.tolerance + 1e-5 * rod.radius)


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
    on = np.abs(distance - radius) <= EXACT * facets.tolerance + 1e-5 * radius
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
    reach = EXACT * facets.tolerance + 1e-5 * ball.radius
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
    if np.abs(np.linalg.norm(points - center, axis=1) - radius).max() > EXACT * tolerance + 1e-5 * radius:
        return None
    none = np.zeros(0, np.int64)
    return Fragment(Kind.SPHERE, np.eye(3), center - radius, center + radius, 1.0, none)


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
