"""Twin of shaders/lib/octahedral.wgsl: octahedral maps of the sphere (Cigolle et al. 2014)."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
UInt32 = NDArray[np.uint32]


def _fold(p: Array) -> Array:
    return (1 - np.abs(p[:, ::-1])) * np.where(p >= 0, 1, -1)


def oct_encode(direction: Array) -> Array:
    """Points (n, 2) of the square [-1, 1]^2 for directions (n, 3) of any length but 0."""
    p = direction[:, :2] / np.abs(direction).sum(axis=1, keepdims=True)
    return np.where(direction[:, 2:] >= 0, p, _fold(p))


def oct_decode(square: Array) -> Array:
    """Unit directions (n, 3) for points (n, 2) of the square [-1, 1]^2."""
    z = 1 - np.abs(square).sum(axis=1, keepdims=True)
    v = np.concatenate([np.where(z >= 0, square, _fold(square)), z], axis=1)
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def oct_texel_direction(texel: UInt32, size: UInt32) -> Array:
    """Unit directions (n, 3) of the centres of texels (n, 2) in [0, size) of maps of `size` (n,)."""
    return oct_decode((texel + 0.5) * (2 / size)[:, None] - 1)


def oct_tile_source(texel: UInt32, size: UInt32) -> UInt32:
    """The texel of the map (n, 2) that a texel of the tile, in [0, size + 2), shows."""
    last = size.astype(np.int64) - 1
    x, y = texel.astype(np.int64).T - 1
    over = (x < 0) | (x > last)
    x, y = np.where(over, np.clip(x, 0, last), x), np.where(over, last - y, y)
    over = (y < 0) | (y > last)
    x, y = np.where(over, last - x, x), np.where(over, np.clip(y, 0, last), y)
    return np.stack([x, y], axis=1).astype(np.uint32)


def oct_tile_corner(index: UInt32, columns: UInt32, size: UInt32) -> UInt32:
    """First texel (n, 2) of tile `index` (n,) in an atlas of `columns` (n,) tiles a row."""
    return (size + 2)[:, None] * np.stack([index % columns, index // columns], axis=1)


def oct_tile_position(corner: UInt32, direction: Array, size: UInt32) -> Array:
    """Position in texels (n, 2), for filtering, of directions (n, 3) in the tiles beginning at `corner`."""
    return corner + 1 + (oct_encode(direction) * 0.5 + 0.5) * size[:, None]
