"""The connected spaces around a surface: which one a point lies in, which ones touch a point of the surface.

Real rooms are open sheets, so no inside tells solid from free. Instead: cells near the surface are solid, the
others fall into connected spaces. `fit.air` decides which of them are air.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fit.bvh import TriangleTree
from fit.grid import Grid
from fit.passages import Passage
from fit.rays import RayCaster
from fit.scene import Float64
from fit.surface import Surface

Bool = NDArray[np.bool_]
Int8 = NDArray[np.int8]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]

OUTSIDE = 1
"""Number of the space that surrounds everything."""

_BLOCK = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
"""A cell and its 26 neighbours."""

_FAR_CELLS = 2.7
"""Farther from a point no centre of those lies: what room it has beyond that tells no more."""

_TOUCH_SLOPE = 0.35
"""Cosine, from the normal, of the most slanting sight line along which a space touches a surface."""


@dataclass(frozen=True)
class AirSpace:
    """A space: a point (3,) in it, its volume in m3 (the outside: within the grid), why it is air or not."""

    point: tuple[float, float, float]
    volume: float
    evidence: str


@dataclass(frozen=True, eq=False)
class Air:
    """The spaces around a surface.

    label (nx, ny, nz) int32: 0 in solid cells, else the number of the cell's space; the outside has number 1.
    free (nx, ny, nz) bool: cells of the spaces taken as air. spaces: those spaces, largest first;
    rejected: the other spaces of some size, with the evidence that spoke against them.
    passages: openings of the air that are too narrow for the grid, which has closed them, the largest first.
    walls: the triangles that stop light; `tree` and `rays` search them.
    """

    grid: Grid
    label: Int32
    free: Bool
    air_labels: tuple[int, ...]
    spaces: tuple[AirSpace, ...]
    rejected: tuple[AirSpace, ...]
    passages: tuple[Passage, ...]
    walls: Surface
    tree: TriangleTree
    rays: RayCaster

    @property
    def origin(self) -> Float64:
        """Lower corner (3,) of the grid's first cell."""
        return self.grid.origin

    @property
    def cell(self) -> float:
        """Edge of a cell."""
        return self.grid.cell

    def notes(self) -> tuple[str, ...]:
        """What the report should say of the passages that the grid has closed."""
        return tuple(
            f"a passage about {p.width:.3g} m wide near {', '.join(f'{x:.4g}' for x in p.point)} "
            f"counts as closed: the grid's cells are {self.cell:.3g} m, and it tells openings of two cells"
            for p in self.passages
        )

    @cached_property
    def distance(self) -> Float64:
        """Unsigned distance to the walls at each cell's centre, (nx, ny, nz), exact, on first use."""
        cells = np.stack(np.unravel_index(np.arange(self.label.size), self.grid.shape), axis=1)
        return self.tree.nearest(self.grid.centers(cells))[0].reshape(self.grid.shape)

    def labels_at(self, points: Float64, distance: Float64 | None = None) -> Int32:
        """Number of the space that each point (p, 3) lies in; 0 within walls and passages too narrow to tell.

        A point is in a space when one of its cells' centres lies within the point's own distance to the
        surface (`distance`, when it is known already): the ball between them is empty.
        """
        if distance is None:
            distance = self.tree.nearest(points, _FAR_CELLS * self.cell)[0]
        cells = self.grid.cells_of(points)
        found = np.zeros(len(points), np.int32)
        closest = distance**2
        # Beyond this block a centre is 1.5 cells away; with that much room the own cell's centre is free too.
        for offset in _BLOCK:
            neighbour = cells + offset
            label = self.label.reshape(-1)[self.grid.flat(neighbour)]
            squared = ((self.grid.centers(neighbour) - points) ** 2).sum(axis=1)
            better = (label > 0) & self.grid.holds(neighbour) & (squared <= closest)
            found[better], closest[better] = label[better], squared[better]
        found[~self.grid.holds(cells)] = OUTSIDE
        return found

    def is_air(self, points: Float64, distance: Float64 | None = None) -> Bool:
        """Which of the points (p, 3) are in air."""
        return np.isin(self.labels_at(points, distance), self.air_labels)

    def touches(self, points: Float64, normals: Float64) -> Int8:
        """Side from which air touches surface points (p, 3) with unit normals (p, 3).

        1 along the normal, -1 against it, 2 on both sides, 0 on neither.
        """
        front, back = (np.isin(self.labels_seen(points, sign * normals), self.air_labels) for sign in (1, -1))
        return np.select([front & back, front, back], [2, 1, -1], 0).astype(np.int8)

    def labels_seen(self, points: Float64, normals: Float64) -> Int32:
        """Number of the space that touches points of the surface on the side of the normals (p, 3); 0: none.

        It touches where the centre of one of its cells, around the point one cell out, is seen from the
        surface: no other surface in between, and not along the surface.
        """
        start = points + normals * (1e-4 * self.cell)
        cells = self.grid.cells_of(points + normals * self.cell)[:, None] + _BLOCK
        centers = self.grid.centers(cells)
        step = centers - start[:, None]
        length = np.linalg.norm(step, axis=2)
        slope = np.einsum("pkc,pc->pk", step, normals) / np.maximum(length, 1e-12 * self.cell)
        label = self.label.reshape(-1)[self.grid.flat(cells.reshape(-1, 3))].reshape(length.shape)
        slope[label == 0] = -1
        seen = np.zeros(len(points), np.int32)
        waiting = np.arange(len(points))
        for choice in np.argsort(-slope, axis=1, kind="stable").T:
            waiting = waiting[slope[waiting, choice[waiting]] >= _TOUCH_SLOPE]
            if len(waiting) == 0:
                break
            pick = choice[waiting]
            clear = self.rays.visible(start[waiting], centers[waiting, pick])
            seen[waiting[clear]] = label[waiting[clear], pick[clear]]
            waiting = waiting[~clear]
        return seen

    def random_points(self, count: int, seed: int) -> Float64:
        """Points (count, 3), uniform in the air within the grid; none when nothing is air."""
        return self.random_points_and_distances(count, seed, _FAR_CELLS * self.cell)[0]

    def random_points_and_distances(
        self, count: int, seed: int, within: float = np.inf
    ) -> tuple[Float64, Float64]:
        """`random_points`, and their distance (count,) to the surface, or a bound of it beyond `within`."""
        rng = np.random.default_rng(seed)
        around = np.flatnonzero(ndimage.binary_dilation(self.free, np.ones((3, 3, 3), bool)))
        points, distances = np.zeros((0, 3)), np.zeros(0)
        while len(points) < count and len(around):
            drawn = rng.choice(around, size=count + count // 8 + 64)
            cells = np.stack(np.unravel_index(drawn, self.grid.shape), axis=1)
            new = self.origin + (cells + rng.random((len(cells), 3))) * self.cell
            distance = self.tree.nearest(new, max(within, _FAR_CELLS * self.cell))[0]
            kept = self.is_air(new, distance)
            points, distances = (
                np.concatenate([points, new[kept]]),
                np.concatenate([distances, distance[kept]]),
            )
        return points[:count], distances[:count]
