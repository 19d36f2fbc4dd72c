"""Twin of shaders/lib/octahedral.wgsl: octahedral maps of the sphere (Cigolle et al. 2014)."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
UInt32 = NDArray[np.uint32]

OCT_SIZE = 8
"""Texels of a stored map along a side."""

OCT_TILE = OCT_SIZE + 2
"""The same with the border of one texel that bilinear filtering needs."""


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


def oct_texel_direction(texel: UInt32) -> Array:
    """Unit directions (n, 3) of the centres of texels (n, 2) in [0, OCT_SIZE)."""
    return oct_decode((texel + 0.5) * (2 / OCT_SIZE) - 1)


def oct_tile_source(texel: UInt32) -> UInt32:
    """The texel of the map (n, 2) that a texel of the tile, in [0, OCT_TILE), shows."""
    last = OCT_SIZE - 1
    p = texel.astype(np.int64) - 1
    over_x = (p[:, 0] < 0) | (p[:, 0] > last)
    p[over_x] = np.stack([np.clip(p[over_x, 0], 0, last), last - p[over_x, 1]], axis=1)
    over_y = (p[:, 1] < 0) | (p[:, 1] > last)
    p[over_y] = np.stack([last - p[over_y, 0], np.clip(p[over_y, 1], 0, last)], axis=1)
    return p.astype(np.uint32)


def oct_tile_corner(index: UInt32, columns: UInt32) -> UInt32:
    """First texel (n, 2) of tile `index` (n,) in an atlas of `columns` (n,) tiles a row."""
    return OCT_TILE * np.stack([index % columns, index // columns], axis=1)


def oct_tile_position(corner: UInt32, direction: Array) -> Array:
    """Position in texels (n, 2), for filtering, of directions (n, 3) in the tiles beginning at `corner`."""
    return corner + 1 + (oct_encode(direction) * 0.5 + 0.5) * OCT_SIZE
