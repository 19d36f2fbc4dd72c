"""First hits of rays on a primitive set, in closed form: what sphere tracing its union converges to."""

from __future__ import annotations

import numpy as np

from fit.primitives import Kind, PrimitiveSet
from fit.scene import Float64

_PAIRS_AT_ONCE = 1 << 18


def first_hits(primitives: PrimitiveSet, origins: Float64, directions: Float64) -> Float64:
    """Distance (p,) along unit directions (p, 3) to the set: 0 from inside it, inf where it is missed.

    Each primitive is convex, so a ray is inside it from one distance to another, and the union's first hit is
    the smallest of the entries that lie ahead.
    """
    nearest = np.full(len(origins), np.inf)
    if len(primitives) == 0:
        return nearest
    turn, half = primitives.rotation_matrices(), primitives.sizes / 2
    for start in range(0, len(origins), max(1, _PAIRS_AT_ONCE // len(primitives))):
        rays = slice(start, start + max(1, _PAIRS_AT_ONCE // len(primitives)))
        for kind, members in _formulas(primitives):
            offset = origins[rays, None] - primitives.positions[members]
            at = np.einsum("pni,nij->pnj", offset, turn[members])
            toward = np.einsum("pi,nij->pnj", directions[rays], turn[members])
            entry, leave = _INTERVALS[kind](at, toward, half[members])
            entry = np.maximum(entry, 0)
            hit = np.where(entry < leave, entry, np.inf).min(axis=1)
            nearest[rays] = np.minimum(nearest[rays], hit)
    return nearest


_HALF_SPACE = len(Kind)


def _formulas(primitives: PrimitiveSet) -> list[tuple[int, np.ndarray]]:
    formula = np.where(primitives.is_half_space, _HALF_SPACE, primitives.kinds)
    return [(int(kind), np.flatnonzero(formula == kind)) for kind in np.unique(formula)]


def _slab(at: Float64, toward: Float64, half: Float64) -> tuple[Float64, Float64]:
    """Where lines at + t toward are within +-half of one axis; an empty interval is (inf, -inf)."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        first, second = (-half - at) / toward, (half - at) / toward
    parallel = toward == 0
    within = np.abs(at) <= half
    entry = np.where(parallel, np.where(within, -np.inf, np.inf), np.minimum(first, second))
    leave = np.where(parallel, np.where(within, np.inf, -np.inf), np.maximum(first, second))
    return entry, leave


def _through_box(at: Float64, toward: Float64, half: Float64) -> tuple[Float64, Float64]:
    entry, leave = _slab(at, toward, half)
    return entry.max(axis=-1), leave.min(axis=-1)


def _through_round(at: Float64, toward: Float64, radius: Float64) -> tuple[Float64, Float64]:
    """Where lines are within `radius` of the origin, in any number of dimensions."""
    a = np.einsum("pnk,pnk->pn", toward, toward)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        middle = np.where(a > 0, -np.einsum("pnk,pnk->pn", at, toward) / a, 0.0)
    # From the closest approach: the textbook's discriminant loses all digits from afar.
    closest = at + middle[..., None] * toward
    room = radius**2 - np.einsum("pnk,pnk->pn", closest, closest)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(room > 0, np.sqrt(np.maximum(room, 0) / a), -np.inf)
    return middle - reach, middle + reach


def _through_sphere(at: Float64, toward: Float64, half: Float64) -> tuple[Float64, Float64]:
    return _through_round(at, toward, half[:, 0])


def _through_cylinder(at: Float64, toward: Float64, half: Float64) -> tuple[Float64, Float64]:
    side = _through_round(at[..., ::2], toward[..., ::2], half[:, 0])
    caps = _slab(at[..., 1], toward[..., 1], half[:, 1])
    return np.maximum(side[0], caps[0]), np.minimum(side[1], caps[1])


def _through_half_space(at: Float64, toward: Float64, half: Float64) -> tuple[Float64, Float64]:
    height, rise = at[..., 1], toward[..., 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = -height / rise
    below = np.where(height <= 0, -np.inf, np.inf)
    entry = np.where(rise < 0, crossing, below)
    leave = np.where(rise > 0, crossing, np.where(rise < 0, np.inf, -below))
    return entry, leave


_INTERVALS = {
    Kind.BOX.value: _through_box,
    Kind.SPHERE.value: _through_sphere,
    Kind.CYLINDER.value: _through_cylinder,
    Kind.PLANE.value: _through_box,
    _HALF_SPACE: _through_half_space,
}
