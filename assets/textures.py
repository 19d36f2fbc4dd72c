"""The bundled scenes' textures: square arrays of palette rows, and the palettes.

Everything is computed in integers or in exactly rounded divisions, so that every machine gets the same bytes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SHADES = 24
"""Rows of each half of a palette: the light ramp comes first, the dark one after it."""


def checker(pixels: int = 128) -> NDArray[np.uint8]:
    """Two light and two dark tiles with a grain and a thin joint between them."""
    v, u = np.mgrid[0:pixels, 0:pixels] / pixels
    dark = (np.floor(2 * u) + np.floor(2 * v)) % 2
    joint = np.minimum(_to_joint(2 * u), _to_joint(2 * v)) < 2.0 / pixels
    level = np.where(joint, 0.0, 0.35 + 0.65 * _grain(pixels, seed=1))
    return _shades(level, dark > 0)


def masonry(pixels: int = 128) -> NDArray[np.uint8]:
    """Four courses of two stone blocks, each second one shifted by half a block; joints are dark."""
    v, u = np.mgrid[0:pixels, 0:pixels] / pixels
    row = np.floor(4 * v).astype(int)
    along = 2 * u + 0.5 * (row % 2)
    joint = (_to_joint(4 * v) < 3.0 / pixels) | (_to_joint(along) < 1.5 / pixels)
    tone = np.random.default_rng(7).integers(0, 1000, (4, 2)) / 1000
    block = tone[row, np.floor(along).astype(int) % 2]
    return _shades(0.15 + 0.35 * block + 0.5 * _grain(pixels, seed=2), joint)


def ramp(low: tuple[int, ...], high: tuple[int, ...], dark: tuple[int, ...]) -> NDArray[np.int64]:
    """`SHADES` colours from low to high, then as many round `dark`; sRGB, 0 to 255."""
    share = np.arange(SHADES)[:, None]
    light = np.array(low) + (np.array(high) - np.array(low)) * share // (SHADES - 1)
    return np.concatenate([light, np.array(dark) * (80 + 40 * share // (SHADES - 1)) // 100])


def _shades(level: NDArray[np.float64], dark: NDArray[np.bool_]) -> NDArray[np.uint8]:
    return (np.minimum(level * SHADES, SHADES - 1).astype(np.uint8) + SHADES * dark).astype(np.uint8)


def _to_joint(coordinate: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance to the nearest whole number."""
    return np.minimum(coordinate % 1, 1 - coordinate % 1)


def _grain(pixels: int, seed: int) -> NDArray[np.float64]:
    """Tiling value noise of three octaves, 0 to 1."""
    rng = np.random.default_rng(seed)
    total = np.zeros((pixels, pixels), dtype=np.int64)
    for cells, weight in ((8, 4), (16, 2), (64, 1)):
        lattice = rng.integers(0, 256, (cells, cells))
        step = pixels // cells
        left, inside = np.arange(pixels) // step, np.arange(pixels) % step
        right = (left + 1) % cells
        rows = lattice[left] * (step - inside)[:, None] + lattice[right] * inside[:, None]
        total += weight * ((rows[:, left] * (step - inside) + rows[:, right] * inside) // step**2)
    return total / (7 * 255)
