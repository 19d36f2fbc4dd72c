"""How different two pictures are: FLIP for eyes, relMSE for light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
UInt8 = NDArray[np.uint8]

PIXELS_PER_DEGREE = 67.0
"""FLIP's distance of the viewer."""

RELATIVE_FLOOR = 0.01
"""Share of the reference's mean that keeps dark pixels from deciding relMSE alone."""


@dataclass(frozen=True)
class RelativeError:
    """Mean squared error over the squared reference, with the sums it is made of."""

    rel_mse: float
    numerator: float
    denominator: float


def flip(reference: UInt8, picture: UInt8) -> tuple[float, UInt8]:
    """Mean FLIP error (Andersson et al. 2020) of two sRGB pictures (h, w, 3), and its map, in magma."""
    import flip_evaluator

    floats = [np.ascontiguousarray(pixels[..., :3], np.float32) / 255 for pixels in (reference, picture)]
    colors, mean, _ = flip_evaluator.evaluate(
        *floats, "LDR", inputsRGB=True, applyMagma=True, parameters={"ppd": PIXELS_PER_DEGREE}
    )
    return float(mean), np.floor(np.clip(colors, 0, 1) * 255 + 0.5).astype(np.uint8)


def relative_error(reference: Float32, picture: Float32, shown: NDArray[np.bool_]) -> RelativeError:
    """relMSE of linear pictures (h, w, 3) over the pixels `shown` (h, w), where there is geometry.

    Mean of (x - a)^2 / (a^2 + eps), eps = (0.01 of the reference's mean)^2; infinite where the reference
    is black and the picture is not.
    """
    a, x = (np.asarray(pixels, np.float64)[shown] for pixels in (reference, picture))
    if a.size == 0 or not a.any():
        return RelativeError(0.0 if np.array_equal(a, x) else float("inf"), 0.0, 0.0)
    floor = (RELATIVE_FLOOR * a.mean()) ** 2
    squared = (x - a) ** 2
    return RelativeError(
        float(np.mean(squared / (a * a + floor))), float(squared.mean()), float(np.mean(a * a) + floor)
    )
