"""Which probes are updated in a frame: at random, by distance and direction to the viewer, within a budget
(SDFDDGI, section 3.2).

Each frame a probe's turn comes nearer by its rate, at least so fast that none waits longer than its limit;
what the budget has to spare is shared out by the weights. Those whose turn is nearest are chosen, a random
part of a frame's worth deciding between neighbours. Probes without light come first, those that have waited
to their limit next. `shaders/sdfddgi/weigh_probes`, `rank_probes` and `choose_probes` do it on the GPU;
the result is the same for the same seed, whatever order their threads run in.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from fit.scene import Float64
from runtime.camera import frustum_planes
from runtime.device import Gpu
from runtime.encoder import Recorder
from runtime.kernel import MAX_WORKGROUPS, Kernel
from runtime.probes import workgroups
from runtime.resources import Buffer
from runtime.structs import GpuStruct, atomic_u32, f32, u32, vec3f, vec4f

CHOICE_BINS = 2048
"""Keys of 22 bits are sorted out in two steps of so many bins."""

FRUSTUM_PLANES = 5


class ChoiceSettings(GpuStruct):
    planes: Annotated[vec4f, FRUSTUM_PLANES]
    viewer: vec3f
    half_distance: f32
    forward: vec3f
    behind: f32
    budget: u32
    frame: u32
    seed: u32
    longest_wait_seen: f32
    longest_wait_unseen: f32
    margin: f32


class ChoiceCounts(GpuStruct):
    """Of the placed probes: how many the camera sees, and does not; how many have no light yet; the sum of
    their weights, in units of 1 / 1024."""

    seen: u32
    unseen: u32
    fresh: u32
    weight: u32


class ChoiceTotals(GpuStruct):
    """The same while they are being counted."""

    seen: atomic_u32
    unseen: atomic_u32
    fresh: atomic_u32
    weight: atomic_u32


@dataclass(frozen=True)
class ChoiceRules:
    """budget: probes of a frame, at most. longest_wait_seen, longest_wait_unseen: frames within which every
    probe is updated that the camera sees, or does not see; a budget too small for both stretches them alike.
    half_distance: metres from the viewer at which a probe weighs half as much; behind: weight of one that is
    right behind the viewer.
    """

    budget: int
    longest_wait_seen: int
    longest_wait_unseen: int
    half_distance: float
    behind: float
    seed: int

    def __post_init__(self) -> None:
        if not 1 <= self.budget <= MAX_WORKGROUPS:
            raise ValueError(
                f"probes_per_frame is {self.budget}; it must be between 1 and {MAX_WORKGROUPS}, or None"
            )


class ProbeChoice:
    """The list of chosen probes, and the workgroups to update them with.

    Without rules all are chosen in every frame. The probe after the last one, which sees the sky alone,
    always is, over and above the budget.
    """

    def __init__(self, gpu: Gpu, count: int, rules: ChoiceRules | None) -> None:
        self.count, self.rules = count, rules
        everyone = np.arange(count + 1, dtype=np.uint32)
        self.chosen = Buffer(gpu, everyone, label="chosen probes")
        self.groups = Buffer(
            gpu, np.array([*workgroups(count + 1), 1], np.uint32), "storage|indirect", label="chosen groups"
        )
        self._gpu = gpu
        self.totals = Buffer(gpu, np.zeros(1, ChoiceTotals.dtype), label="choice totals")
        if rules is None:
            return
        self._last_totals = Buffer(gpu, np.zeros(1, ChoiceTotals.dtype), label="last choice totals")
        self._settings = Buffer(gpu, ChoiceSettings.dtype.itemsize, "uniform", label="choice settings")
        self._keys = Buffer(gpu, 4 * count, label="choice keys")
        self._bins = Buffer(gpu, 8 * CHOICE_BINS, label="choice bins")
        self._weigh = Kernel(gpu, "sdfddgi/weigh_probes")
        self._rank = Kernel(gpu, "sdfddgi/rank_probes")
        self._choose = Kernel(gpu, "sdfddgi/choose_probes")

    def record(
        self,
        rec: Recorder,
        frame: int,
        clip_from_local: Float64 | None,
        margin: float,
        probes: Mapping[str, Any],
    ) -> None:
        """Chooses the probes of a frame. clip_from_local (4, 4): of the camera, None where there is none and
        everything counts as seen; margin: metres by which its view is widened; probes: what the kernels bind
        of them."""
        if self.rules is None:
            return
        self._write(self.rules, frame, clip_from_local, margin)
        rec.copy_buffer(self.totals, self._last_totals)
        rec.clear(self.totals)
        rec.clear(self._bins)
        shared = {
            **probes,
            "settings": self._settings,
            "totals": self.totals,
            "last_totals": self._last_totals,
            "keys": self._keys,
            "bins": self._bins,
        }
        with rec.compute(self._choose.name) as compute_pass:
            self._weigh.dispatch(
                compute_pass, self._weigh.groups_for(self.count), shared, chosen_groups=self.groups
            )
            self._rank.dispatch(compute_pass, self._rank.groups_for(self.count), shared)
            self._choose.dispatch(
                compute_pass,
                self._choose.groups_for(self.count),
                shared,
                chosen=self.chosen,
                chosen_groups=self.groups,
            )

    def dispatch(
        self, kernel: Kernel, compute_pass: Any, /, *shared: Mapping[str, Any], **bindings: Any
    ) -> None:
        """Runs a workgroup of the kernel for each chosen probe."""
        kernel.dispatch_indirect(compute_pass, self.groups, 0, *shared, chosen=self.chosen, **bindings)

    def read(self) -> np.ndarray:
        """Slots of the chosen probes (n,), in order; waits for the GPU."""
        x, y, _ = self.groups.read(np.uint32, (3,)).tolist()
        slots = np.sort(self.chosen.read(np.uint32, (min(x * y, self.count + 1),)))
        return slots[slots < self.count]

    @property
    def memory(self) -> int:
        """Bytes on the GPU."""
        buffers = [self.chosen, self.groups, self.totals]
        if self.rules is not None:
            buffers += [self._last_totals, self._settings, self._keys, self._bins]
        return sum(buffer.size for buffer in buffers)

    def _write(self, rules: ChoiceRules, frame: int, clip_from_local: Float64 | None, margin: float) -> None:
        planes = np.zeros((FRUSTUM_PLANES, 4))
        planes[:, 3] = 1.0  # everything is seen
        viewer, forward, half_distance = np.zeros(3), np.zeros(3), 0.0
        if clip_from_local is not None:
            planes = frustum_planes(clip_from_local)
            local_from_clip = np.linalg.inv(clip_from_local)
            near = local_from_clip @ [0.0, 0.0, 1.0, 1.0]
            viewer, forward, half_distance = near[:3] / near[3], planes[-1, :3], rules.half_distance
        self._settings.write(
            ChoiceSettings.pack(
                planes=planes,
                viewer=viewer,
                half_distance=half_distance,
                forward=forward,
                behind=rules.behind,
                budget=rules.budget,
                frame=frame,
                seed=rules.seed,
                longest_wait_seen=rules.longest_wait_seen,
                longest_wait_unseen=rules.longest_wait_unseen,
                margin=margin,
            )
        )
