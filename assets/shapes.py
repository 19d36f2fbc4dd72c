"""Triangle shapes for the bundled scenes. Metres, Y up, counter-clockwise seen from outside.

A `Shape` is positions (n, 3), unit normals (n, 3), texture coordinates (n, 2) in metres along the surface,
and triangles (m, 3). Shapes are joined with `+`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Shape:
    positions: Array
    normals: Array
    texcoords: Array
    triangles: NDArray[np.int64]

    def __add__(self, other: Shape) -> Shape:
        return Shape(
            np.concatenate([self.positions, other.positions]),
            np.concatenate([self.normals, other.normals]),
            np.concatenate([self.texcoords, other.texcoords]),
            np.concatenate([self.triangles, other.triangles + len(self.positions)]),
        )

    def moved(self, offset: ArrayLike) -> Shape:
        return Shape(self.positions + np.asarray(offset, float), self.normals, self.texcoords, self.triangles)

    def turned(self, degrees: float) -> Shape:
        """Rotated about +Y."""
        angle = np.radians(degrees)
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        return Shape(self.positions @ turn.T, self.normals @ turn.T, self.texcoords, self.triangles)


def join(*shapes: Shape) -> Shape:
    """All shapes in one."""
    total = shapes[0]
    for shape in shapes[1:]:
        total += shape
    return total


def quad(corner: ArrayLike, along: ArrayLike, up: ArrayLike) -> Shape:
    """Parallelogram from `corner`, spanned by two edges; it faces along x up."""
    corner, along, up = (np.asarray(v, float) for v in (corner, along, up))
    normal = np.cross(along, up)
    width, height = np.linalg.norm(along), np.linalg.norm(up)
    return Shape(
        np.array([corner, corner + along, corner + along + up, corner + up]),
        np.tile(normal / np.linalg.norm(normal), (4, 1)),
        np.array([[0, height], [width, height], [width, 0], [0, 0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )


def box(lower: ArrayLike, upper: ArrayLike) -> Shape:
    """Axis-aligned box between two corners."""
    (x0, y0, z0), (x1, y1, z1) = np.asarray(lower, float), np.asarray(upper, float)
    w, h, d = x1 - x0, y1 - y0, z1 - z0
    return join(
        quad((x1, y0, z1), (0, 0, -d), (0, h, 0)),
        quad((x0, y0, z0), (0, 0, d), (0, h, 0)),
        quad((x0, y1, z1), (w, 0, 0), (0, 0, -d)),
        quad((x0, y0, z0), (w, 0, 0), (0, 0, d)),
        quad((x0, y0, z1), (w, 0, 0), (0, h, 0)),
        quad((x1, y0, z0), (-w, 0, 0), (0, h, 0)),
    )


def box_at(center: ArrayLike, size: ArrayLike) -> Shape:
    """Axis-aligned box by its centre and full extents."""
    center, size = np.asarray(center, float), np.asarray(size, float)
    return box(center - size / 2, center + size / 2)


def grid(positions: Array, normals: Array, texcoords: Array) -> Shape:
    """A (rows, columns, 3) patch of vertices as a strip of quads; it faces rows x columns."""
    rows, columns = positions.shape[:2]
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    triangles = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    return Shape(positions.reshape(-1, 3), normals.reshape(-1, 3), texcoords.reshape(-1, 2), triangles)


def sphere(center: ArrayLike, radius: float, segments: int = 32) -> Shape:
    """UV sphere with `segments` round the equator and half as many from pole to pole."""
    polar = np.linspace(0, np.pi, segments // 2 + 1)[:, None]
    turn = np.linspace(0, 2 * np.pi, segments + 1)[None, :]
    normals = np.stack(
        [np.sin(polar) * np.cos(turn), np.cos(polar) + 0 * turn, np.sin(polar) * -np.sin(turn)], axis=-1
    )
    texcoords = np.stack([radius * turn + 0 * polar, radius * polar + 0 * turn], axis=-1)
    shape = grid(radius * normals, normals, texcoords).moved(center)
    a, b, c = (shape.positions[shape.triangles[:, i]] for i in range(3))
    real = np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-9 * radius**2  # the poles' quads are triangles
    return Shape(shape.positions, shape.normals, shape.texcoords, shape.triangles[real])


def cylinder(foot: ArrayLike, radius: float, height: float, segments: int = 28) -> Shape:
    """Upright capped cylinder standing on `foot`."""
    turn = np.linspace(0, 2 * np.pi, segments + 1)
    around = np.stack([np.cos(turn), 0 * turn, -np.sin(turn)], axis=-1)
    rows = np.array([height, 0.0])
    side = grid(
        radius * around[None] + rows[:, None, None] * np.array([0.0, 1.0, 0.0]),
        np.tile(around, (2, 1, 1)),
        np.stack(np.broadcast_arrays(radius * turn[None], height - rows[:, None]), axis=-1),
    )
    return join(side, _disc(radius, height, segments, 1), _disc(radius, 0.0, segments, -1)).moved(foot)


def _disc(radius: float, height: float, segments: int, facing: int) -> Shape:
    turn = np.arange(segments) * (2 * np.pi / segments)
    rim = radius * np.stack([np.cos(turn), 0 * turn, -np.sin(turn)], axis=-1)
    positions = np.concatenate([np.zeros((1, 3)), rim]) + np.array([0.0, height, 0.0])
    first = np.arange(segments) + 1
    after = np.roll(first, -1)
    pair = (first, after) if facing > 0 else (after, first)
    triangles = np.stack([np.zeros(segments, dtype=np.int64), *pair], axis=-1)
    normals = np.tile([0.0, float(facing), 0.0], (segments + 1, 1))
    return Shape(positions, normals, positions[:, [0, 2]], triangles)


def arch(width: float, radius: float, height: float, thickness: float, segments: int = 18) -> Shape:
    """Wall with a half-round opening, centred on x = z = 0, from y = 0 (the springing line) to `height`."""
    angle = np.linspace(np.pi, 0, segments + 1)
    curve = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    half = thickness / 2
    sides = []
    for z, facing in ((half, 1), (-half, -1)):
        lower = np.concatenate([curve, np.full((segments + 1, 1), z)], axis=1)
        upper = lower * [1, 0, 1] + [0, height, 0]
        rows = np.stack([upper, lower] if facing > 0 else [lower, upper])
        sides.append(grid(rows, np.tile([0.0, 0.0, facing], (*rows.shape[:2], 1)), rows[..., :2] * [1, -1]))
    front = np.concatenate([curve, np.full((segments + 1, 1), half)], axis=1)
    inward = -np.concatenate([curve / radius, np.zeros((segments + 1, 1))], axis=1)
    along = radius * (np.pi - angle)
    under = grid(
        np.stack([front, front * [1, 1, -1]]),
        np.stack([inward, inward]),
        np.stack([np.stack([along, 0 * along], -1), np.stack([along, 0 * along + thickness], -1)]),
    )
    pier = (width / 2 - radius, height, thickness)
    offset = (width / 2 + radius) / 2
    left, right = (box_at((x, height / 2, 0), pier) for x in (-offset, offset))
    top = quad((-radius, height, half), (2 * radius, 0, 0), (0, 0, -thickness))
    return join(*sides, under, left, right, top)


def curtain(width: float, height: float, folds: int, depth: float) -> Shape:
    """A sheet that hangs in the plane z = 0 from y = 0, centred on x = 0; its folds deepen downward."""
    across = np.linspace(-0.5, 0.5, 8 * folds + 1)[None, :]
    down = np.linspace(0, 1, 9)[:, None]
    swell = depth * (0.35 + 0.65 * down)
    phase = 2 * np.pi * folds * across
    narrowed = width * across * (1 - 0.06 * np.sin(np.pi * down))
    positions = np.stack([narrowed, -height * down + 0 * across, swell * np.sin(phase)], -1)
    slope = swell * np.cos(phase) * (2 * np.pi * folds / width)
    normals = np.stack([-slope, 0 * slope, 0 * slope + 1], -1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    texcoords = np.stack(np.broadcast_arrays(width * across, height * down), -1)
    return grid(positions, normals, texcoords)
