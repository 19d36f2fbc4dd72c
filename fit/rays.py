"""First hits of rays on triangles: Embree where it is installed, the triangle tree elsewhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fit.bvh import TriangleTree
from fit.scene import Float64

try:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene
except ImportError:  # no wheel for this platform
    EmbreeScene = None

_TRIANGLES_AT_ONCE = 1 << 16


class RayCaster:
    """Casts rays at the triangles (t, 3, 3) that `tree` was built from.

    Embree works in float32: the triangles are centred and scaled to a diagonal of one, so a hit is good to
    about 1e-7 of the diagonal at any scale and far from the origin.
    """

    def __init__(self, vertices: Float64, tree: TriangleTree, *, use_embree: bool = True) -> None:
        self._tree = tree
        self._embree = None
        if use_embree and EmbreeScene is not None:
            self._embree = EmbreeScene(robust=True)
            unit = np.empty(vertices.shape, np.float32)
            for start in range(0, len(vertices), _TRIANGLES_AT_ONCE):  # no float64 copy of millions
                part = slice(start, start + _TRIANGLES_AT_ONCE)
                unit[part] = (vertices[part] - tree.center) / tree.diagonal
            TriangleMesh(self._embree, unit)

    def first_hit(self, origins: Float64, directions: Float64) -> tuple[Float64, NDArray[np.int64]]:
        """Distance (p,) along unit directions (p, 3) to the first triangle, and its row; inf and -1: none."""
        if self._embree is None or len(origins) == 0:
            return self._tree.first_hit(origins, directions)
        hit = self._embree.run(
            ((origins - self._tree.center) / self._tree.diagonal).astype(np.float32),
            np.ascontiguousarray(directions, dtype=np.float32),
            output=True,
        )
        triangle = hit["primID"].astype(np.int64)
        distance = hit["tfar"].astype(np.float64) * self._tree.diagonal
        distance[triangle < 0] = np.inf
        return distance, triangle

    def visible(self, start: Float64, end: Float64) -> NDArray[np.bool_]:
        """Whether the open segment from start (p, 3) to end (p, 3) meets no triangle."""
        step = end - start
        length = np.linalg.norm(step, axis=1)
        distance, _ = self.first_hit(start, step / np.maximum(length, np.finfo(float).tiny)[:, None])
        return distance >= length
