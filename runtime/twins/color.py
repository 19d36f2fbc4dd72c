"""Twin of shaders/lib/color.wgsl: luminance, the sRGB transfer function and the tone curves."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

COLOR_TONE_LINEAR, COLOR_TONE_REINHARD, COLOR_TONE_ACES = range(3)


def color_luminance(rgb: Array) -> Array:
    """Luminance (...) of linear Rec.709 colours (..., 3)."""
    return rgb @ np.array([0.2126, 0.7152, 0.0722], rgb.dtype)


def color_srgb_from_linear(rgb: Array) -> Array:
    """IEC 61966-2-1 encoding of linear values, clipped to [0, 1]; same shape."""
    clipped = np.clip(rgb, 0, 1)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)


def color_linear_from_srgb(srgb: Array) -> Array:
    """Linear values of encoded ones, clipped to [0, 1]; same shape."""
    clipped = np.clip(srgb, 0, 1)
    return np.where(clipped <= 0.04045, clipped / 12.92, ((clipped + 0.055) / 1.055) ** 2.4)


def color_tone_reinhard(rgb: Array) -> Array:
    """x / (1 + x) in each channel (Reinhard et al. 2002, eq. 3)."""
    return rgb / (1 + rgb)


def color_tone_aces(rgb: Array) -> Array:
    """Narkowicz's rational fit of the ACES curve (2015)."""
    x = np.minimum(rgb, 1e4)
    return np.clip(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0, 1)


def color_tone(rgb: Array, exposure: float, curve: int) -> Array:
    """Linear light to linear display values in [0, 1]: exposure in stops, then the curve."""
    exposed = np.maximum(rgb, 0) * 2.0**exposure
    if curve == COLOR_TONE_REINHARD:
        return color_tone_reinhard(exposed)
    if curve == COLOR_TONE_ACES:
        return color_tone_aces(exposed)
    return np.clip(exposed, 0, 1)
