"""Keeps colours apart: boxes whose faces mix surfaces of clearly different colour are cut, or get a plate."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fit.choose import worths
from fit.color import LOOK_OUT_CELLS
from fit.objective import Targets, distance_table, error
from fit.palette import SMOOTHING_NEIGHBOURS, Palette, color_cost, face_costs, face_of
from fit.primitives import Kind, PrimitiveSet
from fit.scene import Float64
from fit.shapes import Shapes, join, make_shapes, to_primitives

Index = NDArray[np.int64]
Bool = NDArray[np.bool_]

PROUD_CELLS = LOOK_OUT_CELLS / 2
"""How far a plate stands out of its face: enough for a ray to meet the plate first, too little to shade."""

DEPTH_CELLS = 0.5
"""How deep a plate reaches into its box, where that is as thick."""

PLATE_SHARE = 0.9
"""Of its gain that a plate is credited with: a cut leaves the union as it is, and wins where both do."""

SWAP_SHARE = 0.5
"""Of the gain of a box that must make room for itself: what the shape that goes may be worth at most."""

MOST_ROUNDS = 4
_NEIGHBOURS = 6
_MEANS_STEPS = 8
_PATCHES = 3
"""Connected patches of one colour, the heaviest first, that are tried on a face."""


@dataclass(frozen=True)
class Repaint:
    """Two boxes in the place of box `owner`, and what they take off the cost of mixed colours.

    They are the two halves of a cut, or the box itself and a plate on one of its faces.
    """

    owner: int
    boxes: Shapes
    gain: float


def paint(
    shapes: Shapes, targets: Targets, palette: Palette, *, limit: int, least_gain: float, kept: int = 0
) -> Shapes:
    """The shapes, one more wherever that takes over `least_gain` off E + `color_cost`.

    Where the set has reached its `limit`, the shapes that E misses least make room, if that is worth it. The
    first `kept` shapes stay as they are.
    """
    total = error(shapes, targets) + color_cost(to_primitives(shapes), palette)
    for _ in range(MOST_ROUNDS):
        painted = _round(shapes, targets, palette, limit, least_gain, kept)
        reached = error(painted, targets) + color_cost(to_primitives(painted), palette)
        if reached >= total:
            break
        shapes, total = painted, reached
    return shapes


def _round(
    shapes: Shapes, targets: Targets, palette: Palette, limit: int, least_gain: float, kept: int
) -> Shapes:
    room = max(limit - len(shapes), 0)
    repaints = propose_repaints(shapes, palette, least_gain if room else SWAP_SHARE * least_gain, kept)
    worth = worths(distance_table(shapes, targets), targets) if len(shapes) else np.zeros(0)
    worth[[*range(kept), *(r.owner for r in repaints)]] = np.inf
    dropped, changed, added = [], shapes, []
    for number, repaint in enumerate(repaints):
        if number >= room:
            least = int(np.argmin(worth))
            if worth[least] >= SWAP_SHARE * repaint.gain:
                break
            worth[least] = np.inf
            dropped.append(least)
        changed = _replaced(changed, repaint.owner, repaint.boxes.select(slice(0, 1)))
        added.append(repaint.boxes.select(slice(1, 2)))
    return join([changed.select(np.delete(np.arange(len(changed)), dropped)), *added])


def _replaced(shapes: Shapes, row: int, box: Shapes) -> Shapes:
    columns = {f.name: getattr(shapes, f.name).copy() for f in fields(Shapes)}
    for name, column in columns.items():
        column[row] = getattr(box, name)[0]
    return Shapes(**columns)


def propose_repaints(shapes: Shapes, palette: Palette, least_gain: float, kept: int = 0) -> list[Repaint]:
    """The best cut or plate of each box with a face whose mixed colours cost more, best first."""
    if len(shapes) == 0 or len(palette) == 0:
        return []
    primitives = to_primitives(shapes)
    face = face_of(primitives, palette)
    costs = face_costs(palette, face, 6 * len(shapes))
    is_flat = np.repeat(np.isin(primitives.kinds, (Kind.BOX, Kind.PLANE)), 6)
    is_flat[: 6 * kept] = False
    best: dict[int, Repaint] = {}
    for number in np.flatnonzero((costs > least_gain) & is_flat):
        for repaint in _repaints(primitives, int(number), face, palette):
            rival = best.get(repaint.owner)
            if repaint.gain > (rival.gain if rival else least_gain):
                best[repaint.owner] = repaint
    return sorted(best.values(), key=lambda repaint: -repaint.gain)


def _repaints(primitives: PrimitiveSet, number: int, face: Index, palette: Palette) -> list[Repaint]:
    """Cuts and plates around the patches of one colour of a face."""
    rows = np.flatnonzero(face == number)
    owner, axis = number // 6, number % 6 // 2
    across = [k for k in range(3) if k != axis]
    turn, half = primitives.rotation_matrices()[owner], primitives.sizes[owner] / 2
    local = (palette.points - primitives.positions[owner]) @ turn
    flat = local[rows][:, across]
    features, weights = palette.features[rows], palette.weights[rows]
    is_first = _two_means(features, weights)
    found = []
    for members in (is_first, ~is_first):
        for patch in _patches(flat, members, weights):
            lower, upper = _rectangle(flat, members, patch, half[across])
            within = np.all((flat >= lower) & (flat <= upper), axis=1).astype(np.int64)
            gain = _gain(palette, rows, np.zeros(len(rows), np.int64), within)
            boxes = _with_plate(primitives, number, turn, across, lower, upper, palette.cell)
            found.append(Repaint(owner, boxes, PLATE_SHARE * gain))
            for place in _cuts(lower, upper, half[across]):
                axis_cut = across[place[0]]
                own = np.flatnonzero(face // 6 == owner)
                side = 6 * (local[own, axis_cut] > place[1])
                gain = _gain(palette, own, face[own] % 6, face[own] % 6 + side)
                found.append(Repaint(owner, _halves(primitives, owner, turn, axis_cut, place[1]), gain))
    return found


def _gain(palette: Palette, rows: Index, before: Index, after: Index) -> float:
    """What another assignment of the samples `rows` to faces takes off their cost."""
    return float(face_costs(palette, before, 12, rows).sum() - face_costs(palette, after, 12, rows).sum())


def _cuts(lower: Float64, upper: Float64, half: Float64) -> list[tuple[int, float]]:
    """Axis and place of each edge of the rectangle that lies within the face."""
    ends = [(k, float(end[k])) for k in (0, 1) for end in (lower, upper)]
    return [(k, place) for k, place in ends if abs(place) < (1 - 1e-6) * half[k]]


def _halves(primitives: PrimitiveSet, owner: int, turn: Float64, axis: int, place: float) -> Shapes:
    """The box cut at `place` of its local `axis`."""
    half = primitives.sizes[owner] / 2
    boxes = []
    for start, end in ((-half[axis], place), (place, half[axis])):
        halves, center = half.copy(), np.zeros(3)
        halves[axis], center[axis] = (end - start) / 2, (end + start) / 2
        position = primitives.positions[owner] + turn @ center
        boxes.append(make_shapes(Kind.BOX, position[None], turn, halves, exact=True))
    return join(boxes)


def _with_plate(
    primitives: PrimitiveSet,
    number: int,
    turn: Float64,
    across: list[int],
    lower: Float64,
    upper: Float64,
    cell: float,
) -> Shapes:
    """The box itself, and a plate over the rectangle of its face `number`."""
    owner, axis, sign = number // 6, number % 6 // 2, 1 - 2 * (number % 2)
    size = primitives.sizes[owner]
    halves, center = np.zeros(3), np.zeros(3)
    halves[across], center[across] = (upper - lower) / 2, (upper + lower) / 2
    halves[axis] = (PROUD_CELLS * cell + min(DEPTH_CELLS * cell, size[axis])) / 2
    center[axis] = sign * (size[axis] / 2 + PROUD_CELLS * cell - halves[axis])
    position = primitives.positions[owner]
    box = make_shapes(Kind.BOX, position[None], turn, size / 2, exact=True)
    return join([box, make_shapes(Kind.BOX, (position + turn @ center)[None], turn, halves, exact=True)])


def _two_means(features: Float64, weights: Float64) -> Bool:
    """Which of the samples (p,) belong to the first of two clusters, by their widest direction first."""
    offset = features - np.average(features, axis=0, weights=weights)
    covariance = np.einsum("pi,pj,p->ij", offset, offset, weights)
    first = offset @ np.linalg.eigh(covariance)[1][:, -1] > 0
    for _ in range(_MEANS_STEPS):
        if first.all() or not first.any():
            break
        centers = [np.average(features[m], axis=0, weights=weights[m]) for m in (first, ~first)]
        to_first, to_second = (((features - c) ** 2).sum(axis=1) for c in centers)
        first = to_first < to_second
    return first


def _patches(flat: Float64, members: Bool, weights: Float64) -> list[Bool]:
    """Masks (p,) of the heaviest connected patches of the members among points (p, 2) of a face."""
    if np.count_nonzero(members) < 2 or len(flat) <= _NEIGHBOURS:
        return []
    near = cKDTree(flat).query(flat, k=_NEIGHBOURS + 1)[1]
    start, end = np.repeat(np.arange(len(flat)), near.shape[1]), near.ravel()
    linked = members[start] & members[end]
    links = coo_array(
        (np.ones(int(linked.sum()), bool), (start[linked], end[linked])), shape=(len(flat),) * 2
    )
    _, label = connected_components(links, directed=False)
    mass = np.bincount(label, weights=weights * members)
    heaviest = np.argsort(-mass, kind="stable")[:_PATCHES]
    count = np.bincount(label, weights=members)
    # Smaller ones than the neighbourhood over which colours are averaged are its blur.
    return [(label == patch) & members for patch in heaviest if count[patch] >= SMOOTHING_NEIGHBOURS]


def _rectangle(flat: Float64, members: Bool, patch: Bool, half: Float64) -> tuple[Float64, Float64]:
    """The rectangle around a patch, half-way out to the first sample of another colour or to the edge."""
    lower, upper = flat[patch].min(axis=0), flat[patch].max(axis=0)
    grown_lower, grown_upper = -half.copy(), half.copy()
    for k in (0, 1):
        beside = ~members & (flat[:, 1 - k] >= lower[1 - k]) & (flat[:, 1 - k] <= upper[1 - k])
        others = flat[beside, k]
        below, above = others[others < lower[k]], others[others > upper[k]]
        if len(below):
            grown_lower[k] = (below.max() + lower[k]) / 2
        if len(above):
            grown_upper[k] = (above.min() + upper[k]) / 2
    return np.minimum(grown_lower, grown_upper), np.maximum(grown_lower, grown_upper)
