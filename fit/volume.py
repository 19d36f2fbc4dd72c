"""Exact volumes and overlaps through manifold3d, where the mesh is closed.

manifold3d refuses open meshes, counts nested shells twice, gives inverted ones a negative volume and lets one
bad operand poison a whole boolean: so each closed piece is checked and turned by itself before any union.
"""

from __future__ import annotations

from dataclasses import dataclass

import manifold3d
import numpy as np
from manifold3d import Manifold, OpType
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fit.primitives import Kind, PrimitiveSet
from fit.scene import Float64
from fit.spaces import Air
from fit.surface import Surface

SEGMENTS = 128
"""Of a round primitive's tessellation, which is then scaled to the exact volume."""

MAX_TRIANGLES = 1_000_000
"""Meshes beyond this are not compared by booleans: minutes, and never closed in practice."""

_WELD = 1e-7
"""Vertices nearer than this share of the diagonal are one, where exact duplicates leave seams open."""

_FLAT = 1e-4
"""A piece is a sheet when its mean thickness (twice volume by area) is below this share of the diagonal."""

_KEPT_AREA = 0.9
"""Share of a piece's area that its closed shells must keep."""


@dataclass(frozen=True)
class Volumes:
    """Volumes in m3: of the solid that the mesh bounds, of the set's union, of what both fill and of what
    only one of them does; intersection over union, and the relative error of the set's volume.

    What the mesh does not allow is None, and `reason` says why. Round primitives are polyhedra of the exact
    volume here, whose surface is off by 1e-4 of the radius: so uncertain is what they share with others.
    """

    mesh: float | None = None
    set: float | None = None
    intersection: float | None = None
    symmetric_difference: float | None = None
    iou: float | None = None
    error: float | None = None
    reason: str = ""

    def in_units(self, unit: float) -> Volumes:
        """The same when what was one is `unit` long."""
        volumes = (self.mesh, self.set, self.intersection, self.symmetric_difference)
        mesh, filled, common, either = (None if v is None else v * unit**3 for v in volumes)
        return Volumes(mesh, filled, common, either, self.iou, self.error, self.reason)


class NotClosed(ValueError):
    """The mesh bounds no solid; the message says why."""


def compare_volumes(primitives: PrimitiveSet, surface: Surface, air: Air | None = None) -> Volumes:
    """The set's union against the solid that the surface bounds. Insides that are air are no solid.

    Half-spaces count within the surface's bounds and 5 % of the diagonal more.
    """
    center, scale = surface.center, surface.diagonal or 1.0
    lower, upper = surface.bounds
    padding = 0.05 * scale
    union = primitive_solid(primitives, center, scale, (lower - padding, upper + padding))
    filled = union.volume()
    try:
        mesh = mesh_solid(surface, center, scale, air)
    except NotClosed as why:
        return Volumes(set=filled, reason=str(why)).in_units(scale)
    solid, common = mesh.volume(), (mesh ^ union).volume()
    either = solid + filled - common
    return Volumes(
        mesh=solid,
        set=filled,
        intersection=common,
        symmetric_difference=max(either - common, 0.0),
        iou=min(max(common / either, 0.0), 1.0),
        error=abs(filled - solid) / solid,
    ).in_units(scale)


# ------------------------------------------------------------------------------------------------- meshes


def mesh_solid(surface: Surface, center: Float64, scale: float, air: Air | None = None) -> Manifold:
    """The solid that the surface bounds, as (x - center) / scale.

    Each closed shell is filled, whichever way it faces, unless `air` lies in it: then it is a hollow in the
    others.

    Raises:
        NotClosed: a part is open, flat, too large, or a room without an outside.
    """
    if len(surface) == 0:
        raise NotClosed("the surface is empty")
    if len(surface) > MAX_TRIANGLES:
        raise NotClosed(f"{len(surface)} triangles are too many for exact booleans")
    # The area vectors of a closed mesh sum to zero: most open ones are told by that alone.
    if np.abs(surface.areas @ surface.normals).max() > 1e-6 * surface.areas.sum():
        raise NotClosed("the mesh is open")
    unit = (surface.vertices - center) / scale
    shells = [shell for rows in _parts(surface) for shell in _closed_shells(unit[rows])]
    full: list[Manifold] = []
    hollow: list[Manifold] = []
    for shell in shells:
        (hollow if air is not None and _holds_air(shell, air, center, scale) else full).append(shell)
    if not full:
        raise NotClosed("the mesh is closed, but around the air: it bounds no solid")
    solid = _boolean(full, OpType.Add)
    if hollow:
        rooms = _boolean(hollow, OpType.Add)
        if (rooms - solid).volume() > 1e-6 * rooms.volume():
            raise NotClosed("a room has no outer wall, so its walls have no volume")
        solid = solid - rooms
    return solid


def _parts(surface: Surface) -> list[NDArray[np.int64]]:
    """Rows of the surface by instance; instances that are open alone are one part, as pieces of one whole."""
    order = np.argsort(surface.instance, kind="stable")
    starts = np.flatnonzero(np.diff(surface.instance[order], prepend=-1))
    parts = np.split(order, starts[1:])
    closed = [_is_closed(_weld(surface.vertices[rows])[1]) for rows in parts]
    together = [rows for rows, shut in zip(parts, closed, strict=True) if not shut]
    alone = [rows for rows, shut in zip(parts, closed, strict=True) if shut]
    return alone + ([np.concatenate(together)] if together else [])


def _closed_shells(corners: Float64) -> list[Manifold]:
    """The connected closed shells of triangles (t, 3, 3), each turned to have a positive volume."""
    points, triangles = _weld(corners)
    if not _is_closed(triangles):
        points, triangles = _weld(corners, _WELD)
    if not _is_closed(triangles):
        raise NotClosed("the mesh is open")
    whole = _manifold(points, triangles)
    shells = [shell if shell.volume() >= 0 else _turned(shell) for shell in whole.decompose()]
    areas = np.array([shell.surface_area() for shell in shells])
    is_flat = any(2 * shell.volume() < _FLAT * area for shell, area in zip(shells, areas, strict=True))
    # manifold3d drops doubled faces without a word; what they covered is then missing.
    if is_flat or areas.sum() < _KEPT_AREA * _area(points[triangles]):
        raise NotClosed("the mesh has sheets of no volume")
    return shells


def _area(corners: Float64) -> float:
    """Of triangles (t, 3, 3)."""
    edges = corners[:, 1:] - corners[:, :1]
    return float(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum() / 2)


def _weld(corners: Float64, tolerance: float = 0.0) -> tuple[Float64, NDArray[np.int64]]:
    """Distinct points (n, 3) and triangles (t, 3) of a soup (t, 3, 3), less those that welding flattens."""
    soup = corners.reshape(-1, 3)
    # One number for each point sorts ten times faster than three; should two points share it, three do.
    key = soup[:, 0] + soup[:, 1] * np.sqrt(2) + soup[:, 2] * np.sqrt(5)
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    if not np.array_equal(soup[first][index], soup):
        _, first, index = np.unique(soup, axis=0, return_index=True, return_inverse=True)
    points, triangles = soup[first], index.reshape(-1, 3)
    if tolerance > 0:
        pairs = cKDTree(points).query_pairs(tolerance, output_type="ndarray")
        links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(points),) * 2)
        cluster = connected_components(links, directed=False)[1]
        points, triangles = points[np.unique(cluster, return_index=True)[1]], cluster[triangles]
    a, b, c = triangles.T
    return points, triangles[(a != b) & (b != c) & (c != a)]


def _is_closed(triangles: NDArray[np.int64]) -> bool:
    """Whether each edge is walked as often one way as the other."""
    edges = np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    size = int(triangles.max(initial=0)) + 1
    there, back = np.sort(edges[:, 0] * size + edges[:, 1]), np.sort(edges[:, 1] * size + edges[:, 0])
    return len(there) > 0 and bool(np.array_equal(there, back))


def _manifold(points: Float64, triangles: NDArray[np.int64]) -> Manifold:
    used, index = np.unique(triangles, return_inverse=True)
    mesh = manifold3d.Mesh64(
        vert_properties=np.array(points[used], order="C"),
        tri_verts=np.array(index.reshape(-1, 3), np.uint64, order="C"),
    )
    return _checked(Manifold(mesh))


def _checked(solid: Manifold) -> Manifold:
    if solid.status() != manifold3d.Error.NoError:
        raise NotClosed(f"the mesh bounds no solid ({solid.status().name})")
    return solid


def _turned(shell: Manifold) -> Manifold:
    mesh = shell.to_mesh64()
    return _manifold(
        np.array(mesh.vert_properties[:, :3]), np.array(mesh.tri_verts)[:, ::-1].astype(np.int64)
    )


def _boolean(solids: list[Manifold], operation: OpType) -> Manifold:
    return _checked(Manifold.batch_boolean(solids, operation))


def _holds_air(shell: Manifold, air: Air, center: Float64, scale: float) -> bool:
    """Whether most of a shell that anything touches from inside is touched by air."""
    mesh = shell.to_mesh64()
    corners = np.array(mesh.vert_properties)[:, :3][np.array(mesh.tri_verts).astype(np.int64)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    largest = np.argsort(-areas, kind="stable")[:256]
    middles = corners[largest].mean(axis=1) * scale + center
    seen = air.labels_seen(middles, -normals[largest] / areas[largest, None])
    touched = seen > 0
    return bool(areas[largest] @ np.isin(seen, air.air_labels) > 0.5 * (areas[largest] @ touched) > 0)


# --------------------------------------------------------------------------------------------- primitives


def primitive_solid(
    primitives: PrimitiveSet, center: Float64, scale: float, bounds: tuple[Float64, Float64] | None = None
) -> Manifold:
    """The union of the set as (x - center) / scale; half-spaces are cut to the bounds, which they need."""
    turn = primitives.rotation_matrices()
    solids = []
    for i, kind in enumerate(primitives.kinds):
        if primitives.is_half_space[i]:
            if bounds is None:
                raise ValueError(f"primitive {i} is a half-space: its volume needs bounds")
            lower, upper = ((corner - center) / scale for corner in bounds)
            normal = turn[i, :, 1]
            height = float(-normal @ (primitives.positions[i] - center) / scale)
            block = Manifold.cube(tuple(upper - lower)).translate(tuple(lower))
            solids.append(block.trim_by_plane(tuple(-normal), height))
            continue
        sized = turn[i] * (primitives.sizes[i] / scale)
        place = np.column_stack([sized, (primitives.positions[i] - center) / scale])
        solids.append(_unit_solid(Kind(int(kind))).transform(place))
    return _boolean(solids, OpType.Add) if solids else Manifold()


def _unit_solid(kind: Kind) -> Manifold:
    """A primitive of sizes 1 about the origin; round ones are blown up to the volume of the round thing."""
    if kind == Kind.SPHERE:
        ball = Manifold.sphere(0.5, SEGMENTS)
        return ball.scale([(np.pi / 6 / ball.volume()) ** (1 / 3)] * 3)
    if kind == Kind.CYLINDER:
        rod = Manifold.cylinder(1.0, 0.5, 0.5, SEGMENTS, True).rotate((-90, 0, 0))
        widen = np.sqrt(np.pi / 4 / rod.volume())
        return rod.scale((widen, 1.0, widen))
    return Manifold.cube((1.0, 1.0, 1.0), True)
