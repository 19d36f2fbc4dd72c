"""Twin of shaders/lib/sky.wgsl. A `picture` is one level of the sky's pyramid, (height, width, 3)."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def sky_uv(direction: Array) -> Array:
    """Equirectangular coordinates (n, 2) of unit directions (n, 3): u = atan2(x, -z) / 2 pi mod 1, v =
    acos(y) / pi."""
    turns = np.arctan2(direction[:, 0], -direction[:, 2]) / (2 * np.pi)
    return np.stack([turns - np.floor(turns), np.arccos(np.clip(direction[:, 1], -1, 1)) / np.pi], axis=1)


def sky_gradient(base: Array, slope: Array, axis: Array, direction: Array) -> Array:
    """base + slope (axis . direction), (n, 3), never negative."""
    return np.maximum(base + slope * (axis * direction).sum(axis=1, keepdims=True), 0)


def sky_level(solid_angle: Array, size: Array) -> Array:
    """Level (n,) of the pyramid over a picture of `size` (n, 2) whose texels at the horizon cover the solid
    angle."""
    texel = 2 * np.pi**2 / (size[:, 0] * size[:, 1])
    return np.maximum(0.5 * np.log2(np.maximum(solid_angle, 1e-12) / texel), 0)


def sky_texel_blend(uv: Array, picture: Array) -> Array:
    """Bilinear lookup (n, 3); columns wrap, rows clamp."""
    height, width = picture.shape[:2]
    place = uv * [width, height] - 0.5
    corner = np.floor(place).astype(np.int64)
    across, down = np.moveaxis((place - corner)[:, :, None], 1, 0)
    columns = (corner[:, 0] % width, (corner[:, 0] + 1) % width)
    rows = (np.clip(corner[:, 1], 0, height - 1), np.clip(corner[:, 1] + 1, 0, height - 1))
    upper, lower = (
        picture[row, columns[0]] * (1 - across) + picture[row, columns[1]] * across for row in rows
    )
    return upper * (1 - down) + lower * down
