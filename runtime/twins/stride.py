"""Twin of shaders/lib/stride.wgsl: how far sphere tracing dares to go. Columns (n,) in, a column (n,) out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
UInt32 = NDArray[np.uint32]

STRIDE_PLAIN, STRIDE_RELAXED, STRIDE_ENHANCED, STRIDE_AUTO = range(4)
STRIDE_RELAXATION = 1.2
STRIDE_TRUST = 0.9
STRIDE_MEAN_WEIGHT = 0.3
STRIDE_STEEPEST = 0.5
STRIDE_HEAD_ON = -1.0


def stride_first_slope(method: UInt32) -> Array:
    """The slope that a ray starts with."""
    return np.where(method == STRIDE_RELAXED, 0.0, STRIDE_HEAD_ON)


def stride_next_slope(method: UInt32, slope: Array, measured: Array) -> Array:
    """The slope to go by after a stride along which the distance had the slope `measured`."""
    seen = np.clip(measured, STRIDE_HEAD_ON, STRIDE_STEEPEST)
    mean = slope + STRIDE_MEAN_WEIGHT * (seen - slope)
    return np.where(method == STRIDE_RELAXED, slope, np.where(method == STRIDE_AUTO, mean, seen))


def stride_length(method: UInt32, radius: Array, slope: Array) -> Array:
    """Metres to go from a point around which a ball of `radius` is free."""
    is_plain = (method == STRIDE_PLAIN) | (slope <= STRIDE_HEAD_ON)
    enhanced = radius + STRIDE_TRUST * radius * (1 + slope) / (1 - slope)
    daring = np.where(method == STRIDE_ENHANCED, enhanced, 2 * radius / (1 - slope))
    return np.where(is_plain, radius, np.where(method == STRIDE_RELAXED, STRIDE_RELAXATION * radius, daring))
