"""The world on the GPU: primitive records, and what finds the nearest of them: candidate lists on a grid, or
clusters.

Everything on the GPU is in local space: world minus `origin`, which is subtracted in float64, so that
scenes far from zero keep their precision.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fit.primitives import GPU_RECORD_BYTES, PrimitiveSet, pack_gpu
from fit.scene import Scene
from runtime.candidate_grid import CandidateGrid, ListStatistics
from runtime.clusters import MOST_CLUSTERS, Cluster, Clustering, cluster_count, find_clusters, pack_clusters
from runtime.culling import Box, Culled, cull
from runtime.device import Gpu
from runtime.emitters import Emitters, primitive_emitters
from runtime.encoder import Recorder
from runtime.lights import AnyLight
from runtime.resources import Buffer
from runtime.settings import CULLINGS, WorldSettings
from runtime.structs import GpuStruct, f32, u32, vec3f, vec3u

__all__ = ["CULLINGS", "ListStatistics", "World", "WorldInfo", "WorldSettings"]

Float64 = NDArray[np.float64]


class WorldInfo(GpuStruct):
    grid_lower: vec3f
    grid_cell: f32
    grid_upper: vec3f
    culling: u32
    grid_size: vec3u
    primitive_count: u32
    finite_count: u32
    cluster_count: u32
    hit_distance: f32
    start_margin: f32
    start_limit: f32
    emitter_count: u32
    emitter_power: f32


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
        self.grid = CandidateGrid(gpu, self.settings)
        self.clustering: Clustering | None = None
        self._info = Buffer(gpu, WorldInfo.dtype.itemsize, "uniform", label="world info")
        self._clusters = Buffer(gpu, MOST_CLUSTERS * Cluster.dtype.itemsize, label="clusters")
        self.cluster_count = 0
        self._records: Buffer | None = None
        self._emitters: Buffer | None = None
        self._is_stale = True
        self._most_checked = -1
        self._watched: tuple[Box, tuple[AnyLight, ...]] | None = None
        self.update(primitives)

    def update(self, primitives: PrimitiveSet) -> None:
        """Replaces the primitives; the candidate lists follow before the next use. No pipeline is rebuilt."""
        self.primitives = primitives
        self._cull()
        self._upload()
        self.version += 1

    def watch(self, volume: Box, lights: Sequence[AnyLight]) -> None:
        """Tells in which box of world space light is asked for, and what is on: where `culled_share` allows,
        primitives that are small from all of it are left out. `version` stays: it is the same world."""
        if self.settings.culled_share == 0:
            return
        self._watched = (volume, tuple(lights))
        before, after = self.culled, self._cull()
        if not np.array_equal(before.is_culled, after.is_culled):
            self._upload()

    def _cull(self) -> Culled:
        """Nothing, before `watch` was told of a volume."""
        if self._watched is None:
            found = Culled(np.zeros(len(self.primitives), bool), 0.0)
        else:
            volume, lights = self._watched
            found = cull(self.primitives, volume, self.settings.culled_share, lights)
        self.culled = found
        """What was left out."""
        return found

    def _upload(self) -> None:
        """Writes the records of all primitives that are not left out."""
        primitives = self.primitives
        finite = np.flatnonzero(~self.culled.is_culled & ~primitives.is_half_space)
        if self.settings.culling == "clusters" and len(finite):
            finite = finite[self._cluster(primitives.select(finite))]
        self.finite_count = len(finite)
        self.order = np.concatenate([finite, np.flatnonzero(primitives.is_half_space)])
        """Index in the given set of each primitive on the GPU, where half-spaces come last."""
        shown = primitives.select(self.order)
        words = pack_gpu(shown, self.origin)
        if self._records is None or self._records.size < words.nbytes:
            room = max(len(words), 1) * GPU_RECORD_BYTES
            self._records = Buffer(self.gpu, room, label="primitives")
        if len(words):
            self._records.write(words)
        self._write_emitters(primitive_emitters(shown, words))
        self._measure(shown)
        self._is_stale = True

    def record(self, rec: Recorder) -> None:
        """Rebuilds the candidate lists when the primitives changed. A list for which there is no room is
        never cut: its cell asks all primitives until there is, which `check` sees to, and which is checked
        whenever there are more primitives than ever."""
        if not self._is_stale:
            return
        if len(self.primitives) > self._most_checked:
            self._build_now()
            return
        self._record_lists(rec)

    def bindings(self) -> Mapping[str, Any]:
        """Group 1 of every kernel that asks the world."""
        if self._is_stale:
            self._build_now()
        return {
            "world": self._info,
            "primitives": self._records,
            "candidates": self.grid.buffer if self.settings.culling == "grid" else self._clusters,
            "emitters": self._emitters,
        }

    def check(self) -> int:
        """How many cells ask all primitives because the lists built last had no room; those of the next frame
        have. Waits for the GPU."""
        if self.settings.culling != "grid" or self._is_stale:
            return 0
        overflowing = self.grid.overflowing()
        if overflowing:
            self._is_stale = self.grid.grow()
        return overflowing

    def notes(self) -> tuple[str, ...]:
        """What its user should know: primitives that were left out, and lists that have no room. Waits for
        the GPU."""
        notes = []
        if self.culled.count:
            notes.append(
                f"culling: {self.culled.count:,} of {len(self.primitives):,} primitives are left out; that "
                f"changes E by at most {100 * self.culled.share:.2g} % of pi times the largest radiance"
            )
        if overflowing := self.check():
            notes.append(
                f"candidate lists: {overflowing:,} of {self.grid.cells:,} cells have no room and ask all "
                f"{self.finite_count:,} primitives, slower but as exact, until the next frame"
            )
        return tuple(notes)

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
        buffers = (self._info, self._clusters, self._records, self._emitters)
        return self.grid.memory + sum(b.size for b in buffers if b is not None)

    def list_statistics(self) -> ListStatistics:
        """Reads the candidate lists back; waits for the GPU. Raises ValueError for another culling."""
        if self.settings.culling != "grid":
            raise ValueError(f"culling {self.settings.culling!r} has no candidate lists")
        self.bindings()
        return self.grid.statistics(self.finite_count)

    def _cluster(self, finite: PrimitiveSet) -> NDArray[np.intp]:
        """Clusters the finite primitives; their order on the GPU."""
        centres = self.to_local(finite.positions)
        count = self.settings.clusters or cluster_count(len(finite))
        self.clustering = find_clusters(centres, count, self.settings.seed, self.clustering)
        records = pack_clusters(self.clustering, centres, finite.bounding_radii())
        self._clusters.write(records)
        self.cluster_count = len(records)
        return self.clustering.order

    def _write_emitters(self, shining: Emitters) -> None:
        self._shining = shining
        if self._emitters is None or self._emitters.size < shining.records.nbytes:
            self._emitters = Buffer(self.gpu, shining.records.nbytes, label="emitters")
        self._emitters.write(shining.records)

    def _measure(self, shown: PrimitiveSet) -> None:
        """Lays the grid around the finite primitives that are shown and writes the world's measures."""
        self.bounds = (
            self.primitives.bounds() if not self.primitives.is_half_space.all() else (self.origin,) * 2
        )
        lower, upper = shown.bounds() if self.finite_count else self.bounds
        pad = 0.01 * self.diagonal
        self.grid.lay(lower - self.origin - pad, upper - lower + 2 * pad, self.finite_count)
        self._info.write(
            WorldInfo.pack(
                grid_lower=self.grid.lower,
                grid_cell=self.grid.cell,
                grid_upper=self.grid.lower + self.grid.size * self.grid.cell,
                culling=CULLINGS.index(self.settings.culling),
                grid_size=self.grid.size,
                primitive_count=len(self.order),
                finite_count=self.finite_count,
                cluster_count=self.cluster_count,
                hit_distance=self.settings.hit_distance_share * self.diagonal,
                start_margin=self.start_margin,
                start_limit=self.start_limit,
                emitter_count=self._shining.count,
                emitter_power=self._shining.power,
            )
        )

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

    def _record_lists(self, rec: Recorder) -> None:
        self._is_stale = False
        if self.settings.culling == "grid" and self.finite_count:
            self.grid.record(rec, {"world": self._info, "primitives": self._records})

    def _build_now(self) -> None:
        """Builds the lists in a submission of their own, and again with more room where some had none."""
        self._most_checked = max(self._most_checked, len(self.primitives))
        while self._is_stale:
            rec = Recorder(self.gpu, label="world")
            self._record_lists(rec)
            rec.submit()
            if self.settings.culling == "grid":
                self._is_stale = self.grid.grow()


def _centre(scene: Scene | None, primitives: PrimitiveSet) -> Float64:
    if scene is not None and scene.instances:
        lower, upper = scene.bounds()
    elif len(primitives) > np.count_nonzero(primitives.is_half_space):
        lower, upper = primitives.bounds()
    else:
        return np.zeros(3)
    return (lower + upper) / 2
