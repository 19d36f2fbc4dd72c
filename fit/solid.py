"""The solid that closed surfaces bound: which points are inside, and how deep.

Most rooms are open sheets, whose far side is don't-care. A closed body is more: its inside is known to be
solid, so a set that stands for it should fill it. `find_solid` says where that is so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fit.bvh import TriangleTree
from fit.clean import NoMeshLab, close_holes, load_meshlab, wrap
from fit.grid import PADDING_CELLS
from fit.objective import Targets, join_targets
from fit.rays import RayCaster
from fit.sample import sample_surface
from fit.scene import Float64
from fit.spaces import OUTSIDE, Air
from fit.surface import Surface, from_triangles
from fit.volume import NotClosed, mesh_solid

MOST_TRIANGLES = 400_000
"""Of closed surfaces: their exact union takes seconds beyond."""


DEEPEST_CELLS = 0.5
"""A union's distance is a bound where its shapes overlap: deeper than this nothing is asked for."""

FARTHEST_CELLS = 1.5
"""What is not filled counts by how much it is, hardly by how deep: farther distances count as this one."""

NEAR_CELLS = 3
"""Points nearer to the surface than this tell of detail and are drawn as densely as the air's."""

MOST_MENDED = 150_000
"""Triangles of a body with holes: the wrap takes 5 s for 70,000."""

FRONTS = 0.95
"""Share of the surface that air sees which must be fronts alone: rooms and foliage show backs."""

HIDDEN_INSIDE, FREE_INSIDE = 0.9, 0.05
"""Of the hidden cells and of the free ones: a mended body fills those, and these not."""

MENDING_POINTS = 2000

_INNER = (slice(PADDING_CELLS, -PADDING_CELLS),) * 3

_VOTES = np.array([[0.86, 0.41, 0.31], [-0.47, 0.83, 0.3], [0.21, -0.38, -0.9]])
"""Directions of the rays that tell inside from outside; the majority decides where one grazes an edge."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A solid by its boundary: t triangles, counter-clockwise seen from outside, that nowhere meet."""

    boundary: Surface
    tree: TriangleTree
    rays: RayCaster

    def inside(self, points: Float64) -> NDArray[np.bool_]:
        """Which of the points (p, 3) lie in the solid: rays from there first meet the back of a face."""
        votes = np.zeros(len(points), np.int64)
        for direction in _VOTES / np.linalg.norm(_VOTES, axis=1, keepdims=True):
            _, triangle = self.rays.first_hit(points, np.broadcast_to(direction, points.shape))
            votes += (triangle >= 0) & (self.boundary.normals[triangle] @ direction > 0)
        return 2 * votes > len(_VOTES)

    def distances(self, points: Float64) -> Float64:
        """Signed distance (p,) of points (p, 3) to the boundary, negative inside."""
        return np.where(self.inside(points), -1.0, 1.0) * self.tree.nearest(points)[0]


def find_solid(air: Air) -> Solid | None:
    """The union of the closed surfaces that the walls are and that hold no air; None where there is none.

    A body with holes, of which the air sees nothing but fronts, is mended.
    """
    boundary = _union(air.walls, air)
    if boundary is not None and len(boundary) > 0:
        return _solid_of(boundary)
    return _mended(air)


def missing_repair(air: Air) -> str:
    """Why a body with holes in it was not mended, where that is for want of pymeshlab; else nothing."""
    if not _has_holes(air):
        return ""
    try:
        load_meshlab()
    except NoMeshLab as why:
        return f"a body with holes was not closed: {why}" if _union(air.walls, air) is None else ""
    return ""


def _solid_of(boundary: Surface) -> Solid:
    tree = TriangleTree(boundary.vertices)
    return Solid(boundary, tree, RayCaster(boundary.vertices, tree))


def _mended(air: Air) -> Solid | None:
    """A body with lids on its holes or, where these don't close it, wrapped; None where air is in it."""
    if not _has_holes(air):
        return None
    hidden, free = _cells_within(air)
    vertices = air.walls.vertices
    for mend in (close_holes, wrap):
        try:
            vertices = mend(vertices)
        except NoMeshLab:
            return None
        boundary = _union(from_triangles(vertices), None)
        if boundary is not None and len(boundary) > 0:
            solid = _solid_of(boundary)
            if solid.inside(hidden).mean() >= HIDDEN_INSIDE and solid.inside(free).mean() <= FREE_INSIDE:
                return solid
    return None


def _has_holes(air: Air) -> bool:
    """Whether open walls look like a body seen from outside, whose holes are worth closing."""
    if len(air.walls) > MOST_MENDED or air.air_labels != (OUTSIDE,):
        return False
    return bool(_hidden(air)[_INNER].any()) and _shows_fronts(air)


def _hidden(air: Air) -> NDArray[np.bool_]:
    """Cells of spaces that are no air."""
    return (air.label > 0) & ~air.free


def _cells_within(air: Air) -> tuple[Float64, Float64]:
    """Centres (n, 3) of cells of the surface's box: in spaces that are no air, and in air."""
    rng = np.random.default_rng(0)
    centers = []
    for chosen in (_hidden(air), air.free):
        cells = np.argwhere(chosen[_INNER])
        cells = cells[np.sort(rng.permutation(len(cells))[:MENDING_POINTS])]
        centers.append(air.grid.centers(cells + PADDING_CELLS))
    return centers[0], centers[1]


def _shows_fronts(air: Air) -> bool:
    samples = sample_surface(air.walls, MENDING_POINTS, seed=0)
    side = air.touches(samples.points, samples.normals)
    return bool((side == 1).sum() >= FRONTS * (side != 0).sum() > 0)


def _union(walls: Surface, air: Air | None) -> Surface | None:
    if not 0 < len(walls) <= MOST_TRIANGLES:
        return None
    center, scale = walls.center, walls.diagonal
    try:
        mesh = mesh_solid(walls, center, scale, air).to_mesh64()
    except NotClosed:
        return None
    corners = np.array(mesh.vert_properties)[:, :3][np.array(mesh.tri_verts).astype(np.int64)]
    return from_triangles(corners * scale + center)


def inside_targets(targets: Targets, air: Air, solid: Solid, count: int, seed: int) -> Targets:
    """The targets, and up to `count` points in the solid, whose distances are negative.

    Half of them are near the surface, as with the air's, and there they weigh as much for their volume.
    """
    if len(targets) == 0:
        return targets
    rng = np.random.default_rng(seed)
    depth = ndimage.distance_transform_cdt(~air.free, "chessboard")  # cells to the nearest one of air
    near = (depth > 0) & (depth <= NEAR_CELLS)
    outside = ndimage.distance_transform_cdt(air.free, "chessboard") <= NEAR_CELLS
    weight_of_a_cell = 0.5 / max(int((air.free & outside).sum()), 1)
    drawn, weights = [], []
    for stratum in (near, depth > NEAR_CELLS):
        cells = np.flatnonzero(stratum.ravel())
        chosen = np.sort(rng.choice(cells, size=min(count // 2, len(cells)), replace=False))
        drawn.append(chosen)
        weights.append(np.full(len(chosen), weight_of_a_cell * len(cells) / max(len(chosen), 1)))
    index = np.concatenate(drawn)
    points = air.grid.centers(np.stack(np.unravel_index(index, air.grid.shape), axis=1))
    points += (rng.random(points.shape) - 0.5) * air.cell
    inside = solid.inside(points)
    points, weight = points[inside], np.concatenate(weights)[inside]
    if len(points) == 0:
        return targets
    deepest = np.minimum(solid.tree.nearest(points)[0], DEEPEST_CELLS * air.cell)
    added = replace(
        targets.select(np.zeros(len(points), np.int64)),
        points=points,
        distances=-np.maximum(deepest, np.finfo(float).tiny),
        weights=weight,
        normals=np.zeros((len(points), 3)),
        sample=np.full(len(points), -1, np.int64),
        caps=np.full(len(points), FARTHEST_CELLS * air.cell),
        ways=np.zeros((len(points), 3)),
        is_line=np.zeros(len(points), bool),
        late=np.zeros(len(points)),
        filled=np.zeros(len(points)),
    )
    return join_targets([targets, added])
