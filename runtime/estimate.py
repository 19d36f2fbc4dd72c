"""A measured mean and the noise that is left in it: what every reference returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.scene import Float64


@dataclass(frozen=True)
class Estimate:
    """A mean over `samples`, and the means of its two independent halves; all of one shape (..., 3).

    standard_error (...,): of the mean of the three channels.
    """

    value: Float64
    first: Float64
    second: Float64
    standard_error: Float64
    samples: int

    @staticmethod
    def of_nothing() -> Estimate:
        """At no points at all."""
        empty = np.zeros((0, 3))
        return Estimate(empty, empty, empty, np.zeros(0), 0)

    @property
    def noise(self) -> float:
        """Mean absolute noise as a share of the mean value: half of what the halves differ by."""
        level = float(self.value.mean()) if len(self.value) else 0.0
        return float(np.abs(self.first - self.second).mean() / 2 / level) if level > 0 else 0.0
