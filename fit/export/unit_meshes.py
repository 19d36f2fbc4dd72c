"""Triangle meshes of unit size that show the primitives: scaled by a primitive's sizes, each fits it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit import sdf

HALF_SPACE = "half_space"
"""What files call a plane without end; the other kinds go by `Kind`'s names in lower case."""

SPHERE_SEGMENTS, SPHERE_RINGS = 32, 16
CYLINDER_SEGMENTS = 32


Part = tuple[NDArray[np.float64], NDArray[np.float64], list[tuple[int, int, int]]]
"""Positions, normals and triangles of one face."""

_NOTHING: Part = (np.zeros((0, 3)), np.zeros((0, 3)), [])


@dataclass(frozen=True)
class UnitMesh:
    """A closed mesh in the cube from -0.5 to 0.5, triangles sorted by face.

    positions, normals (v, 3) float32; triangles (t, 3) uint16, counter-clockwise from outside;
    starts (7,): the triangles of face f of `FACES` are those from starts[f] up to starts[f + 1].
    """

    name: str
    positions: NDArray[np.float32]
    normals: NDArray[np.float32]
    triangles: NDArray[np.uint16]
    starts: tuple[int, ...]


def unit_box() -> UnitMesh:
    """Six faces of four corners each; planes are shown by it too."""
    faces = [_square(face) for face in range(6)]
    return _joined("box", [(corners, normals, [(0, 1, 2), (0, 2, 3)]) for corners, normals in faces])


def unit_quad() -> UnitMesh:
    """The square y = 0 that stands for a half-space; only +y has triangles."""
    corners, normals = _square(2)
    corners = corners * (1, 0, 1)
    square: Part = (corners, normals, [(0, 1, 2), (0, 2, 3)])
    return _joined("quad", [_NOTHING, _NOTHING, square, _NOTHING, _NOTHING, _NOTHING])


def unit_sphere(segments: int = SPHERE_SEGMENTS, rings: int = SPHERE_RINGS) -> UnitMesh:
    """Diameter 1, by latitude and longitude; vertices at the poles and on every axis. All is face +x."""
    polar = np.linspace(0, np.pi, rings + 1)[:, None]
    around = np.linspace(0, 2 * np.pi, segments + 1)[None, :]
    sin, cos = np.sin(polar), np.cos(polar)
    grid = np.stack(np.broadcast_arrays(sin * np.cos(around), cos, -sin * np.sin(around)), axis=-1)
    normals = _without_dust(grid.reshape(-1, 3))
    triangles = []
    row = segments + 1
    for ring in range(rings):
        for segment in range(segments):
            a = ring * row + segment
            if ring > 0:
                triangles.append((a, a + row, a + 1))
            if ring < rings - 1:
                triangles.append((a + 1, a + row, a + row + 1))
    return _joined("sphere", [(normals / 2, normals, triangles)] + [_NOTHING] * 5)


def unit_cylinder(segments: int = CYLINDER_SEGMENTS) -> UnitMesh:
    """Diameter and height 1 along Y. The side is face +x, the caps are +y and -y."""
    angle = np.linspace(0, 2 * np.pi, segments + 1)
    ring = _without_dust(np.stack([np.cos(angle), np.zeros_like(angle), -np.sin(angle)], axis=-1))
    up = np.array([0, 0.5, 0])
    low, high = ring / 2 - up, ring / 2 + up
    count = segments
    side = [t for i in range(count) for t in ((i, i + 1, i + count + 2), (i, i + count + 2, i + count + 1))]
    fan = [(0, i, i + 1) for i in range(1, count - 1)]
    flipped = [(a, c, b) for a, b, c in fan]
    return _joined(
        "cylinder",
        [
            (np.concatenate([low, high]), np.concatenate([ring, ring]), side),
            _NOTHING,
            (high[:-1], np.tile([0.0, 1, 0], (count, 1)), fan),
            (low[:-1], np.tile([0.0, -1, 0], (count, 1)), flipped),
            _NOTHING,
            _NOTHING,
        ],
    )


def _joined(name: str, faces: list[Part]) -> UnitMesh:
    positions, normals, triangles, starts, offset = [], [], [], [0], 0
    for corners, directions, corner_triples in faces:
        positions.append(corners)
        normals.append(directions)
        triangles.append(np.array(corner_triples, np.int64).reshape(-1, 3) + offset)
        offset += len(corners)
        starts.append(starts[-1] + len(corner_triples))
    return UnitMesh(
        name=name,
        positions=np.concatenate(positions).astype(np.float32),
        normals=np.concatenate(normals).astype(np.float32),
        triangles=np.concatenate(triangles).astype(np.uint16),
        starts=tuple(starts),
    )


def _square(face: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corners (4, 3) of a face of the unit cube, counter-clockwise from outside, and their normals."""
    axis, sign = face // 2, 1.0 if face % 2 == 0 else -1.0
    corners = np.empty((4, 3))
    corners[:, axis] = 0.5 * sign
    corners[:, (axis + 1) % 3] = np.array([-0.5, 0.5, 0.5, -0.5])
    corners[:, (axis + 2) % 3] = np.array([-0.5, -0.5, 0.5, 0.5]) * sign
    normals = np.zeros((4, 3))
    normals[:, axis] = sign
    return corners, normals


def _without_dust(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sines that miss zero by rounding set to zero, so that extents and normals are exact."""
    return np.where(np.abs(vectors) < 1e-12, 0.0, vectors)


def misfit(kind: str, points: NDArray[np.float64]) -> float:
    """How far points (p, 3) lie off the boundary of a kind's unit shape, at most; its size is 1."""
    if kind == HALF_SPACE:
        return float(np.abs(points[:, 1]).max())
    half = np.full(3, 0.5)
    distance = {
        "sphere": lambda: sdf.sd_sphere(points, 0.5),
        "cylinder": lambda: sdf.sd_cylinder(points, 0.5, 0.5),
    }.get(kind, lambda: sdf.sd_box(points, half))()
    return float(np.abs(distance).max())


UNIT_MESHES = {
    "box": unit_box(),
    "plane": unit_box(),
    "sphere": unit_sphere(),
    "cylinder": unit_cylinder(),
    HALF_SPACE: unit_quad(),
}
"""By kind; a plane is shown by the box's."""
