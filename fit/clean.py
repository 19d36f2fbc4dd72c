"""Meshes mended by MeshLab: closed where nothing else closes them.

pymeshlab is the extra `repair`, for it is GPL-3. It is loaded by the first call and not before: it brings a
user interface's libraries along. Its thresholds are lengths, so every mesh is centred and scaled to a
diagonal of one first.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fit.bvh import column_extremes
from fit.scene import Float64

Int64 = NDArray[np.int64]

WELD = 1e-6
"""Of the diagonal: corners nearer than this are one."""

ALPHA, OFFSET = 0.02, 0.001
"""Of the diagonal: the wrap's ball passes no opening narrower than twice the first, the second is its skin.

Measured on seven open bodies: volumes within 3 % of the closed ones at 0.4 to 5 s; an alpha of 0.01 takes
three times as long for under 1 %, an offset of 0.005 inflates the volume by 7 to 10 %."""

MOST_HOLE_EDGES = 1000


class NoMeshLab(ImportError):
    """pymeshlab, or a library of the system that it needs, is missing; the message says how to get it."""


def close_holes(vertices: Float64) -> Float64:
    """Triangles (t, 3, 3) with flat lids over their holes; what isn't a sheet with edges stays open.

    Raises:
        NoMeshLab: pymeshlab can't be loaded.
    """

    def close(meshes: Any) -> None:
        _tidy(meshes)
        meshes.meshing_repair_non_manifold_edges()
        meshes.meshing_repair_non_manifold_vertices()
        meshes.meshing_re_orient_faces_coherently()
        meshes.meshing_close_holes(maxholesize=MOST_HOLE_EDGES, newfaceselected=False)

    return _processed(vertices, close)


def wrap(vertices: Float64, alpha: float = ALPHA, offset: float = OFFSET) -> Float64:
    """A closed surface (t, 3, 3) around any triangles, `offset` of the diagonal off (Portaneri et al. 2022).

    A ball of radius `alpha` of the diagonal rolls over it: it bridges small openings and enters large ones.

    Raises:
        NoMeshLab: pymeshlab can't be loaded.
    """
    meshlab = load_meshlab()
    return _processed(
        vertices,
        lambda meshes: meshes.generate_alpha_wrap(
            alpha=meshlab.PercentageValue(100 * alpha), offset=meshlab.PercentageValue(100 * offset)
        ),
    )


def load_meshlab() -> ModuleType:
    """The module pymeshlab.

    Raises:
        NoMeshLab: it can't be loaded.
    """
    try:
        import pymeshlab
    except ModuleNotFoundError as error:
        raise NoMeshLab("pymeshlab is not installed: pip install 'sdfprim[repair]'") from error
    except ImportError as error:
        raise NoMeshLab(
            f"pymeshlab can't be loaded ({error}); on Debian or Ubuntu it needs the packages libgl1 and "
            "libopengl0: apt-get install libgl1 libopengl0"
        ) from error
    return pymeshlab


def _tidy(meshes: Any) -> None:
    meshes.meshing_remove_duplicate_faces()
    meshes.meshing_remove_null_faces()
    meshes.meshing_remove_unreferenced_vertices()


def _processed(vertices: Float64, filters: Any) -> Float64:
    """Triangles (t, 3, 3) after the filters, which see them about the origin with a diagonal of one."""
    if len(vertices) == 0:
        return vertices
    meshlab = load_meshlab()
    lower, upper = column_extremes(vertices.reshape(-1, 3))
    center, scale = (lower + upper) / 2, max(float(np.linalg.norm(upper - lower)), np.finfo(float).tiny)
    points, triangles = _welded((vertices.reshape(-1, 3) - center) / scale)
    if len(triangles) == 0:
        return vertices[:0]
    meshes = meshlab.MeshSet(verbose=False)
    meshes.add_mesh(meshlab.Mesh(points, triangles))
    filters(meshes)
    mesh = meshes.current_mesh()
    return center + scale * mesh.vertex_matrix()[mesh.face_matrix()]


def _welded(corners: Float64) -> tuple[Float64, Int64]:
    """Distinct points (n, 3) and triangles (t, 3) of corners (3 t, 3). MeshLab's own filter misses a few."""
    near = cKDTree(corners).query_pairs(WELD, output_type="ndarray")
    cluster = trimesh.graph.connected_component_labels(near, node_count=len(corners))
    first = np.unique(cluster, return_index=True)[1]
    triangles = cluster.reshape(-1, 3).astype(np.int64)
    a, b, c = triangles.T
    return corners[first], triangles[(a != b) & (b != c) & (c != a)]
