"""The grid of candidate lists over the primitives: for each cell those that can be nearest somewhere in it.

`world/build_candidates` makes the lists on the GPU, all in one pool. A list for which the pool has no room
is never cut: its cell asks all primitives, until `grow`, which waits for the GPU, has made room.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.device import LIMITS, Gpu
from runtime.encoder import Recorder
from runtime.kernel import MAX_WORKGROUPS, Kernel
from runtime.resources import Buffer
from runtime.settings import WorldSettings
from runtime.structs import GpuStruct, atomic_u32

Float64 = NDArray[np.float64]

log = logging.getLogger(__name__)

LARGEST_AXIS = 256
"""Cells along an axis at most: scenes that are long and thin get cells no finer than this."""

CELLS_PER_PRIMITIVE = 64
LEAST_CELLS, MOST_CELLS = 1 << 12, 1 << 18
"""How many cells there are where no number is asked for: docs/gi.md has the figures."""

BLOCK = 4
"""Cells along the edge of a block: `world/build_candidates` lists a block first, then its cells."""

HEADER_WORDS = 2
"""Of a cell: where its list starts, and how long it is."""

ROOM_TO_SPARE = 1.5
"""A pool that has to grow becomes so many times as large as it had to be."""

LARGEST_BUFFER = LIMITS["max-storage-buffer-binding-size"]

ALL_CANDIDATES = 0xFFFFFFFF


class ListUse(GpuStruct):
    entries: atomic_u32
    longest: atomic_u32
    overflowing: atomic_u32
    block_entries: atomic_u32


@dataclass(frozen=True)
class ListStatistics:
    """The candidate lists: cells; entries there is room for; entries wanted; the longest list and the mean
    of what a cell asks; cells that ask all primitives because the pool is full; blocks of cells, and the
    candidates of all blocks, from which the cells' are chosen."""

    cells: int
    room: int
    entries: int
    longest: int
    mean: float
    overflowing: int
    blocks: int
    block_entries: int


class CandidateGrid:
    """Lists over a box; `size` (3,) cells of edge `cell` from `lower` (3,), local space."""

    def __init__(self, gpu: Gpu, settings: WorldSettings) -> None:
        self._gpu, self._settings = gpu, settings
        self._build = Kernel(gpu, "world/build_candidates")
        self._use = Buffer(gpu, ListUse.dtype.itemsize, label="use of candidate lists")
        self._lists: Buffer | None = None
        self._room = float(settings.list_length)
        """Entries for each cell, on average."""
        self.lower, self.cell, self.size = np.zeros(3), 1.0, np.ones(3, np.uint32)

    @property
    def buffer(self) -> Buffer:
        """Of all lists, for kernels to bind."""
        needed = 4 * int(self.cells * (HEADER_WORDS + self._room))
        if self._lists is None or self._lists.size < min(needed, LARGEST_BUFFER):
            self._lists = Buffer(self._gpu, min(needed, LARGEST_BUFFER), label="candidate lists")
        return self._lists

    @property
    def memory(self) -> int:
        """Bytes on the GPU."""
        return (0 if self._lists is None else self._lists.size) + self._use.size

    @property
    def cells(self) -> int:
        return int(np.prod(self.size))

    @property
    def blocks(self) -> int:
        return int(np.prod((self.size + BLOCK - 1) // BLOCK))

    def lay(self, lower: Float64, extent: Float64, primitives: int) -> None:
        """Covers the box from `lower` (3,) of `extent` (3,), local space, with cells for so many primitives.
        Buffers grow and never shrink."""
        wanted = self._settings.cells or max(LEAST_CELLS, min(CELLS_PER_PRIMITIVE * primitives, MOST_CELLS))
        self.lower, self.cell = lower, _cell_size(extent, wanted)
        self.size = np.clip(np.ceil(extent / self.cell - 1e-6), 1, LARGEST_AXIS).astype(np.uint32)

    def record(self, rec: Recorder, world: Mapping[str, Any]) -> None:
        """Builds all lists anew. world: its measures and primitives, by name."""
        rec.clear(self._use)
        groups = (min(self.blocks, MAX_WORKGROUPS), -(-self.blocks // MAX_WORKGROUPS))
        with rec.compute(self._build.name) as compute_pass:
            self._build.dispatch(compute_pass, groups, world, lists=self.buffer, list_use=self._use)

    def overflowing(self) -> int:
        """Cells for whose lists there was no room in the last build; waits for the GPU."""
        return int(self._use.read(ListUse.dtype, ())["overflowing"])

    def grow(self) -> bool:
        """Makes room for the lists built last where they had none: then they must be built again, and it is
        true. Waits for the GPU."""
        use = self._use.read(ListUse.dtype, ())
        if not use["overflowing"]:
            return False
        before = self.buffer.size
        self._room = max(self._room, ROOM_TO_SPARE * int(use["entries"]) / self.cells)
        if self.buffer.size == before:
            log.warning("candidate lists: %d of %d cells have no room", use["overflowing"], self.cells)
            return False
        log.info("candidate lists grow from %d to %d bytes", before, self.buffer.size)
        return True

    def statistics(self, finite: int) -> ListStatistics:
        """Of the lists built last, over `finite` primitives; waits for the GPU."""
        use = self._use.read(ListUse.dtype, ())
        counts = self.buffer.read(np.uint32, (self.cells, HEADER_WORDS))[:, 1]
        asked = np.where(counts == ALL_CANDIDATES, finite, counts)
        return ListStatistics(
            cells=self.cells,
            room=self.buffer.size // 4 - HEADER_WORDS * self.cells,
            entries=int(use["entries"]),
            longest=int(use["longest"]),
            mean=float(asked.mean()),
            overflowing=int(use["overflowing"]),
            blocks=self.blocks,
            block_entries=int(use["block_entries"]),
        )

    def lists(self) -> list[NDArray[np.uint32] | None]:
        """Each cell's candidates, x fastest; None of one that asks all. Waits for the GPU."""
        words = self.buffer.read(np.uint32)
        headers = words[: HEADER_WORDS * self.cells].reshape(-1, HEADER_WORDS)
        return [words[start : start + count] if count != ALL_CANDIDATES else None for start, count in headers]


def _cell_size(extent: Float64, cells: int) -> float:
    """Edge of cubic cells such that a box of this extent holds about `cells` of them."""
    if cells == 1:
        return float(extent.max())
    thin = np.maximum(extent, extent.max() / LARGEST_AXIS)
    cell = float(np.cbrt(np.prod(thin) / cells))
    return max(cell, float(extent.max()) / LARGEST_AXIS)
