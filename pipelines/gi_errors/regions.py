"""Where in a picture the light is too bright or too dark."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.scene import Float64
from pipelines.gi_errors.pixels import Pixels

Bool = NDArray[np.bool_]

LEVEL = 0.7
"""Cosine to the vertical from which a surface counts as facing up or down."""

TILES = (("top", "middle", "bottom"), ("left", "centre", "right"))
"""Rows and columns of the picture's nine parts."""

THIRDS = ("dark", "mid", "bright")


@dataclass(frozen=True)
class Region:
    """Mean irradiance of a part of the points, W/m2, and how far it is off, as a share of the reference's;
    None where that is black. share: of all points."""

    share: float
    mean: float
    reference: float
    bias: float | None


def by_region(
    pixels: Pixels, found: tuple[Float64, Float64], reference: tuple[Float64, Float64]
) -> dict[str, Region]:
    """Bias by part of the picture, by what surfaces face, and by how bright the reference is.

    found, reference: independent halves (n, 3); twice the same where there is no noise.
    """
    x, a = (sum(half.mean(axis=1) for half in halves) / 2 for halves in (found, reference))
    regions = {name: _region(mask, x, a) for name, mask in _places(pixels).items() if mask.any()}
    return regions | _thirds(x, *(half.mean(axis=1) for half in reference))


def _places(pixels: Pixels) -> dict[str, Bool]:
    up = pixels.normals[:, 1]
    masks = {"facing up": up > LEVEL, "facing sideways": np.abs(up) <= LEVEL, "facing down": up < -LEVEL}
    row, column = np.nonzero(pixels.shown)
    height, width = pixels.shown.shape
    for i, down in enumerate(TILES[0]):
        for k, across in enumerate(TILES[1]):
            masks[f"{down} {across}"] = (row * 3 // height == i) & (column * 3 // width == k)
    return masks


def _thirds(x: Float64, a: Float64, b: Float64) -> dict[str, Region]:
    """Parts chosen by one half of the reference and compared with the other: noise that decides the choice
    would look like bias."""
    regions = {}
    for third, name in enumerate(THIRDS):
        sums = []
        for chooser, judge in ((a, b), (b, a)):
            rank = np.argsort(np.argsort(chooser, kind="stable"), kind="stable")
            mask = rank * 3 // len(rank) == third
            if mask.any():
                sums.append((x[mask].mean(), judge[mask].mean()))
        if sums:
            mean, truth = np.mean(sums, axis=0)
            regions[name] = Region(1 / 3, float(mean), float(truth), _bias(mean, truth))
    return regions


def _region(mask: Bool, x: Float64, a: Float64) -> Region:
    mean, truth = float(x[mask].mean()), float(a[mask].mean())
    return Region(float(mask.mean()), mean, truth, _bias(mean, truth))


def _bias(mean: float, truth: float) -> float | None:
    return float(mean / truth - 1) if truth > 0 else None
