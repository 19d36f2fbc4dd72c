"""Probes: where they stand, and the octahedral irradiance maps that every probe technique stores."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.device import Gpu
from runtime.resources import Buffer, Sampler, Texture
from runtime.structs import GpuStruct, f32, u32, vec3f, vec3u, vec4f
from runtime.twins import octahedral

Float64 = NDArray[np.float64]

ATLAS_COLUMNS = 448
"""Tiles in a row of the atlas, at most: those of the largest maps still fit into 8192 texels."""

GROUPS_IN_A_ROW = 32768
"""More workgroups than WebGPU has on one axis go to a second one."""

IRRADIANCE_SIZE = 8
"""Texels of a probe's irradiance map along a side."""

OFF, FRESH = -1.0, -0.5
"""Irradiance scale of a probe that is switched off, and of one that has a place but no light of it yet."""

RAYS_AT_ONCE = 64
"""Rays of a workgroup: one for each texel of an irradiance map."""


class ProbeGridInfo(GpuStruct):
    lower: vec3f
    spacing: f32
    counts: vec3u
    columns: u32
    turn: vec3u
    follows: u32
    softness: f32


class ProbeRecord(GpuStruct):
    position: vec4f
    red: vec4f
    green: vec4f
    blue: vec4f


@dataclass(frozen=True)
class ProbeGrid:
    """Probes `spacing` metres apart; probe (0, 0, 0) stands at `lower`, world space."""

    lower: tuple[float, float, float]
    spacing: float
    counts: tuple[int, int, int]

    def __post_init__(self) -> None:
        if not self.spacing > 0 or min(self.counts) < 1:
            raise ValueError(f"a probe grid needs a spacing above 0 and a probe on each axis, not {self}")

    def __len__(self) -> int:
        return int(np.prod(self.counts))

    @property
    def centre(self) -> Float64:
        """World position (3,)."""
        return np.array(self.lower) + self.spacing * (np.array(self.counts) - 1) / 2

    @property
    def volume(self) -> tuple[Float64, Float64]:
        """Corners (3,), (3,) of the grid, and a spacing around it, which the next frame may move it by."""
        lower = np.array(self.lower)
        upper = lower + self.spacing * (np.array(self.counts) - 1)
        return lower - self.spacing, upper + self.spacing

    def positions(self) -> Float64:
        """World positions (n, 3) of the grid's nodes, x fastest."""
        z, y, x = np.meshgrid(*(np.arange(c) for c in reversed(self.counts)), indexing="ij")
        return np.array(self.lower) + self.spacing * np.stack([x, y, z], axis=-1).reshape(-1, 3)

    @staticmethod
    def around(
        bounds: tuple[ArrayLike, ArrayLike], spacing: float | None = None, max_probes: int = 9856
    ) -> ProbeGrid:
        """A grid over the box `bounds`, its outermost probes on or beyond the box's faces.

        Without a `spacing` it is as fine as `max_probes` allows; with one that asks for more, it is
        coarsened to fit.

        Raises:
            ValueError: fewer than the eight probes of one cell are allowed.
        """
        if max_probes < 8:
            raise ValueError(f"max_probes is {max_probes}; one cell of the grid already has 8")
        lower, upper = (np.asarray(corner, dtype=np.float64) for corner in bounds)
        extent = upper - lower
        step = spacing or float(np.cbrt(np.prod(np.maximum(extent, 0.05 * extent.max() + 1e-9)) / max_probes))
        while np.prod(counts := _counts(extent, step)) > max_probes:
            step *= 1.02
        return ProbeGrid.about((lower + upper) / 2, step, _triple(counts))

    @staticmethod
    def about(centre: ArrayLike, spacing: float, counts: tuple[int, int, int]) -> ProbeGrid:
        """So many probes with their middle at `centre`, world space."""
        x, y, z = (np.asarray(centre, np.float64) - spacing * (np.array(counts) - 1) / 2).tolist()
        return ProbeGrid((x, y, z), spacing, counts)


def atlas_size(probes: int, map_size: int) -> tuple[int, int]:
    """Width and height in texels of the atlas of so many maps of `map_size`^2 texels with borders."""
    columns = min(probes, ATLAS_COLUMNS)
    return (map_size + 2) * columns, (map_size + 2) * -(-probes // columns)


def check_rays(rays_per_probe: int) -> None:
    """Raises ValueError for a number of rays that workgroups do not share evenly."""
    if rays_per_probe < RAYS_AT_ONCE or rays_per_probe % RAYS_AT_ONCE:
        raise ValueError(f"rays_per_probe is {rays_per_probe}; it must be a multiple of {RAYS_AT_ONCE}")


def texel_directions() -> Float64:
    """Unit directions (IRRADIANCE_SIZE^2, 3) of the texels' centres of an irradiance map, row by row."""
    y, x = np.divmod(np.arange(IRRADIANCE_SIZE**2, dtype=np.uint32), np.uint32(IRRADIANCE_SIZE))
    sizes = np.full(len(x), IRRADIANCE_SIZE, np.uint32)
    return octahedral.oct_texel_direction(np.stack([x, y], axis=1), sizes).astype(np.float64)


def workgroups(count: int) -> tuple[int, int]:
    """Workgroups on two axes, at least `count` of them."""
    x = min(count, GROUPS_IN_A_ROW)
    return x, -(-count // x)


def _counts(extent: Float64, spacing: float) -> NDArray[np.int64]:
    return np.maximum(np.ceil(extent / spacing - 1e-6).astype(np.int64) + 1, 2)


def _triple(values: NDArray[np.int64]) -> tuple[int, int, int]:
    x, y, z = (int(v) for v in values)
    return x, y, z


class IrradianceProbes:
    """Octahedral irradiance maps of a grid of probes, ready for lookups, and after them one of the sky alone.

    records: for each probe its local position, the scale of its map (below 0: `OFF` or `FRESH`) and the
    linear part of its irradiance, a channel each: constant and slope, E = constant + slope . normal. atlas:
    the rest as tiles with borders; texel * scale is W/m2, so half floats serve any brightness. exact: all of
    the irradiance, IRRADIANCE_SIZE^2 texels a probe, in float32 and without borders: the history that updates
    blend into, where half floats would stop short of the mean.
    """

    def __init__(self, gpu: Gpu, count: int, softness: float) -> None:
        self.gpu, self.count, self._softness = gpu, count, softness
        self.info = Buffer(gpu, ProbeGridInfo.dtype.itemsize, "uniform", label="probe grid")
        self.records = Buffer(gpu, ProbeRecord.dtype.itemsize * (count + 1), label="probe records")
        self.exact = Buffer(gpu, 16 * (count + 1) * IRRADIANCE_SIZE**2, label="probe irradiance")
        self.atlas = Texture(
            gpu, atlas_size(count + 1, IRRADIANCE_SIZE), "rgba16float", "sample|storage", label="probe atlas"
        )
        self.sampler = Sampler(gpu, "linear", label="probe atlas")

    def stand(self, grid: ProbeGrid, turn: ArrayLike, origin: Float64, *, follows: bool) -> None:
        """Tells shaders where the grid stands, in the local space of a world with this origin (3,), and the
        slot (3,) of its first probe."""
        self.info.write(
            ProbeGridInfo.pack(
                lower=np.array(grid.lower) - origin,
                spacing=grid.spacing,
                counts=np.array(grid.counts, np.uint32),
                columns=min(self.count + 1, ATLAS_COLUMNS),
                turn=turn,
                follows=int(follows),
                softness=self._softness,
            )
        )

    def lookup_bindings(self) -> Mapping[str, Any]:
        return {
            "probe_grid": self.info,
            "probe_records": self.records,
            "probe_atlas": self.atlas,
            "probe_sampler": self.sampler,
        }

    def clear(self) -> None:
        """Switches every probe off and blackens its map; the sky's has yet to be seen."""
        blank = np.zeros(self.count + 1, ProbeRecord.dtype)
        blank["position"][:, 3] = OFF
        blank["position"][-1, 3] = FRESH
        self.records.write(blank)
        self.exact.write(np.zeros((self.count + 1, IRRADIANCE_SIZE**2, 4), np.float32))

    def read_records(self) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Local positions (n, 3) of the grid's probes, by slot, and which have a place (n,); waits for the
        GPU."""
        position = self.records.read(ProbeRecord.dtype, (self.count,))["position"]
        return position[:, :3], position[:, 3] >= FRESH

    @property
    def memory(self) -> int:
        """Bytes on the GPU."""
        width, height = self.atlas.size[:2]
        return self.info.size + self.records.size + self.exact.size + 8 * width * height
