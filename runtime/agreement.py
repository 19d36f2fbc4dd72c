"""Whether two independent estimates of the same light agree within their noise: a z-test over pixels."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from fit.scene import Float64
from runtime.estimate import Estimate

ROUNDING = 1e-5
"""Of the mean light: what two programs may differ by where neither has noise."""


@dataclass(frozen=True)
class Agreement:
    """z (groups,): difference over its standard error, of each group of pixels. limit: what the largest of so
    many passes by chance alone with the risk that was asked for. bias: the mean difference as a share of the
    mean light; bias_z: the same over its standard error, to be held against `bias_limit`."""

    z: Float64
    limit: float
    bias: float
    bias_z: float
    bias_limit: float

    @property
    def holds(self) -> bool:
        """Neither a single group nor the whole differs by more than chance."""
        return bool(np.abs(self.z).max() <= self.limit and abs(self.bias_z) <= self.bias_limit)

    def describe(self) -> str:
        """One line for a report."""
        verdict = "agree" if self.holds else "differ"
        return (
            f"{verdict}: largest |z| {np.abs(self.z).max():.2f} of {len(self.z)} (limit {self.limit:.2f}), "
            f"bias {self.bias:+.2%}, z {self.bias_z:+.2f} (limit {self.bias_limit:.2f})"
        )


def agreement(first: Estimate, second: Estimate, *, pixels_a_group: int = 1, risk: float = 1e-3) -> Agreement:
    """Compares two estimates at the same pixels, by the mean of their channels.

    pixels_a_group: so many in a row are tested as one; where rare bright paths make the light, a pixel's own
    error is no normal one, and the sum of many is. risk: of calling equal estimates different, for all groups
    together (Sidak's correction for their number) and for the whole.

    Raises:
        ValueError: the estimates are of different pixels, or of none.
    """
    if first.value.shape != second.value.shape or first.value.size == 0:
        raise ValueError(f"estimates of {first.value.shape} and {second.value.shape} cannot be compared")
    difference = (first.value - second.value).mean(axis=-1).reshape(-1)
    level = float((first.value + second.value).mean() / 2)
    variance = (first.standard_error**2 + second.standard_error**2).reshape(-1)
    begins = np.arange(0, len(difference), pixels_a_group)
    groups = np.diff(np.append(begins, len(difference)))
    error = np.sqrt(np.add.reduceat(variance, begins)) + ROUNDING * level * groups + 1e-300
    z = np.add.reduceat(difference, begins) / error
    whole = float(np.sqrt(variance.sum())) + ROUNDING * level * len(difference) + 1e-300
    return Agreement(
        z=z,
        limit=_two_sided(1 - (1 - risk) ** (1 / len(z))),
        bias=float(difference.mean() / level) if level > 0 else 0.0,
        bias_z=float(difference.sum() / whole),
        bias_limit=_two_sided(risk),
    )


def _two_sided(risk: float) -> float:
    """What a normal variable exceeds, on either side, with this probability."""
    return NormalDist().inv_cdf(1 - risk / 2)
