"""SDFDDGI: probes that look around through the primitives (Hu et al., "Efficient real-time dynamic diffuse
global illumination using signed distance fields").

A grid of probes over the scene; every frame each probe looks around by sphere tracing through the
primitives, and surfaces interpolate the probes that they see. docs/gi.md tells each pass with its cost and
what fails.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.device import Gpu
from runtime.encoder import Recorder
from runtime.kernel import Kernel
from runtime.probes import IRRADIANCE_SIZE, RAYS_AT_ONCE, IrradianceProbes, ProbeGrid, check_rays, workgroups
from runtime.resources import Buffer, Texture
from runtime.scene_tracer import PrimitiveTracer
from runtime.structs import GpuStruct, f32, u32, vec3f, vec3u
from runtime.technique import FrameLight
from runtime.world import World

RAYS_ON_SOFTWARE = 4096
"""Rays of a probe in one frame that Mesa's llvmpipe can follow. It leaves all loops of an invocation in
silence after 65,535 rounds together; a ray takes about ten."""


class PlaceSettings(GpuStruct):
    lower: vec3f
    spacing: f32
    counts: vec3u
    clearance: f32
    reach: f32
    smallest_clearance: f32
    jump: f32
    attraction: f32


class UpdateSettings(GpuStruct):
    probe_count: u32
    batches: u32
    fresh_factor: u32
    frame: u32
    seed: u32
    bounce: f32
    reach: f32
    most_frames: f32
    forget_drift: u32


class ProbeHistory(GpuStruct):
    frames: f32
    fluence: f32
    drift: f32
    spread: f32
    age: f32
    peak: f32


@dataclass(frozen=True)
class SdfddgiSettings:
    """Lengths in metres, or shares of the probe spacing.

    grid: where the probes stand; None lays them over the primitives.
    probe_spacing: None makes it as fine as `max_probes` allows (the paper's volume has 22 x 14 x 32).
    rays_per_probe: a multiple of 64; a probe without history takes `fresh_factor` times as many.
    bounce: share of the light of the last frame's probes that is reflected on, 1 for all.
    max_ray_distance: rays end there and take the sky.
    history_frames: a still probe is the mean of about so many frames.
    settling_frames, settling_history, settling_growth: for so many frames after a change it is the mean of so
    few, or of this share of the frames since.
    clearance: probes keep this share of the spacing, at most `clearance_limit` metres, from all primitives
    where they can; `smallest_clearance`, metres (None: twice the world's start margin), everywhere.
    relocation: how far, in spacings, a probe may climb away from a primitive.
    attraction: how far, in spacings, it may come down to one.
    jump: a move by more spacings than this drops the history.
    softness: radians; a probe that is seen past an edge within this angle counts less.
    """

    grid: ProbeGrid | None = None
    probe_spacing: float | None = None
    max_probes: int = 9856
    rays_per_probe: int = 64
    fresh_factor: int = 4
    bounce: float = 1.0
    max_ray_distance: float = 1e30
    history_frames: float = 256.0
    settling_frames: int = 64
    settling_history: float = 4.0
    settling_growth: float = 0.125
    clearance: float = 0.06
    clearance_limit: float = 0.25
    smallest_clearance: float | None = None
    relocation: float = 0.45
    attraction: float = 0.7
    jump: float = 0.1
    softness: float = 0.02
    seed: int = 0

    def __post_init__(self) -> None:
        check_rays(self.rays_per_probe)
        if not 0 <= self.bounce <= 1:
            raise ValueError(f"bounce is {self.bounce}; it must be between 0 and 1")
        if min(self.history_frames, self.settling_history) < 1 or self.fresh_factor < 1:
            raise ValueError("history_frames, settling_history and fresh_factor must be at least 1")


class Sdfddgi:
    """The technique "sdfddgi"."""

    name = "sdfddgi"

    def __init__(self, gpu: Gpu, world: World, settings: SdfddgiSettings | None = None) -> None:
        self.gpu, self.world = gpu, world
        self.tracer = PrimitiveTracer(world)
        self.settings = s = settings or SdfddgiSettings()
        if gpu.is_software and s.rays_per_probe * s.fresh_factor > RAYS_ON_SOFTWARE:
            raise ValueError(
                f"{s.rays_per_probe} rays, {s.fresh_factor} times as many for a new probe, are more than the "
                f"{RAYS_ON_SOFTWARE} that a software renderer follows in one frame: take fewer"
            )
        self.grid = s.grid or ProbeGrid.around(world.bounds, s.probe_spacing, s.max_probes)
        self.probes = IrradianceProbes(gpu, self.grid, world.origin, s.softness)
        self._histories = Buffer(gpu, ProbeHistory.dtype.itemsize * len(self.grid), label="probe histories")
        self._place_settings = Buffer(gpu, PlaceSettings.dtype.itemsize, "uniform", label="place settings")
        self._update_settings = Buffer(gpu, UpdateSettings.dtype.itemsize, "uniform", label="update settings")
        self._place = Kernel(gpu, "sdfddgi/place_probes")
        self._update = Kernel(gpu, "sdfddgi/update_probes", aliases={"tracer": self.tracer.folder})
        self._publish = Kernel(gpu, "sdfddgi/publish_probes")
        self._placed_version = -1
        self._seen_versions = (-1, -1)
        self._since_change = 0
        self.reset()

    def record(self, rec: Recorder, frame: FrameLight) -> None:
        """Places the probes where the world changed, updates all of them, and publishes their maps."""
        self._write_settings(frame)
        self._record_places(rec)
        with rec.compute(self._update.name) as compute_pass:
            self._update.dispatch(
                compute_pass,
                workgroups(len(self.grid)),
                self.world.bindings(),
                self.probes.lookup_bindings(),
                frame.bindings,
                settings=self._update_settings,
                histories=self._histories,
                exact_irradiance=self.probes.exact,
            )
        self._record_publishing(rec)

    def place(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """World positions (n, 3) of the probes as the primitives are now, and which are on (n,); waits for
        the GPU."""
        rec = Recorder(self.gpu, label="place")
        self.world.record(rec)
        self._record_places(rec)
        rec.submit()
        local, is_on = self.probes.read_records()
        return local + self.world.origin, is_on

    def fill(self, irradiance: ArrayLike) -> None:
        """Gives the probes, where they were placed last, other irradiance than they find: E, W/m2,
        (n, IRRADIANCE_SIZE^2, 3), for the directions `probes.texel_directions`."""
        exact = np.ones((len(self.grid), IRRADIANCE_SIZE**2, 4), np.float32)
        exact[..., :3] = irradiance
        self.probes.exact.write(exact)
        rec = Recorder(self.gpu, label="fill")
        self._record_publishing(rec)
        rec.submit()

    def _record_places(self, rec: Recorder) -> None:
        if self._placed_version == self.world.version:
            return
        self._placed_version = self.world.version
        s, spacing = self.settings, self.grid.spacing
        smallest = 2 * self.world.start_margin if s.smallest_clearance is None else s.smallest_clearance
        self._place_settings.write(
            PlaceSettings.pack(
                lower=np.array(self.grid.lower) - self.world.origin,
                spacing=spacing,
                counts=np.array(self.grid.counts, np.uint32),
                clearance=min(s.clearance * spacing, s.clearance_limit),
                reach=s.relocation * spacing,
                smallest_clearance=smallest,
                jump=s.jump * spacing,
                attraction=s.attraction * spacing,
            )
        )
        with rec.compute(self._place.name) as compute_pass:
            self._place.dispatch(
                compute_pass,
                self._place.groups_for(len(self.grid)),
                self.world.bindings(),
                settings=self._place_settings,
                records=self.probes.records,
                histories=self._histories,
            )

    def _record_publishing(self, rec: Recorder) -> None:
        with rec.compute(self._publish.name) as compute_pass:
            self._publish.dispatch(
                compute_pass,
                workgroups(len(self.grid)),
                {"probe_grid": self.probes.info},
                exact_irradiance=self.probes.exact,
                records=self.probes.records,
                atlas=self.probes.atlas,
            )

    def lookup_bindings(self) -> Mapping[str, Any]:
        return self.probes.lookup_bindings()

    def reset(self) -> None:
        """Forgets all history: every probe starts anew with the next frame."""
        self.probes.clear()
        self._histories.write(np.zeros(len(self.grid), ProbeHistory.dtype))
        self._placed_version = -1
        self._seen_versions = (-1, -1)
        self._since_change = 0

    def views(self) -> Mapping[str, Texture]:
        return {f"{self.name}/probe-atlas": self.probes.atlas}

    @property
    def memory(self) -> int:
        return (
            self.probes.memory + self._histories.size + self._place_settings.size + self._update_settings.size
        )

    def _write_settings(self, frame: FrameLight) -> None:
        s = self.settings
        versions = (self.world.version, frame.light_version)
        self._since_change = 0 if versions != self._seen_versions else self._since_change + 1
        self._seen_versions = versions
        is_settling = self._since_change < s.settling_frames
        settling_history = max(s.settling_history, s.settling_growth * self._since_change)
        self._update_settings.write(
            UpdateSettings.pack(
                probe_count=len(self.grid),
                batches=s.rays_per_probe // RAYS_AT_ONCE,
                fresh_factor=s.fresh_factor,
                frame=frame.index,
                seed=s.seed,
                bounce=s.bounce,
                reach=s.max_ray_distance,
                most_frames=settling_history if is_settling else s.history_frames,
                forget_drift=int(is_settling),
            )
        )
