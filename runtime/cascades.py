"""Where DDGI's probes stand: one grid over the scene, or cascades of grids that follow the viewer.

A cascade is a grid of 32 x 4 x 32 probes, each twice as wide as the one before (McGuire 2019, "Dynamic
Diffuse Global Illumination", part 3, "Cascades").
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fit.scene import Float64
from runtime.probes import ATLAS_COLUMNS, ProbeGrid
from runtime.scrolling import ScrollingGrid
from runtime.structs import GpuStruct, f32, u32, vec3f, vec3u

CASCADE_COUNTS = (32, 4, 32)
"""Probes of a cascade on each axis, as its authors recommend."""

MOST_CASCADES = 8

COVER = 2.0
"""The coarsest cascade is so many times as wide as the scene: it holds all of it, wherever the viewer is."""


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
class Cascade(ScrollingGrid):
    """One grid of probes. number: 0 is the finest; first: its first probe among those of all cascades.

    visibility: share of the visibility test that counts, 0 for none.
    """

    number: int = 0
    first: int = 0
    visibility: float = 1.0

    def record(self, origin: Float64) -> np.ndarray:
        """What shaders know of it, in the local space of a world with this origin."""
        return DdgiCascade.pack(
            lower=np.array(self.grid.lower) - origin,
            spacing=self.start.spacing,
            counts=self.counts.astype(np.uint32),
            first=self.first,
            turn=self.turn,
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


def pack_info(cascades: list[Cascade], origin: Float64, **shares: float) -> np.ndarray:
    """The record that lookups read."""
    rows = np.zeros(MOST_CASCADES, DdgiCascade.dtype)
    for cascade in cascades:
        rows[cascade.number] = cascade.record(origin)
    columns = columns_of(cascades)
    return DdgiInfo.pack(cascades=rows, cascade_count=len(cascades), columns=columns, **shares)
