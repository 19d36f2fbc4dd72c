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
from runtime.probe_choice import ProbeChoice
from runtime.probes import FRESH, IRRADIANCE_SIZE, RAYS_AT_ONCE, IrradianceProbes, ProbeGrid, ProbeRecord
from runtime.resources import Buffer, Texture
from runtime.scene_tracer import PrimitiveTracer
from runtime.scrolling import ScrollingGrid
from runtime.sdfddgi_settings import SdfddgiSettings
from runtime.structs import GpuStruct, f32, u32, vec3f, vec3i, vec3u
from runtime.technique import Drawing, FrameLight
from runtime.world import World

__all__ = ["Sdfddgi", "SdfddgiSettings"]

SHOWN_BY_PROBES = ("states", "age", "updates", "refused", "irradiance")
"""In the order of `sdfddgi/show_probes`: lit (green), fresh (blue) or off (red); frames since the last
update, up to 16; number of updates, by its logarithm, up to 256; share of reflective shadow samples that were
refused; irradiance over pi."""

RAYS_ON_SOFTWARE = 4096
"""Rays of a probe in one frame that Mesa's llvmpipe can follow. It leaves all loops of an invocation in
silence after 65,535 rounds together; a ray takes about ten."""


class PlaceSettings(GpuStruct):
    start: vec3f
    world_has_changed: u32
    steps: vec3i
    kept_lower: vec3u
    kept_upper: vec3u
    clearance: f32
    reach: f32
    smallest_clearance: f32
    jump: f32
    attraction: f32


class UpdateSettings(GpuStruct):
    batches: u32
    fresh_factor: u32
    budget: u32
    frame: u32
    seed: u32
    bounce: f32
    bounce_stride: u32
    reach: f32
    since_change: u32
    settling_frames: u32
    settling_history: f32
    settling_growth: f32
    history_frames: f32


class ProbeHistory(GpuStruct):
    frames: f32
    fluence: f32
    drift: f32
    spread: f32
    age: f32
    peak: f32
    waited: f32
    updates: u32
    rsm_asked: u32
    rsm_refused: u32
    rsm_missed: u32


@dataclass(frozen=True)
class ProbeStatistics:
    """off: probes without a place; fresh: with one, but without light yet. longest_wait: frames since the
    last update of the probe that waits longest, 0 without a budget.

    rsm_samples: what the probes asked of the reflective shadow maps in their last updates; rsm_refused: the
    share that the maps' test turned down, so that a shadow was traced; rsm_missed: the share of all that was
    turned down and found lit.
    """

    probes: int
    off: int
    fresh: int
    longest_wait: int
    rsm_samples: int
    rsm_refused: float
    rsm_missed: float


class Sdfddgi:
    """The technique "sdfddgi"."""

    name = "sdfddgi"
    shares_tests = True

    def __init__(self, gpu: Gpu, world: World, settings: SdfddgiSettings | None = None) -> None:
        self.gpu, self.world = gpu, world
        self.tracer = PrimitiveTracer(world)
        self.settings = s = settings or SdfddgiSettings()
        if gpu.is_software and s.rays_per_probe * s.fresh_factor > RAYS_ON_SOFTWARE:
            raise ValueError(
                f"{s.rays_per_probe} rays, {s.fresh_factor} times as many for a new probe, are more than the "
                f"{RAYS_ON_SOFTWARE} that a software renderer follows in one frame: take fewer"
            )
        start, self.follows = self._lay_probes()
        self._volume = ScrollingGrid(start)
        self.count = len(start)
        self.probes = IrradianceProbes(gpu, self.count, s.softness)
        self._histories = Buffer(gpu, ProbeHistory.dtype.itemsize * (self.count + 1), label="probe histories")
        self.choice = ProbeChoice(gpu, self.count, s.choice_rules(start.spacing))
        self._place_settings = Buffer(gpu, PlaceSettings.dtype.itemsize, "uniform", label="place settings")
        self._update_settings = Buffer(gpu, UpdateSettings.dtype.itemsize, "uniform", label="update settings")
        self._place = Kernel(gpu, "sdfddgi/place_probes")
        self._update = Kernel(gpu, "sdfddgi/update_probes", aliases={"tracer": self.tracer.folder})
        self._publish = Kernel(gpu, "sdfddgi/publish_probes")
        self._placed_version = -1
        self._seen_versions = (-1, -1)
        self._since_change = 0
        self.reset()

    def _lay_probes(self) -> tuple[ProbeGrid, bool]:
        """Where the probes stand at first, and whether they follow the viewer."""
        s, (lower, upper) = self.settings, self.world.bounds
        if s.grid is not None:
            return s.grid, False
        grid = ProbeGrid.around((lower, upper), s.probe_spacing, s.max_probes)
        if s.volume is None or s.probe_spacing is None or grid.spacing == s.probe_spacing:
            return grid, False
        return ProbeGrid.about((lower + upper) / 2, s.probe_spacing, s.volume), True

    @property
    def grid(self) -> ProbeGrid:
        """Where the probes stand now."""
        return self._volume.grid

    @property
    def volume(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return self.grid.volume

    def record(self, rec: Recorder, frame: FrameLight) -> None:
        """Follows the viewer, places the probes that came in, or all where the world changed, chooses whose
        turn it is, updates those and publishes their maps."""
        self._write_settings(frame)
        self._record_places(rec, frame.viewer)
        probes = {**self.probes.lookup_bindings(), "histories": self._histories}
        self.choice.record(rec, frame.index, frame.clip_from_local, self.grid.spacing, probes)
        with rec.compute(self._update.name) as compute_pass:
            self.choice.dispatch(
                self._update,
                compute_pass,
                self.world.bindings(),
                probes,
                frame.bindings,
                settings=self._update_settings,
                totals=self.choice.totals,
                exact_irradiance=self.probes.exact,
            )
        self._record_publishing(rec, self.choice)

    def place(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """World positions (n, 3) of the probes, by slot, as the primitives are now, and which are on (n,);
        waits for the GPU."""
        rec = Recorder(self.gpu, label="place")
        self.world.record(rec)
        self._record_places(rec, None)
        rec.submit()
        local, is_on = self.probes.read_records()
        return local + self.world.origin, is_on

    def fill(self, irradiance: ArrayLike) -> None:
        """Gives the probes, where they were placed last, other irradiance than they find: E, W/m2,
        (n, IRRADIANCE_SIZE^2, 3), for the directions `probes.texel_directions`."""
        exact = np.ones((self.count, IRRADIANCE_SIZE**2, 4), np.float32)
        exact[..., :3] = irradiance
        self.probes.exact.write(exact)
        rec = Recorder(self.gpu, label="fill")
        self._record_publishing(rec, ProbeChoice(self.gpu, self.count, None))
        rec.submit()

    def _record_places(self, rec: Recorder, viewer: ArrayLike | None) -> None:
        has_moved = self._volume.follow(viewer if self.follows else None)
        has_changed = self._placed_version != self.world.version
        if not (has_moved or has_changed):
            return
        self._placed_version = self.world.version
        self.probes.stand(self.grid, self._volume.turn, self.world.origin, follows=self.follows)
        s, spacing = self.settings, self.grid.spacing
        smallest = 2 * self.world.start_margin if s.smallest_clearance is None else s.smallest_clearance
        kept_lower, kept_upper = self._volume.kept
        self._place_settings.write(
            PlaceSettings.pack(
                start=np.array(self._volume.start.lower) - self.world.origin,
                world_has_changed=int(has_changed),
                steps=self._volume.steps,
                kept_lower=kept_lower,
                kept_upper=kept_upper,
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
                self._place.groups_for(self.count),
                self.world.bindings(),
                {"probe_grid": self.probes.info},
                settings=self._place_settings,
                records=self.probes.records,
                histories=self._histories,
            )

    def _record_publishing(self, rec: Recorder, chosen: ProbeChoice) -> None:
        with rec.compute(self._publish.name) as compute_pass:
            chosen.dispatch(
                self._publish,
                compute_pass,
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
        self._histories.write(np.zeros(self.count + 1, ProbeHistory.dtype))
        self._volume.forget()
        self._placed_version = -1
        self._seen_versions = (-1, -1)
        self._since_change = 0

    def views(self) -> Mapping[str, Texture]:
        return {f"{self.name}/probe-atlas": self.probes.atlas}

    def drawings(self) -> Mapping[str, Drawing]:
        """The probes as balls, which tell what `SHOWN_BY_PROBES` names, and what surfaces see of them."""
        bindings = {**self.probes.lookup_bindings(), "probe_histories": self._histories}
        balls = {
            f"{self.name}/probe-{what}": Drawing("sdfddgi/show_probes", {"SHOWN": code}, bindings)
            for code, what in enumerate(SHOWN_BY_PROBES)
        }
        return {**balls, f"{self.name}/visibility": Drawing("sdfddgi/show_visibility")}

    def statistics(self) -> ProbeStatistics:
        """Of the probes as they are now; waits for the GPU."""
        histories = self._histories.read(ProbeHistory.dtype, (self.count,))
        state = self.probes.records.read(ProbeRecord.dtype, (self.count,))["position"][:, 3]
        is_placed = state >= FRESH
        waited = histories["waited"][is_placed]
        asked, refused, missed = (
            int(histories[f"rsm_{name}"].sum(dtype=np.int64)) for name in ("asked", "refused", "missed")
        )
        return ProbeStatistics(
            probes=self.count,
            off=int(np.count_nonzero(~is_placed)),
            fresh=int(np.count_nonzero(state == FRESH)),
            longest_wait=int(waited.max(initial=0)),
            rsm_samples=asked,
            rsm_refused=refused / max(asked, 1),
            rsm_missed=missed / max(asked, 1),
        )

    @property
    def memory(self) -> int:
        buffers = (self._histories, self._place_settings, self._update_settings)
        return self.probes.memory + self.choice.memory + sum(buffer.size for buffer in buffers)

    def _write_settings(self, frame: FrameLight) -> None:
        s = self.settings
        versions = (self.world.version, frame.light_version)
        self._since_change = 0 if versions != self._seen_versions else self._since_change + 1
        self._seen_versions = versions
        self._update_settings.write(
            UpdateSettings.pack(
                batches=s.rays_per_probe // RAYS_AT_ONCE,
                fresh_factor=s.fresh_factor,
                budget=self.count * s.fresh_factor if s.probes_per_frame is None else s.probes_per_frame,
                frame=frame.index,
                seed=s.seed,
                bounce=s.bounce,
                bounce_stride=round(1 / s.bounce_share),
                reach=s.max_ray_distance,
                since_change=self._since_change,
                settling_frames=s.settling_frames,
                settling_history=s.settling_history,
                settling_growth=s.settling_growth,
                history_frames=s.history_frames,
            )
        )
