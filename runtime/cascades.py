"""Where DDGI's probes stand: one grid over the scene, or cascades of grids that follow the viewer.

A cascade is a grid of 32 x 4 x 32 probes, each twice as wide as the one before (McGuire 2019, "Dynamic
Diffuse Global Illumination", part 3, "Cascades"). It moves by whole spacings, and a probe keeps its slot as
long as it is in the grid: slot = (place + turn) mod counts, so that only probes that come in start anew.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fit.scene import Float64
from runtime.probes import ATLAS_COLUMNS, ProbeGrid
from runtime.structs import GpuStruct, f32, u32, vec3f, vec3u

Int64 = NDArray[np.int64]

CASCADE_COUNTS = (32, 4, 32)
"""Probes of a cascade on each axis, as its authors recommend."""

MOST_CASCADES = 8

COVER = 2.0
"""The coarsest cascade is so many times as wide as the scene: it holds all of it, wherever the viewer is."""

FAR_MOVE = 0.25
"""Of a cascade's probes on an axis: a viewer who went farther is followed before the cascade's turn."""


class DdgiCascade(GpuStruct):
    lower: vec3f
    spacing: f32
    counts: vec3u
    first: u32
    turn: vec3u
    visibility: f32


class DdgiInfo(GpuStruct):
    cascades: Annotated[DdgiCascade, MOST_CASCADES]
    cascade_count: u32
    columns: u32
    normal_bias: f32
    view_bias: f32
    farthest: f32
    gamma: f32


@dataclass
class Cascade:
    """One grid of probes. number: 0 is the finest; first: its first probe among those of all cascades.

    visibility: share of the visibility test that counts, 0 for none. steps (3,): spacings that it moved
    since the beginning. kept: corners, in probes, of the part of the grid that was there before the last
    move.
    """

    start: ProbeGrid
    number: int = 0
    first: int = 0
    visibility: float = 1.0

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

    def record(self, origin: Float64) -> np.ndarray:
        """What shaders know of it, in the local space of a world with this origin."""
        return DdgiCascade.pack(
            lower=np.array(self.grid.lower) - origin,
            spacing=self.start.spacing,
            counts=self.counts.astype(np.uint32),
            first=self.first,
            turn=np.mod(self.steps, self.counts).astype(np.uint32),
            visibility=self.visibility,
        )


def lay_cascades(
    bounds: tuple[Float64, Float64], count: int, spacing: float | None, visible: float
) -> list[Cascade]:
    """`count` cascades in the middle of a scene's bounds, the finest first.

    spacing: of the finest, metres; None makes the coarsest cover the scene. visible: how many of them test
    visibility, a broken number fading the last one.

    Raises:
        ValueError: not between 1 and MOST_CASCADES of them.
    """
    if not 1 <= count <= MOST_CASCADES:
        raise ValueError(f"cascades is {count}; there can be 1 to {MOST_CASCADES}")
    lower, upper = bounds
    width = max(float((upper - lower)[[0, 2]].max()), 1e-3)
    finest = spacing or COVER * width / (CASCADE_COUNTS[0] - 1) / 2 ** (count - 1)
    cascades = []
    for number in range(count):
        step = finest * 2**number
        x, y, z = ((lower + upper) / 2 - step * (np.array(CASCADE_COUNTS) - 1) / 2).tolist()
        grid = ProbeGrid((x, y, z), step, CASCADE_COUNTS)
        share = float(np.clip(visible - number, 0, 1))
        cascades.append(Cascade(grid, number, number * len(grid), share))
    return cascades


def is_turn(number: int, frame: int) -> bool:
    """Whether a cascade is updated in this frame: the finest in each, every other half as often as the one
    before it, and never two of them in the same frame."""
    return number == 0 or frame % 2**number == 2 ** (number - 1)


def columns_of(cascades: list[Cascade]) -> int:
    """Tiles in a row of the atlases of all their probes' maps."""
    return min(sum(len(cascade.start) for cascade in cascades), ATLAS_COLUMNS)


def atlas_size(probes: int, map_size: int) -> tuple[int, int]:
    """Width and height in texels of the atlas of so many maps of `map_size`^2 texels with borders."""
    columns = min(probes, ATLAS_COLUMNS)
    return (map_size + 2) * columns, (map_size + 2) * -(-probes // columns)


def pack_info(cascades: list[Cascade], origin: Float64, **shares: float) -> np.ndarray:
    """The record that lookups read."""
    rows = np.zeros(MOST_CASCADES, DdgiCascade.dtype)
    for cascade in cascades:
        rows[cascade.number] = cascade.record(origin)
    columns = columns_of(cascades)
    return DdgiInfo.pack(cascades=rows, cascade_count=len(cascades), columns=columns, **shares)
