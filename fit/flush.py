"""Boxes of one frame whose faces run into each other, such as a table's legs flush with its top.

Their coplanar faces are one facet, so no patch shows a single box. But all faces lie on few planes, which cut
space into cells that are solid or not: the fewest boxes of solid cells that hold every face are the answer.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp

from fit.bvh import TriangleTree
from fit.facets import Bool, Int64
from fit.patches import Fragment
from fit.primitives import Kind
from fit.rays import RayCaster
from fit.scene import Float64
from fit.shapes import distances_to_one

MOST_CELLS = 100_000
MOST_SEEDS = 600
"""Faces of cells that boxes are grown from, in all orders of the axes."""

_SOLVER_NODES = 2_000
_SKEW = np.array([0.2718, 0.5772, 0.7699])


class Solid:
    """Which points a closed shell of outward triangles (t, 3, 3) holds, and points on it (p, 3)."""

    def __init__(self, corners: Float64, normals: Float64, samples: Float64, tolerance: float) -> None:
        self._rays = RayCaster(corners, TriangleTree(corners))
        self._normals = normals
        self.samples = samples
        self.tolerance = tolerance

    def holds(self, points: Float64) -> Bool:
        """A ray that leaves the solid meets the back of its next triangle."""
        direction = _SKEW / np.linalg.norm(_SKEW)
        triangle = self._rays.first_hit(points, np.broadcast_to(direction, points.shape).copy())[1]
        return (triangle >= 0) & (self._normals[triangle] @ direction > 0)


def flush_boxes(solid: Solid, ends: Float64, frame: Float64, known: list[Fragment]) -> list[Fragment]:
    """The fewest boxes of a frame (3, 3) that hold what the known primitives do not.

    ends (c, 3): extents, as x . frame, of the faces along the frame: where boxes may begin and end.
    """
    planes = [_distinct(ends[:, axis], 10 * solid.tolerance) for axis in range(3)]
    shape = np.array([len(p) - 1 for p in planes])
    if (shape < 1).any() or shape.prod() > MOST_CELLS:
        return []
    middles = [(p[1:] + p[:-1]) / 2 for p in planes]
    centers = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1)
    full = solid.holds(centers.reshape(-1, 3) @ frame.T).reshape(shape)
    full &= ~_crossed(solid, planes, frame, shape)
    cells, sides, spots = _faces(full, planes, centers)
    if len(cells) == 0:
        return []
    open_faces = np.ones(len(cells), bool)
    for fragment in known:
        open_faces &= distances_to_one(fragment.shape(), 0, spots @ frame.T) > 20 * solid.tolerance
    cells, sides = cells[open_faces], sides[open_faces]
    boxes = _grown(full, cells)
    if len(boxes) == 0:
        return []
    held = _held(boxes, cells)
    boxes = boxes[_fewest(held)]
    boxes = _shrunk(boxes, cells)
    low, high = (np.stack([planes[k][boxes[:, end, k]] for k in range(3)], axis=1) for end in (0, 1))
    none = np.zeros(0, np.int64)
    return [Fragment(Kind.BOX, frame, a, b, 1.0, none) for a, b in zip(low, high, strict=True)]


def _distinct(values: Float64, tolerance: float) -> Float64:
    """Sorted values, those of one cluster as its mean."""
    ordered = np.sort(values)
    group = np.cumsum(np.diff(ordered, prepend=ordered[:1]) > tolerance)
    return np.bincount(group, ordered) / np.bincount(group)


def _crossed(solid: Solid, planes: list[Float64], frame: Float64, shape: Int64) -> Bool:
    """Cells (nx, ny, nz) through whose inside a surface runs: a round one, or one of another frame."""
    local = solid.samples @ frame
    inside = np.ones(len(local), bool)
    index = np.zeros((len(local), 3), np.int64)
    margin = 20 * solid.tolerance
    for k in range(3):
        index[:, k] = np.clip(np.searchsorted(planes[k], local[:, k]) - 1, 0, shape[k] - 1)
        low, high = planes[k][index[:, k]], planes[k][index[:, k] + 1]
        inside &= (local[:, k] > low + margin) & (local[:, k] < high - margin)
    crossed = np.zeros(shape, bool)
    crossed[tuple(index[inside].T)] = True
    return crossed


def _faces(full: Bool, planes: list[Float64], centers: Float64) -> tuple[Int64, Int64, Float64]:
    """Cells (f, 3), sides (f,) and middles (f, 3) of the full cells' faces to cells that are not."""
    padded = np.pad(full, 1)
    found: list[tuple[Int64, Int64, Float64]] = []
    for axis in range(3):
        for step in (-1, 1):
            beyond = np.roll(padded, -step, axis=axis)[1:-1, 1:-1, 1:-1]
            cells = np.argwhere(full & ~beyond)
            spots = centers[tuple(cells.T)].copy()
            spots[:, axis] = planes[axis][cells[:, axis] + (step > 0)]
            found.append((cells, np.full(len(cells), 2 * axis + (step > 0)), spots))
    cells, sides, spots = (np.concatenate(part) for part in zip(*found, strict=True))
    return cells, sides, spots


def _grown(full: Bool, cells: Int64) -> Int64:
    """Distinct boxes (b, 2, 3), first cell and end, that no full layer can be added to."""
    empty = np.pad((~full).cumsum(0).cumsum(1).cumsum(2), ((1, 0), (1, 0), (1, 0)))

    def is_full(low: Int64, high: Int64) -> bool:
        if (low < 0).any() or (high > full.shape).any():
            return False
        total = 0
        for bits in range(8):
            corner = [high[k] if bits >> k & 1 else low[k] for k in range(3)]
            total += (-1) ** (3 - bits.bit_count()) * int(empty[tuple(corner)])
        return total == 0

    seeds = np.unique(cells, axis=0)
    seeds = seeds[np.linspace(0, len(seeds) - 1, min(len(seeds), MOST_SEEDS)).astype(np.int64)]
    boxes = set()
    for seed in seeds:
        for order in permutations(range(3)):
            low, high = seed.copy(), seed + 1
            for axis in order:
                step = np.eye(3, dtype=np.int64)[axis]
                while is_full(low - step, high):
                    low = low - step
                while is_full(low, high + step):
                    high = high + step
            boxes.add((*low.tolist(), *high.tolist()))
    return np.array(sorted(boxes), np.int64).reshape(-1, 2, 3)


def _held(boxes: Int64, cells: Int64) -> Bool:
    """Which boxes hold which cells (f, b)."""
    low, high = boxes[None, :, 0], boxes[None, :, 1]
    return np.all((cells[:, None] >= low) & (cells[:, None] < high), axis=2)


def _fewest(held: Bool) -> Int64:
    """Rows of the fewest boxes that hold all faces (f, b): a set cover, solved exactly where time allows."""
    rows = np.unique(held[held.any(axis=1)], axis=0)
    count = held.shape[1]
    # Of equal counts, the boxes that hold more.
    cost = 1 - 1e-3 * held.sum(axis=0) / max(len(held), 1) / count
    found = milp(
        cost,
        constraints=LinearConstraint(rows.astype(np.float64), lb=1),
        integrality=np.ones(count),
        bounds=Bounds(0, 1),
        options={"node_limit": _SOLVER_NODES},
    )
    return np.flatnonzero(found.x > 0.5) if found.x is not None else np.arange(count)


def _shrunk(boxes: Int64, cells: Int64) -> Int64:
    """Boxes cut down to the faces that no other holds, those with the fewest first; idle ones left out."""
    held = _held(boxes, cells)
    kept = list(np.argsort(held.sum(axis=0), kind="stable"))
    boxes = boxes.copy()
    for box in list(kept):
        others = [k for k in kept if k != box]
        own = cells[held[:, box] & ~held[:, others].any(axis=1)]
        if len(own) == 0:
            kept.remove(box)
            continue
        boxes[box] = own.min(axis=0), own.max(axis=0) + 1
        held[:, box] = _held(boxes[box : box + 1], cells)[:, 0]
    return boxes[sorted(kept)]
