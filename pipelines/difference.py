"""How different two pictures are: FLIP and PSNR for eyes, relMSE for light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

UInt8 = NDArray[np.uint8]
Halves = tuple[ArrayLike, ArrayLike]
"""Two independent measurements of one thing, (..., 3) each; the same array twice where it has no noise."""

PIXELS_PER_DEGREE = 67.0
"""FLIP's distance of the viewer."""

TRIMMED = 0.01
"""Share of the points that `trimmed` leaves out."""

RELATIVE_FLOOR = 0.01
"""Share of the reference's mean that keeps dark places from deciding relMSE alone."""


@dataclass(frozen=True)
class RelativeError:
    """relMSE, the means of its numerator and denominator, its standard error over the points, the ratio of
    the two means, which noise in dark places moves far less, and `trimmed`: relMSE without the hundredth of
    the points that count most in it, which in pictures with black corners hold nearly all of it."""

    rel_mse: float
    numerator: float
    denominator: float
    standard_error: float
    ratio: float
    trimmed: float


def flip(reference: UInt8, picture: UInt8) -> tuple[float, UInt8]:
    """Mean FLIP error (Andersson et al. 2020) of two sRGB pictures (h, w, 3), and its map, in magma."""
    import flip_evaluator

    floats = [np.ascontiguousarray(pixels[..., :3], np.float32) / 255 for pixels in (reference, picture)]
    colors, mean, _ = flip_evaluator.evaluate(
        *floats, "LDR", inputsRGB=True, applyMagma=True, parameters={"ppd": PIXELS_PER_DEGREE}
    )
    return float(mean), np.floor(np.clip(colors, 0, 1) * 255 + 0.5).astype(np.uint8)


def psnr(reference: UInt8, picture: UInt8, shown: NDArray[np.bool_]) -> float:
    """Peak signal-to-noise ratio, dB, of sRGB pictures (h, w, 3) over the pixels `shown` (h, w); infinite for
    equal ones."""
    difference = reference[shown].astype(np.float64) - picture[shown]
    mean = float(np.mean(difference**2)) if difference.size else 0.0
    return float(10 * np.log10(255.0**2 / mean)) if mean > 0 else float("inf")


def twice(values: ArrayLike) -> Halves:
    """The halves of something without noise."""
    return values, values


def relative_error(found: Halves, reference: Halves) -> RelativeError:
    """relMSE of linear light: the mean of (x - a)(x' - b) / (a b + eps).

    a and b are independent halves of the reference, x and x' of what is judged, so that no noise of either
    adds to the numerator; eps = (0.01 of the reference's mean)^2. Where a reference is so noisy that one of
    its halves is near 0, relMSE is too: its standard error says so, and the ratio of the means tells more.
    Infinite where the reference is black and what is judged is not.
    """
    a, b = (np.asarray(half, np.float64) for half in reference)
    x, y = (np.asarray(half, np.float64) for half in found)
    return relative_square((x - a, y - b), (a, b))


def relative_square(differences: Halves, reference: Halves) -> RelativeError:
    """The same of given differences from the reference."""
    (d, e), (a, b) = (
        tuple(np.asarray(half, np.float64) for half in halves) for halves in (differences, reference)
    )
    square = d * e
    level = float(a.mean() + b.mean()) / 2 if a.size else 0.0
    if level == 0:
        error = float("inf") if square.any() else 0.0
        numerator = float(square.mean()) if square.size else 0.0
        return RelativeError(error, numerator, 0.0, 0.0, error, error)
    denominator = a * b + (RELATIVE_FLOOR * level) ** 2
    each = (square / denominator).reshape(-1, 3).mean(axis=1)
    return RelativeError(
        float(each.mean()),
        float(square.mean()),
        float(denominator.mean()),
        float(each.std() / np.sqrt(len(each))),
        float(square.mean() / denominator.mean()),
        _trimmed_mean(each),
    )


def _trimmed_mean(values: NDArray[np.float64]) -> float:
    """Without those farthest from 0, on either side: noise has no sign."""
    kept = np.argsort(np.abs(values), kind="stable")[: len(values) - int(TRIMMED * len(values))]
    return float(values[kept].mean())
