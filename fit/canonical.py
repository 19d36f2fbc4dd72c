"""The axes in which a scene is fitted: its own, so that moving, turning or mirroring it changes nothing.

Grids, random directions and starts depend on the axes that they are drawn in. So the surface is first moved
to its centre and turned along the directions that it is built of, fitted there, and the set is moved back.
The axes follow from areas, angles and the order of the triangles alone. They may be left-handed: a mirrored
scene has mirrored axes.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from fit.bvh import TriangleTree
from fit.grid import Grid
from fit.passages import Passage
from fit.primitives import PrimitiveSet
from fit.rays import RayCaster
from fit.rotation import quaternions_from_matrices
from fit.scene import Float64, Instance, Node, Scene, transform_points
from fit.spaces import Air, AirSpace
from fit.surface import Surface, from_scene, oriented

Int64 = NDArray[np.int64]
T = TypeVar("T", bound=Any)

SAMPLES = 1024
"""Faces looked at, drawn by area."""

CONES = np.cos(np.radians([8.0, 4.0, 2.0, 1.0, 0.5, 0.1]))
"""A direction is the mean of the normals in ever narrower cones around it, while half of them stay in."""

ACROSS = 0.05
"""Cosine: normals within 3 degrees of a right angle to an axis are across it."""

LEAST_ACROSS = 0.03
"""Of the area, across the first axis, from which its normals give the second axis; else outlines do."""

OUTLINED = 3
"""Of so many faces one gives its edges to the search for an outline."""

TIE = 1e-6
"""Relative: of two that differ by less, the one that comes first in the mesh is taken, not the larger."""

STEP = 2.0**-24
"""Of the diagonal: canonical vertices are multiples of it, as fine as the float32 that files hold."""

SNAP = 1e-9
"""Axes within this of the world's are the world's."""


@dataclass(frozen=True)
class Pose:
    """Canonical coordinates in the world: axes (3, 3), columns, right- or left-handed; center (3,); metres of
    a canonical unit, which is the diagonal of the canonical bounds."""

    axes: Float64
    center: Float64
    unit: float = 1.0

    @property
    def is_mirrored(self) -> bool:
        return bool(np.linalg.det(self.axes) < 0)

    def inwards(self, points: Float64) -> Float64:
        """Canonical coordinates of world points (..., 3)."""
        return (points - self.center) @ self.axes / self.unit

    def outwards(self, points: Float64) -> Float64:
        """World coordinates of canonical points (..., 3)."""
        return points @ self.axes.T * self.unit + self.center

    def triple_inwards(self, point: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = self.inwards(np.array(point, np.float64))
        return float(x), float(y), float(z)

    def triple_outwards(self, point: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = self.outwards(np.array(point, np.float64))
        return float(x), float(y), float(z)


# ---------------------------------------------------------------------------------------------- the axes


def find_pose(surface: Surface) -> Pose:
    """The centre of a surface of at least one triangle, and axes along its heaviest directions."""
    cumulative = np.cumsum(surface.areas)
    # An irrational start: no sample falls on the border between two faces, where rounding would decide.
    shares = (np.arange(SAMPLES) + (np.sqrt(5) - 1) / 2) / SAMPLES
    faces = np.minimum(np.searchsorted(cumulative, shares * cumulative[-1]), len(surface) - 1)
    normals, corners = surface.normals[faces], surface.vertices[faces]
    first = _narrowed(normals, _heaviest(normals))
    across = np.abs(normals @ first) < ACROSS
    if across.mean() >= LEAST_ACROSS:
        flat = normals[across] - np.outer(normals[across] @ first, first)
        second = _narrowed(flat / np.linalg.norm(flat, axis=1)[:, None], _heaviest(flat))
    else:
        second = _along_outline(corners, first)
    axes = _signed(normals, corners, _orthonormal(first, second))
    if np.abs(axes - np.rint(axes)).max() < SNAP:
        axes = np.rint(axes)
    lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
    for corner in range(3):
        local = surface.vertices[:, corner] @ axes
        lower, upper = np.minimum(lower, local.min(axis=0)), np.maximum(upper, local.max(axis=0))
    return Pose(axes, axes @ ((lower + upper) / 2), float(np.linalg.norm(upper - lower)))


def _first_largest(values: Float64) -> int:
    """Index of the first value that rounding could not tell from the largest."""
    return int(np.argmax(values >= (1 - TIE) * values.max()))


def _heaviest(directions: Float64) -> Float64:
    """The direction (3,) among n (n, 3), signs aside, that most others lie around."""
    near = np.abs(directions @ directions.T) > CONES[0]
    return directions[_first_largest(near.sum(axis=1).astype(np.float64))]


def _narrowed(directions: Float64, direction: Float64) -> Float64:
    """The mode of unit vectors (n, 3), signs aside, near a first guess."""
    held = 0
    for cone in CONES:
        along = directions @ direction
        inside = np.abs(along) > cone
        if inside.sum() < held / 2 or not inside.any():
            break
        held = int(inside.sum())
        mean = np.sign(along[inside]) @ directions[inside]
        direction = mean / np.linalg.norm(mean)
    return direction


def _along_outline(corners: Float64, normal: Float64) -> Float64:
    """The edge along which the rectangle around all corners (n, 3, 3), seen along `normal`, is smallest.

    Of several such, it is the one that the corners spread most along. The smallest rectangle around a convex
    polygon shares an edge with it (Freeman and Shapira 1975).
    """
    edges = (np.roll(corners, -1, axis=1) - corners)[::OUTLINED].reshape(-1, 3)
    edges -= np.outer(edges @ normal, normal)
    lengths = np.linalg.norm(edges, axis=1)
    long = np.flatnonzero(lengths > TIE * lengths.max())
    along = edges[long] / lengths[long, None]
    points = corners.reshape(-1, 3) - corners.mean(axis=(0, 1))
    places = points @ along.T
    areas = np.ptp(places, axis=0) * np.ptp(points @ np.cross(normal, along).T, axis=0)
    smallest = np.flatnonzero(areas <= (1 + TIE) * areas.min())
    return along[smallest[_first_largest(places[:, smallest].var(axis=0))]]


def _orthonormal(first: Float64, second: Float64) -> Float64:
    second = second - first * (first @ second)
    second /= np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)], axis=1)


def _signed(normals: Float64, corners: Float64, axes: Float64) -> Float64:
    """Axes that point where most faces look, or lie far out, or the first of them: mirrored with the mesh."""
    points = corners - corners.mean(axis=(0, 1))
    points /= np.abs(points).max()
    facing, along = normals @ axes, points @ axes
    middles = along.mean(axis=1)
    signs = np.ones(3)
    for axis in range(3):
        means = [values[..., axis].mean() for values in (facing, along**3)]
        firsts = [values[_first_largest(np.abs(values[:, axis])), axis] for values in (facing, middles)]
        told = [value for value in (*means, *firsts) if abs(value) > TIE]
        signs[axis] = np.sign(told[0]) if told else 1.0
    return axes * signs


# ---------------------------------------------------------------------------------------- into the pose


def to_canonical(scene: Scene) -> tuple[Pose, Scene, Surface]:
    """The scene's pose, and the scene and its surface in canonical coordinates."""
    anchor = _some_vertex(scene)
    near = moved_scene(scene, Pose(np.eye(3), anchor))  # far from the origin, only differences are exact
    surface = from_scene(near)
    if len(surface) == 0:
        return Pose(np.eye(3), anchor), near, surface
    pose = find_pose(surface.walls() if surface.is_wall.any() else surface)
    return replace(pose, center=pose.center + anchor), moved_scene(near, pose), moved_surface(surface, pose)


def in_axes_of(air: Air, scene: Scene) -> tuple[Pose, Scene, Surface]:
    """The same in the axes that a given air was found in: canonical ones, or else the world's."""
    if isinstance(air, TurnedAir):
        return to_canonical(scene)
    return Pose(np.eye(3), np.zeros(3)), scene, from_scene(scene)


def _some_vertex(scene: Scene) -> Float64:
    """In the world; zero when there is none."""
    for instance in scene.instances:
        vertices = scene.meshes[instance.mesh].positions
        if len(vertices):
            return transform_points(instance.world_from_local, vertices[:1])[0]
    return np.zeros(3)


def moved_scene(scene: Scene, pose: Pose) -> Scene:
    """The scene in canonical coordinates."""

    def placed(matrix: Float64) -> Float64:
        result = matrix.copy()
        result[:3, :3] = pose.axes.T @ matrix[:3, :3] / pose.unit
        result[:3, 3] = pose.inwards(matrix[:3, 3])
        return result

    def node(old: Node) -> Node:
        world = placed(old.world_from_local)
        return replace(old, world_from_local=world, local=world if old.parent < 0 else old.local)

    return replace(
        scene,
        nodes=tuple(node(old) for old in scene.nodes),
        instances=tuple(Instance(i.mesh, i.node, placed(i.world_from_local)) for i in scene.instances),
        lights=tuple(replace(k, world_from_local=placed(k.world_from_local)) for k in scene.lights),
        cameras=tuple(replace(k, world_from_local=placed(k.world_from_local)) for k in scene.cameras),
    )


def moved_surface(surface: Surface, pose: Pose) -> Surface:
    """The surface in canonical coordinates, rounded to `STEP`; fronts stay fronts.

    So its vertices, and all that follows from them, are the same bits wherever the scene stands: the last
    digit of one number can send a search another way.
    """
    vertices = pose.inwards(surface.vertices)
    np.rint(np.divide(vertices, STEP, out=vertices), out=vertices)
    vertices *= STEP
    if pose.is_mirrored:
        vertices = vertices[:, [0, 2, 1]]
    vertices, normals, areas, kept = oriented(vertices)
    return replace(
        surface if len(kept) == len(surface) else surface.select(kept),
        vertices=vertices,
        normals=normals,
        areas=areas,
    )


# ------------------------------------------------------------------------------------- back to the world


def world_primitives(primitives: PrimitiveSet, pose: Pose) -> PrimitiveSet:
    """A set fitted in canonical coordinates, in the world. Mirrored, its local x axes change their ends."""
    turn = pose.axes @ primitives.rotation_matrices()
    albedo, emission = primitives.albedo, primitives.emission
    if pose.is_mirrored:
        turn = turn * [-1.0, 1.0, 1.0]
        swapped = [1, 0, 2, 3, 4, 5]
        albedo, emission = albedo[:, swapped], emission[:, swapped]
    return replace(
        primitives,
        positions=pose.outwards(primitives.positions),
        rotations=quaternions_from_matrices(turn),
        sizes=primitives.sizes * pose.unit,
        albedo=albedo,
        emission=emission,
    )


def world_surface(surface: Surface, pose: Pose) -> Surface:
    """A canonical surface in the world."""
    vertices = pose.outwards(surface.vertices)
    return replace(
        surface,
        vertices=vertices[:, [0, 2, 1]] if pose.is_mirrored else vertices,
        normals=surface.normals @ pose.axes.T,
        areas=surface.areas * pose.unit**2,
    )


def world_lengths(figures: T, pose: Pose) -> T:
    """A dataclass of figures with those whose names end in `_m`, lengths, in metres."""
    names = [f.name for f in fields(figures) if f.name.endswith("_m")]
    return replace(figures, **{name: getattr(figures, name) * pose.unit for name in names})


class _TurnedTree(TriangleTree):
    """A tree of canonical triangles, asked in the world."""

    def __init__(self, tree: TriangleTree, pose: Pose) -> None:
        self._inner, self._pose = tree, pose
        self.center, self.diagonal = pose.outwards(tree.center), tree.diagonal * pose.unit

    def nearest(self, points: Float64, within: float = np.inf) -> tuple[Float64, Int64]:
        distance, triangle = self._inner.nearest(self._pose.inwards(points), within / self._pose.unit)
        return distance * self._pose.unit, triangle

    def first_hit(self, origins: Float64, directions: Float64) -> tuple[Float64, Int64]:
        return _turned_hits(self._inner, self._pose, origins, directions)


class _TurnedRays(RayCaster):
    """Rays of the world cast at canonical triangles."""

    def __init__(self, rays: RayCaster, pose: Pose) -> None:
        self._inner, self._pose = rays, pose

    def first_hit(self, origins: Float64, directions: Float64) -> tuple[Float64, Int64]:
        return _turned_hits(self._inner, self._pose, origins, directions)


def _turned_hits(
    target: TriangleTree | RayCaster, pose: Pose, origins: Float64, directions: Float64
) -> tuple[Float64, Int64]:
    distance, triangle = target.first_hit(pose.inwards(origins), directions @ pose.axes)
    return distance * pose.unit, triangle


@dataclass(frozen=True)
class TurnedGrid(Grid):
    """A grid along canonical axes, asked in the world; its cell is in metres, `origin` a world point."""

    inner: Grid
    pose: Pose

    def cells_of(self, points: Float64) -> Int64:
        return self.inner.cells_of(self.pose.inwards(points))

    def centers(self, cells: Int64) -> Float64:
        return self.pose.outwards(self.inner.centers(cells))


@dataclass(frozen=True, eq=False)
class TurnedAir(Air):
    """Air found in canonical coordinates (`inner`), asked in the world."""

    inner: Air
    pose: Pose

    def random_points_and_distances(
        self, count: int, seed: int, within: float = np.inf
    ) -> tuple[Float64, Float64]:
        points, distances = self.inner.random_points_and_distances(count, seed, within / self.pose.unit)
        return self.pose.outwards(points), distances * self.pose.unit


def world_air(air: Air, pose: Pose) -> TurnedAir:
    """Canonical air in the world: points, directions, triangles and spaces are the world's."""
    unit, grid = pose.unit, air.grid

    def space(old: AirSpace) -> AirSpace:
        return replace(old, point=pose.triple_outwards(old.point), volume=old.volume * unit**3)

    def passage(old: Passage) -> Passage:
        point = pose.triple_outwards(old.point)
        return replace(old, point=point, width=old.width * unit, area=old.area * unit**2)

    values = {f.name: getattr(air, f.name) for f in fields(Air)} | {
        "grid": TurnedGrid(pose.outwards(grid.origin), grid.cell * unit, grid.shape, grid, pose),
        "spaces": tuple(space(old) for old in air.spaces),
        "rejected": tuple(space(old) for old in air.rejected),
        "passages": tuple(passage(old) for old in air.passages),
        "walls": world_surface(air.walls, pose),
        "tree": _TurnedTree(air.tree, pose),
        "rays": _TurnedRays(air.rays, pose),
    }
    return TurnedAir(**values, inner=air, pose=pose)
