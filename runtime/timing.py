"""GPU milliseconds of each pass, from timestamp queries."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import wgpu

from runtime.device import Gpu

MAX_PASSES = 2048  # between two calls of `results`; wgpu allows 4096 queries in a set


@dataclass(frozen=True)
class Interval:
    """When a pass ran, in milliseconds since the first of its batch began; None where no time is kept."""

    label: str
    begin: float | None
    end: float | None


class Timer:
    """Times passes by label. A device without timestamp queries gives None for each."""

    def __init__(self, gpu: Gpu) -> None:
        self._gpu = gpu
        self._labels: list[str] = []
        self._queries: Any = None
        if "timestamp-query" in gpu.features:
            self._queries = gpu.wgpu_device.create_query_set(type="timestamp", count=2 * MAX_PASSES)
            usage = wgpu.BufferUsage.QUERY_RESOLVE | wgpu.BufferUsage.COPY_SRC
            self._resolved = gpu.wgpu_device.create_buffer(
                size=16 * MAX_PASSES, usage=usage, label="timestamps"
            )

    @contextmanager
    def compute_pass(self, encoder: Any, label: str) -> Iterator[Any]:
        """A compute pass of the encoder that is timed under `label` and ended on leaving the block."""
        compute_pass = encoder.begin_compute_pass(label=label, timestamp_writes=self._writes(label))
        try:
            yield compute_pass
        finally:
            compute_pass.end()

    @contextmanager
    def render_pass(
        self, encoder: Any, label: str, color_attachments: list[Any], depth_stencil_attachment: Any = None
    ) -> Iterator[Any]:
        """The same for a render pass with wgpu's attachments."""
        render_pass = encoder.begin_render_pass(
            label=label,
            color_attachments=color_attachments,
            depth_stencil_attachment=depth_stencil_attachment,
            timestamp_writes=self._writes(label),
        )
        try:
            yield render_pass
        finally:
            render_pass.end()

    def _writes(self, label: str) -> dict[str, Any] | None:
        if len(self._labels) == MAX_PASSES:  # nobody reads the results: forget them
            self._labels.clear()
        first = 2 * len(self._labels)
        self._labels.append(label)
        if self._queries is None:
            return None
        return {
            "query_set": self._queries,
            "beginning_of_pass_write_index": first,
            "end_of_pass_write_index": first + 1,
        }

    def results(self) -> dict[str, float | None]:
        """Milliseconds of the passes since the last call, in order of first use, those of one label added up.

        Call it after submitting them; it waits until the GPU has run them.
        """
        totals: dict[str, float | None] = {}
        for one in self.intervals():
            if one.begin is None or one.end is None:
                totals[one.label] = None
            else:
                totals[one.label] = (totals.get(one.label) or 0.0) + one.end - one.begin
        return totals

    def intervals(self) -> list[Interval]:
        """The passes since the last call, in their order, on the GPU's own clock; waits as `results` does."""
        labels, self._labels = self._labels, []
        if self._queries is None or not labels:
            return [Interval(label, None, None) for label in labels]
        encoder = self._gpu.wgpu_device.create_command_encoder(label="timestamps")
        encoder.resolve_query_set(self._queries, 0, 2 * len(labels), self._resolved, 0)
        self._gpu.queue.submit([encoder.finish()])
        ticks = np.frombuffer(self._gpu.queue.read_buffer(self._resolved, 0, 16 * len(labels)), np.uint64)
        since = (ticks.astype(np.int64) - int(ticks[0])) * 1e-6  # wgpu-native gives nanoseconds
        return [
            Interval(label, begin, end)
            for label, begin, end in zip(labels, since[0::2].tolist(), since[1::2].tolist(), strict=True)
        ]
