"""Grids of probes that follow the viewer.

A grid moves by whole spacings, and a probe keeps its slot as long as it is in the grid:
slot = (place + turn) mod counts, so that only probes that come in start anew.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.probes import ProbeGrid

Int64 = NDArray[np.int64]

FAR_MOVE = 0.25
"""Of a grid's probes on an axis: a viewer who went farther is followed before the grid's turn."""


@dataclass
class ScrollingGrid:
    """One grid of probes.

    start: where it begins. steps (3,): spacings that it moved since. kept: corners, in probes, of the part of
    the grid that was there before the last move.
    """

    start: ProbeGrid

    def __post_init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Goes back to the beginning, where no probe is kept."""
        self.steps: Int64 = np.zeros(3, np.int64)
        self.kept: tuple[Int64, Int64] = (np.zeros(3, np.int64), np.zeros(3, np.int64))
        self._is_new = True

    @property
    def counts(self) -> Int64:
        return np.array(self.start.counts, np.int64)

    @property
    def turn(self) -> NDArray[np.uint32]:
        """Slot (3,) of the probe at the grid's place 0, 0, 0."""
        return np.mod(self.steps, self.counts).astype(np.uint32)

    @property
    def grid(self) -> ProbeGrid:
        """The grid where it stands now."""
        x, y, z = (float(v) for v in np.array(self.start.lower) + self.start.spacing * self.steps)
        return ProbeGrid((x, y, z), self.start.spacing, self.start.counts)

    def spacings_from(self, viewer: ArrayLike) -> Int64:
        """Whole spacings (3,) from the grid's centre to the viewer."""
        centre = np.array(self.grid.lower) + self.start.spacing * (self.counts - 1) / 2
        away = (np.asarray(viewer, np.float64) - centre) / self.start.spacing
        return np.trunc(away).astype(np.int64)

    def is_left(self, viewer: ArrayLike) -> bool:
        """Whether the viewer is so far from the centre that the grid must follow at once."""
        return bool(np.any(np.abs(self.spacings_from(viewer)) > np.maximum(FAR_MOVE * self.counts, 1)))

    def follow(self, viewer: ArrayLike | None) -> bool:
        """Moves the centre to within a spacing of the viewer; tells whether it moved."""
        shift = np.zeros(3, np.int64) if viewer is None else self.spacings_from(viewer)
        self.steps = self.steps + shift
        if not self._is_new:
            self.kept = (np.clip(-shift, 0, self.counts), np.clip(self.counts - shift, 0, self.counts))
        has_moved, self._is_new = self._is_new or bool(shift.any()), False
        return has_moved
