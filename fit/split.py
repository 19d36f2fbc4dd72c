"""Parts of a scene: what each node draws, cut into connected pieces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fit.scene import Float64, Mesh, Scene
from fit.surface import Surface

Int64 = NDArray[np.int64]

MOST_PIECES = 64
"""Of one mesh: a mesh in more pieces (leaves, bolts) keeps its largest, and the rest stays one part."""

_WELD_BITS = 20
"""Vertices nearer than 2^-20 of the mesh's size are one, however the file's seams have split them."""

_TRIANGLES_AT_ONCE = 1 << 16


@dataclass(frozen=True)
class Parts:
    """of_triangle (t,): the part of each row of the surface; names and instance of each part."""

    of_triangle: Int64
    names: tuple[str, ...]
    instance: Int64

    def __len__(self) -> int:
        return len(self.names)


def split(scene: Scene, surface: Surface) -> Parts:
    """The parts of the whole scene. Pieces are found once for each mesh, however often it is drawn."""
    pieces = [mesh_pieces(mesh) for mesh in scene.meshes]
    first_triangle = np.cumsum([0, *(len(p) for p in pieces)])
    piece_of_triangle = np.concatenate([*pieces, np.zeros(0, np.int64)])
    counts = [int(p.max()) + 1 if len(p) else 0 for p in pieces]
    of_instance = [counts[i.mesh] for i in scene.instances]
    first_part = np.cumsum([0, *of_instance])
    of_triangle = (
        first_part[surface.instance] + piece_of_triangle[first_triangle[surface.mesh] + surface.triangle]
    )
    names = []
    for instance, count in zip(scene.instances, of_instance, strict=True):
        node = scene.nodes[instance.node].name if 0 <= instance.node < len(scene.nodes) else ""
        base = node or scene.meshes[instance.mesh].name or f"mesh_{instance.mesh}"
        names += [base if count == 1 else f"{base}[{k}]" for k in range(count)]
    instances = np.repeat(np.arange(len(scene.instances)), of_instance)
    return Parts(of_triangle.astype(np.int64), tuple(names), instances.astype(np.int64))


def mesh_pieces(mesh: Mesh) -> Int64:
    """The connected piece (m,) of each triangle, the largest by area first; at most `MOST_PIECES`."""
    if len(mesh.triangles) == 0:
        return np.zeros(0, np.int64)
    piece = _connected(_welded(mesh.positions)[mesh.triangles])
    area = np.bincount(piece, weights=_double_areas(mesh))
    rank = np.empty(len(area), np.int64)
    rank[np.argsort(-area, kind="stable")] = np.arange(len(area))
    return np.minimum(rank, MOST_PIECES - 1)[piece]


def _connected(vertices: NDArray[np.int32]) -> Int64:
    """The component (m,) of each triangle (m, 3)."""
    count = int(vertices.max()) + 1
    ends = vertices[:, :2].ravel(), vertices[:, 1:].ravel()
    links = coo_array((np.ones(len(ends[0]), bool), ends), shape=(count, count))
    return connected_components(links, directed=False)[1][vertices[:, 0]].astype(np.int64)


def _double_areas(mesh: Mesh) -> Float64:
    """Twice the area (m,) of each triangle; of millions, some at a time."""
    areas = np.empty(len(mesh.triangles))
    for start in range(0, len(areas), _TRIANGLES_AT_ONCE):
        part = slice(start, start + _TRIANGLES_AT_ONCE)
        a, b, c = (mesh.positions[mesh.triangles[part, k]] for k in range(3))
        areas[part] = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return areas


def _welded(positions: Float64) -> NDArray[np.int32]:
    """One number for each vertex (n,), equal where positions are."""
    lower = positions.min(axis=0)
    size = float((positions.max(axis=0) - lower).max())
    if not size > 0:
        return np.zeros(len(positions), np.int32)
    steps = np.rint((positions - lower) * ((1 << _WELD_BITS) / size)).astype(np.int64)
    keys = (steps[:, 0] << 42) | (steps[:, 1] << 21) | steps[:, 2]
    return np.unique(keys, return_inverse=True)[1].astype(np.int32)
