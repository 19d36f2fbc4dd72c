"""The world on the GPU: primitive records, and the grid of candidate lists that finds the nearest of them.

Everything on the GPU is in local space: world minus `origin`, which is subtracted in float64, so that
scenes far from zero keep their precision.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fit.primitives import GPU_RECORD_BYTES, PrimitiveSet, pack_gpu
from fit.scene import Scene
from runtime.device import Gpu
from runtime.emitters import Emitters, primitive_emitters
from runtime.encoder import Recorder
from runtime.kernel import Kernel
from runtime.resources import Buffer
from runtime.structs import GpuStruct, f32, u32, vec3f, vec3u

Float64 = NDArray[np.float64]

log = logging.getLogger(__name__)

CULLINGS = ("grid", "none")
"""How a query finds its candidates: exact lists on a grid, or all primitives. Both give the same hits."""

LARGEST_GRID_AXIS = 128


class WorldInfo(GpuStruct):
    grid_lower: vec3f
    grid_cell: f32
    grid_upper: vec3f
    stride: u32
    grid_size: vec3u
    primitive_count: u32
    finite_count: u32
    hit_distance: f32
    start_margin: f32
    start_limit: f32
    emitter_count: u32
    emitter_power: f32


@dataclass(frozen=True)
class WorldSettings:
    """How the world is searched. Shares are of the bounding diagonal of the finite primitives.

    culling: one of `CULLINGS`.
    cells: about how many cells the grid has.
    list_length: room for that many candidates in a cell at first; it grows.
    hit_distance_share: a ray this near to a surface has met it.
    start_margin: free distance, metres, that a look from a surface starts with (None: `start_margin_share`).
    start_limit: how far, metres, a point that lies inside a primitive may be moved out, about twice the
    fit's error (None: `start_limit_share`).
    """

    culling: str = "grid"
    cells: int = 4096
    list_length: int = 31
    hit_distance_share: float = 1e-5
    start_margin: float | None = None
    start_margin_share: float = 5e-4
    start_limit: float | None = None
    start_limit_share: float = 1e-2

    def __post_init__(self) -> None:
        if self.culling not in CULLINGS:
            raise ValueError(f"culling {self.culling!r} is not known; use {' or '.join(CULLINGS)}")
        if self.cells < 1 or self.list_length < 1:
            raise ValueError("cells and list_length must be at least 1")


@dataclass(frozen=True)
class ListStatistics:
    """The candidate lists: cells, room in each, the longest list wanted, the mean, and cells that ask all."""

    cells: int
    room: int
    longest: int
    mean: float
    overflowing: int


class World:
    """A primitive set on the GPU, ready to be traced. `version` counts its changes.

    `origin` (3,) is the world position of local zero; by default the centre of the scene, or of the
    primitives.
    """

    def __init__(
        self,
        gpu: Gpu,
        scene: Scene | None,
        primitives: PrimitiveSet,
        origin: ArrayLike | None = None,
        settings: WorldSettings | None = None,
    ) -> None:
        self.gpu = gpu
        self.scene = scene
        self.settings = settings or WorldSettings()
        self.origin: Float64 = (
            _centre(scene, primitives) if origin is None else np.array(origin, dtype=np.float64)
        )
        self.version = 0
        self._build = Kernel(gpu, "world/build_candidates")
        self._info = Buffer(gpu, WorldInfo.dtype.itemsize, "uniform", label="world info")
        self._longest = Buffer(gpu, np.zeros(1, np.uint32), label="longest candidate list")
        self._records: Buffer | None = None
        self._lists: Buffer | None = None
        self._emitters: Buffer | None = None
        # Without culling there is one cell whose list never fits, so that every query asks all primitives.
        self._room = self.settings.list_length if self.settings.culling == "grid" else 0
        self._is_stale = True
        self._is_unchecked = True
        self.primitives = primitives
        self.update(primitives)

    def update(self, primitives: PrimitiveSet) -> None:
        """Replaces the primitives; the candidate lists follow before the next use. No pipeline is rebuilt."""
        finite = ~primitives.is_half_space
        self.order = np.concatenate([np.flatnonzero(finite), np.flatnonzero(~finite)])
        """Index in the given set of each primitive on the GPU, where half-spaces come last."""
        if self._records is None or len(primitives) != len(self.primitives):
            self._is_unchecked = True
        self.primitives = primitives
        self.finite_count = int(np.count_nonzero(finite))
        words = pack_gpu(primitives, self.origin)[self.order]
        if self._records is None or self._records.size < words.nbytes:
            room = max(len(words), 1) * GPU_RECORD_BYTES
            self._records = Buffer(self.gpu, room, label="primitives")
        if len(words):
            self._records.write(words)
        self._write_emitters(primitive_emitters(primitives.select(self.order), words))
        self._measure()
        self._is_stale = True
        self.version += 1

    def record(self, rec: Recorder) -> None:
        """Rebuilds the candidate lists when the primitives changed. A list that is too long for its room
        is never cut: its cell asks all primitives until the room has grown, which is checked whenever
        their number changes."""
        if not self._is_stale:
            return
        if self._is_unchecked:
            self._build_now()
            return
        self._is_stale = False
        with rec.compute(self._build.name) as compute_pass:
            self._dispatch(compute_pass)

    def bindings(self) -> Mapping[str, Any]:
        """Group 1 of every kernel that asks the world."""
        if self._is_stale or self._is_unchecked:
            self._build_now()
        return {
            "world": self._info,
            "primitives": self._records,
            "candidates": self._lists,
            "emitters": self._emitters,
        }

    def to_local(self, points: ArrayLike) -> Float64:
        """World positions (n, 3) as the GPU holds them."""
        return np.asarray(points, dtype=np.float64) - self.origin

    @property
    def diagonal(self) -> float:
        """Of the finite primitives' bounds, metres; 1 where there are none."""
        lower, upper = self.bounds
        return float(np.linalg.norm(upper - lower)) or 1.0

    @property
    def memory(self) -> int:
        """Bytes on the GPU."""
        buffers = (self._info, self._longest, self._records, self._lists, self._emitters)
        return sum(b.size for b in buffers if b is not None)

    def list_statistics(self) -> ListStatistics:
        """Reads the candidate lists back; waits for the GPU."""
        self.bindings()
        assert self._lists is not None
        cells = int(np.prod(self._grid_size))
        counts = self._lists.read(np.uint32, (cells, self._room + 1))[:, 0]
        full = counts == 0xFFFFFFFF
        asked = np.where(full, self.finite_count, counts)
        longest = int(self._longest.read(np.uint32, (1,))[0])
        return ListStatistics(cells, self._room, longest, float(asked.mean()), int(np.count_nonzero(full)))

    def _write_emitters(self, shining: Emitters) -> None:
        self._shining = shining
        if self._emitters is None or self._emitters.size < shining.records.nbytes:
            self._emitters = Buffer(self.gpu, shining.records.nbytes, label="emitters")
        self._emitters.write(shining.records)

    def _measure(self) -> None:
        """Lays the grid around the finite primitives and writes the world's measures."""
        s = self.settings
        if self.finite_count:
            lower, upper = self.primitives.bounds()
        else:
            lower, upper = self.origin, self.origin
        self.bounds = (lower, upper)
        pad = 0.01 * self.diagonal
        low, extent = lower - self.origin - pad, upper - lower + 2 * pad
        cells = s.cells if s.culling == "grid" else 1
        cell = _cell_size(extent, cells)
        self._grid_size = np.clip(np.ceil(extent / cell - 1e-6), 1, LARGEST_GRID_AXIS).astype(np.uint32)
        self._info.write(
            WorldInfo.pack(
                grid_lower=low,
                grid_cell=cell,
                grid_upper=low + self._grid_size * cell,
                stride=self._room + 1,
                grid_size=self._grid_size,
                primitive_count=len(self.primitives),
                finite_count=self.finite_count,
                hit_distance=s.hit_distance_share * self.diagonal,
                start_margin=self.start_margin,
                start_limit=self.start_limit,
                emitter_count=self._shining.count,
                emitter_power=self._shining.power,
            )
        )
        size = 4 * int(np.prod(self._grid_size)) * (self._room + 1)
        if self._lists is None or self._lists.size < size:
            self._lists = Buffer(self.gpu, size, label="candidate lists")

    @property
    def start_margin(self) -> float:
        """Metres; see `WorldSettings`."""
        s = self.settings
        return s.start_margin_share * self.diagonal if s.start_margin is None else s.start_margin

    @property
    def start_limit(self) -> float:
        """Metres; see `WorldSettings`."""
        s = self.settings
        return s.start_limit_share * self.diagonal if s.start_limit is None else s.start_limit

    def _dispatch(self, compute_pass: Any) -> None:
        assert self._records is not None and self._lists is not None
        shared = {"world": self._info, "primitives": self._records}
        groups = self._build.groups_for(int(np.prod(self._grid_size)))
        self._build.dispatch(compute_pass, groups, shared, lists=self._lists, longest=self._longest)

    def _build_now(self) -> None:
        """Builds the lists in a submission of their own, and again with more room while one did not fit."""
        self._longest.write(np.zeros(1, np.uint32))
        rec = Recorder(self.gpu, label="world")
        self._is_stale, self._is_unchecked = True, False
        self.record(rec)
        rec.submit()
        longest = int(self._longest.read(np.uint32, (1,))[0])
        if longest > self._room and self.settings.culling == "grid":
            log.info("candidate lists grow from %d to %d entries", self._room, longest)
            self._room = longest + longest // 4
            self._measure()
            self._build_now()


def _centre(scene: Scene | None, primitives: PrimitiveSet) -> Float64:
    if scene is not None and scene.instances:
        lower, upper = scene.bounds()
    elif len(primitives) > np.count_nonzero(primitives.is_half_space):
        lower, upper = primitives.bounds()
    else:
        return np.zeros(3)
    return (lower + upper) / 2


def _cell_size(extent: Float64, cells: int) -> float:
    """Edge of cubic cells such that a box of this extent holds about `cells` of them."""
    if cells == 1:
        return float(extent.max())
    thin = np.maximum(extent, extent.max() / LARGEST_GRID_AXIS)
    cell = float(np.cbrt(np.prod(thin) / cells))
    return max(cell, float(extent.max()) / LARGEST_GRID_AXIS)
