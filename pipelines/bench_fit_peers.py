"""Convex decompositions that pip installs, as primitive sets: what `bench fit --peers` compares with.

V-HACD (Mamou 2016, `vhacdx`) and CoACD (Wei et al. 2022, `coacd`) cut a mesh into convex hulls. A hull
becomes its smallest box, or the primitive that shares most of its volume. Both libraries hang or abort on
meshes that real scenes hold, so `hulls` belongs into a process of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import util
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fit.recognize import Piece, box_around, closed_forms, normal_frame
from fit.scene import Float64
from fit.shapes import Shapes, distances_to_one, join
from fit.surface import Surface, from_triangles
from pipelines.errors import UsageError

Peer = Literal["vhacd", "coacd"]
Variant = Literal["boxes", "best primitives"]

PACKAGES: dict[Peer, str] = {"vhacd": "vhacdx", "coacd": "coacd"}
VARIANTS: tuple[Variant, ...] = ("boxes", "best primitives")

_VOLUME_SAMPLES = 4096
_MARGIN = 0.1
"""Of a hull's size: how far around it points are drawn, so that a primitive which sticks out is found out."""


def require_peers() -> None:
    """Raises UsageError with the remedy when a peer is not installed."""
    missing = [package for package in PACKAGES.values() if util.find_spec(package) is None]
    if missing:
        raise UsageError(f"--peers: {' and '.join(missing)} not installed; pip install 'sdfprim[peers]'")


def hulls(peer: Peer, walls: Surface, count: int, seed: int) -> list[Piece]:
    """At most `count` convex hulls of the walls, by the peer's own defaults.

    Raises:
        ValueError: the peer found none.
    """
    vertices, faces = _welded(walls.vertices)
    pairs = _DECOMPOSE[peer](vertices, faces, count, seed)
    surfaces = [from_triangles(np.asarray(v, np.float64)[np.asarray(f, np.int64)]) for v, f in pairs]
    pieces = [Piece(s.vertices, s.normals, s.areas) for s in surfaces if len(s)]
    if not pieces:
        raise ValueError(f"{peer} returned no hull")
    return pieces


def to_shapes(pieces: Sequence[Piece], variant: Variant) -> Shapes:
    """One shape for each hull."""
    return join([smallest_box(piece) if variant == "boxes" else best_primitive(piece) for piece in pieces])


def smallest_box(hull: Piece) -> Shapes:
    """The smaller one of the boxes in the world's axes and along the heaviest faces."""
    boxes = [box_around(hull.vertices, frame) for frame in (np.eye(3), normal_frame(hull))]
    return min(boxes, key=lambda box: float(box.volumes()[0]))


def best_primitive(hull: Piece) -> Shapes:
    """The closed form that has the largest intersection over union with the hull, by sampling."""
    candidates = join([smallest_box(hull), closed_forms(hull)])
    lower, upper = hull.vertices.min(axis=0), hull.vertices.max(axis=0)
    margin = _MARGIN * (upper - lower).max()
    points = np.random.default_rng(0).uniform(lower - margin, upper + margin, (_VOLUME_SAMPLES, 3))
    within = _inside(hull, points)
    overlaps = [
        _overlap(distances_to_one(candidates, i, points) <= 0, within) for i in range(len(candidates))
    ]
    return candidates.select(np.array([int(np.argmax(overlaps))]))


def _inside(hull: Piece, points: Float64) -> NDArray[np.bool_]:
    """Which points lie behind every face; the hulls' faces look outward."""
    heights = hull.normals @ points.T - np.einsum("tk,tk->t", hull.normals, hull.corners[:, 0])[:, None]
    return np.asarray(heights.max(axis=0) <= 0)


def _overlap(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    return float((first & second).sum() / max((first | second).sum(), 1))


Pairs = list[tuple[NDArray[np.generic], NDArray[np.generic]]]


def _vhacd(vertices: Float64, faces: NDArray[np.uint32], count: int, seed: int) -> Pairs:
    import vhacdx

    # It reads a flat list in which each face's number of corners comes first, and mistakes anything else.
    packed = np.column_stack([np.full(len(faces), 3, np.uint32), faces]).ravel()
    return list(vhacdx.compute_vhacd(vertices, packed, maxConvexHulls=count))


def _coacd(vertices: Float64, faces: NDArray[np.uint32], count: int, seed: int) -> Pairs:
    import coacd

    coacd.set_log_level("error")
    return list(coacd.run_coacd(coacd.Mesh(vertices, faces), max_convex_hull=count, seed=seed))


_DECOMPOSE = {"vhacd": _vhacd, "coacd": _coacd}


def _welded(corners: Float64) -> tuple[Float64, NDArray[np.uint32]]:
    """Vertices (v, 3) without duplicates, and faces (t, 3) that share them, of a soup (t, 3, 3)."""
    vertices, rows = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return vertices, rows.reshape(-1, 3).astype(np.uint32)
