"""DDGI, the method that everyone knows: probes that keep irradiance and distances.

Majercik, Guertin, Nowrouzezahrai and McGuire 2019, "Dynamic diffuse global illumination with ray-traced
irradiance fields"; Majercik, Marrs, Spjut and McGuire 2021, "Scaling probe-based real-time dynamic global
illumination for production". Here it traces the same primitives from the same grid of probes and under the
same lights as `sdfddgi`. Besides what the two do with their rays, they differ in how probes are moved, and by
default in the number of rays: 192 for each probe and frame here, 64 there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from runtime.cascades import (
    Cascade,
    DdgiInfo,
    columns_of,
    is_turn,
    lay_cascades,
    pack_info,
)
from runtime.ddgi_settings import DdgiSettings
from runtime.device import Gpu
from runtime.encoder import Recorder
from runtime.kernel import Kernel
from runtime.probes import IRRADIANCE_SIZE, RAYS_AT_ONCE, ProbeGrid, atlas_size, workgroups
from runtime.resources import Buffer, Sampler, Texture
from runtime.scene_tracer import open_tracer
from runtime.structs import GpuStruct, f32, u32, vec3f, vec3u, vec4f
from runtime.technique import Drawing, Float64, FrameLight
from runtime.twins.random import random_rotation
from runtime.world import World

__all__ = ["Ddgi", "DdgiSettings"]

DISTANCE_SIZE = 16
"""Texels of a probe's map of distances along a side."""


class RelocateSettings(GpuStruct):
    inner_lower: vec3f
    lean: f32
    inner_upper: vec3f
    kept_lower: vec3u
    cascade: u32
    kept_upper: vec3u
    probe_count: u32
    may_sleep: u32
    clearance: f32
    reach: f32
    reach_of_rays: f32
    jump: f32


class DdgiUpdate(GpuStruct):
    rotation: vec4f
    first_probe: u32
    probe_count: u32
    columns: u32
    rays: u32
    hysteresis: f32
    hysteresis_drop: f32
    settling_growth: f32
    change_clear: f32
    change_altogether: f32
    gamma: f32
    distance_exponent: f32
    farthest: f32
    reach: f32
    bounce: f32


class Ddgi:
    """The technique "ddgi"."""

    name = "ddgi"
    shares_tests = False

    def __init__(self, gpu: Gpu, world: World, settings: DdgiSettings | None = None) -> None:
        self.gpu, self.world = gpu, world
        self.settings = s = settings or DdgiSettings()
        self.tracer = open_tracer(s.tracer, gpu, world)
        self.cascades = self._lay_probes()
        self._updates = [_CascadeUpdate(gpu, cascade) for cascade in self.cascades]
        count = sum(len(cascade.start) for cascade in self.cascades)
        seen = sum(len(cascade.start) for cascade in self.cascades if cascade.visibility > 0)
        self.farthest = s.farthest * float(np.sqrt(3)) * self.grid.spacing
        self._info = Buffer(gpu, DdgiInfo.dtype.itemsize, "uniform", label="ddgi")
        self._states = Buffer(gpu, 16 * count, label="probe states")
        self._histories = Buffer(gpu, 4 * count, label="probe histories")
        self._rays = Buffer(gpu, 16 * len(self.grid) * s.rays_per_probe, label="probe rays")
        self._drawn = Buffer(gpu, 16 * len(self.grid) * IRRADIANCE_SIZE**2, label="drawn irradiance")
        self._encoded = Buffer(gpu, 16 * count * IRRADIANCE_SIZE**2, label="probe irradiance")
        self._moments = Buffer(gpu, 8 * max(seen, 1) * DISTANCE_SIZE**2, label="probe distances")
        self._irradiance = self._atlas(count, IRRADIANCE_SIZE, "probe irradiance atlas")
        self._distance = self._atlas(max(seen, 1), DISTANCE_SIZE, "probe distance atlas")
        self._sampler = Sampler(gpu, "linear", label="probe atlas")
        aliases = {"tracer": self.tracer.folder}
        self._relocate = Kernel(gpu, "ddgi/relocate_probes", aliases=aliases)
        self._trace = Kernel(gpu, "ddgi/trace_probes", aliases=aliases)
        self._draw = Kernel(gpu, "ddgi/draw_emitters", aliases=aliases)
        self._blend_distances = Kernel(gpu, "ddgi/blend_distances")
        self._blend_irradiance = Kernel(gpu, "ddgi/blend_irradiance")
        self._seen_version = -1
        self._is_first = True
        self.reset()

    def _lay_probes(self) -> list[Cascade]:
        s, bounds = self.settings, self.world.bounds
        if s.cascades is not None:
            return lay_cascades(bounds, s.cascades, s.probe_spacing, s.visible_cascades)
        return [Cascade(s.grid or ProbeGrid.around(bounds, s.probe_spacing, s.max_probes))]

    def _atlas(self, probes: int, size: int, label: str) -> Texture:
        return Texture(self.gpu, atlas_size(probes, size), "rgba16float", "sample|storage", label=label)

    @property
    def volume(self) -> tuple[Float64, Float64]:
        return self.cascades[-1].grid.volume

    @property
    def grid(self) -> ProbeGrid:
        """The finest, or only, grid of probes."""
        return self.cascades[0].grid

    def record(self, rec: Recorder, frame: FrameLight) -> None:
        """Moves probes where the world changed, traces those whose turn it is, blends what they saw."""
        is_changed = self.tracer.version != self._seen_version
        self._seen_version = self.tracer.version
        due = [update for update in self._updates if self._is_due(update, frame)]
        for update in self._updates:
            update.since_change = 0 if is_changed else update.since_change
        for update in due:
            if update.cascade.follow(frame.viewer if self.settings.cascades is not None else None):
                update.since_change = 0
        self._write_info()
        for update in due:
            self._write_settings(update, frame)
            if update.since_change < self.settings.relocation_frames:
                self._record_relocation(rec, update)
            self._record_update(rec, frame, update)
            update.since_change += 1
        self._is_first = False

    def _is_due(self, update: _CascadeUpdate, frame: FrameLight) -> bool:
        cascade = update.cascade
        is_left = frame.viewer is not None and cascade.is_left(frame.viewer)
        return self._is_first or is_turn(cascade.number, frame.index) or is_left

    def _record_relocation(self, rec: Recorder, update: _CascadeUpdate) -> None:
        with rec.compute(self._relocate.name) as compute_pass:
            self._relocate.dispatch(
                compute_pass,
                workgroups(len(update.cascade.start)),
                self.tracer.bindings(),
                self.lookup_bindings(),
                settings=update.relocate,
                states=self._states,
                histories=self._histories,
            )

    def _record_update(self, rec: Recorder, frame: FrameLight, update: _CascadeUpdate) -> None:
        groups = workgroups(len(update.cascade.start))
        with rec.compute(self._trace.name) as compute_pass:
            self._trace.dispatch(
                compute_pass,
                (*groups, self.settings.rays_per_probe // RAYS_AT_ONCE),
                self.tracer.bindings(),
                self.lookup_bindings(),
                frame.bindings,
                settings=update.blend,
                probe_rays=self._rays,
            )
        with rec.compute(self._draw.name) as compute_pass:
            self._draw.dispatch(
                compute_pass,
                groups,
                self.tracer.bindings(),
                self.lookup_bindings(),
                settings=update.blend,
                drawn_irradiance=self._drawn,
            )
        probes = {
            "settings": update.blend,
            "states": self._states,
            "histories": self._histories,
            "probe_rays": self._rays,
        }
        if update.cascade.visibility > 0:
            with rec.compute(self._blend_distances.name) as compute_pass:
                self._blend_distances.dispatch(
                    compute_pass, groups, probes, moments=self._moments, atlas=self._distance
                )
        with rec.compute(self._blend_irradiance.name) as compute_pass:
            self._blend_irradiance.dispatch(
                compute_pass,
                groups,
                probes,
                drawn_irradiance=self._drawn,
                encoded=self._encoded,
                atlas=self._irradiance,
            )

    def lookup_bindings(self) -> Mapping[str, Any]:
        return {
            "ddgi": self._info,
            "probe_states": self._states,
            "irradiance_atlas": self._irradiance,
            "distance_atlas": self._distance,
            "probe_sampler": self._sampler,
        }

    def reset(self) -> None:
        """Forgets all history: every probe starts anew with the next frame."""
        for buffer in (self._states, self._histories, self._encoded, self._moments):
            buffer.write(np.zeros(buffer.size // 4, np.uint32))
        for update in self._updates:
            update.cascade.forget()
            update.since_change = 0
        self._seen_version = -1
        self._is_first = True
        self._write_info()

    def views(self) -> Mapping[str, Texture]:
        return {
            f"{self.name}/irradiance-atlas": self._irradiance,
            f"{self.name}/distance-atlas": self._distance,
        }

    def drawings(self) -> Mapping[str, Drawing]:
        return {}

    @property
    def memory(self) -> int:
        """Bytes on the GPU."""
        buffers = [self._info, self._states, self._histories, self._rays, self._drawn]
        buffers += [self._encoded, self._moments]
        buffers += [buffer for update in self._updates for buffer in (update.relocate, update.blend)]
        texels = sum(int(np.prod(atlas.size)) for atlas in (self._irradiance, self._distance))
        return sum(buffer.size for buffer in buffers) + 8 * texels + self.tracer.memory

    def _write_info(self) -> None:
        s = self.settings
        self._info.write(
            pack_info(
                self.cascades,
                self.world.origin,
                normal_bias=s.normal_bias,
                view_bias=s.view_bias,
                farthest=s.farthest * float(np.sqrt(3)),
                gamma=s.gamma,
            )
        )

    def _write_settings(self, update: _CascadeUpdate, frame: FrameLight) -> None:
        s, cascade = self.settings, update.cascade
        spacing, count = cascade.start.spacing, len(cascade.start)
        lower, upper = cascade.kept
        clearance = s.clearance * spacing
        inner_lower, inner_upper = (self.world.to_local(corner) for corner in self.world.bounds)
        inset = np.minimum(clearance, (inner_upper - inner_lower) / 2)
        update.relocate.write(
            RelocateSettings.pack(
                inner_lower=inner_lower + inset,
                lean=(0.5 + s.clearance) * spacing if s.lean_inward else 0.0,
                inner_upper=inner_upper - inset,
                kept_lower=lower.astype(np.uint32),
                cascade=cascade.number,
                kept_upper=upper.astype(np.uint32),
                probe_count=count,
                may_sleep=int(s.sleep),
                clearance=clearance,
                reach=s.relocation * spacing,
                reach_of_rays=min(s.max_ray_distance, 1e3 * self.world.diagonal),
                jump=0.1 * spacing,
            )
        )
        turn = np.random.default_rng((s.seed, frame.index)).random((1, 3))
        update.blend.write(
            DdgiUpdate.pack(
                rotation=random_rotation(turn)[0],
                first_probe=cascade.first,
                probe_count=count,
                columns=columns_of(self.cascades),
                rays=s.rays_per_probe,
                hysteresis=s.hysteresis,
                hysteresis_drop=s.hysteresis_drop,
                settling_growth=s.settling_growth,
                change_clear=s.change_clear,
                change_altogether=s.change_altogether,
                gamma=s.gamma,
                distance_exponent=s.distance_exponent,
                farthest=s.farthest * float(np.sqrt(3)) * spacing,
                reach=s.max_ray_distance,
                bounce=s.bounce,
            )
        )


class _CascadeUpdate:
    """One cascade with the settings of its passes. since_change: its updates since the world changed, or it
    moved."""

    def __init__(self, gpu: Gpu, cascade: Cascade) -> None:
        self.cascade = cascade
        self.relocate = Buffer(gpu, RelocateSettings.dtype.itemsize, "uniform", label="relocate")
        self.blend = Buffer(gpu, DdgiUpdate.dtype.itemsize, "uniform", label="ddgi update")
        self.since_change = 0
