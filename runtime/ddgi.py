"""DDGI, the method that everyone knows: probes that keep irradiance and distances.

Majercik, Guertin, Nowrouzezahrai and McGuire 2019, "Dynamic diffuse global illumination with ray-traced
irradiance fields"; Majercik, Marrs, Spjut and McGuire 2021, "Scaling probe-based real-time dynamic global
illumination for production". Here it traces the same primitives from the same grid of probes and under the
same lights as `sdfddgi`. Besides what the two do with their rays, they differ in how probes are moved, and by
default in the number of rays: 192 for each probe and frame here, 64 there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from runtime.device import Gpu
from runtime.encoder import Recorder
from runtime.kernel import Kernel
from runtime.probes import IRRADIANCE_SIZE, RAYS_AT_ONCE, ProbeGrid, ProbeGridInfo, check_rays, workgroups
from runtime.resources import Buffer, Sampler, Texture
from runtime.scene_tracer import open_tracer
from runtime.structs import GpuStruct, f32, u32, vec4f
from runtime.technique import FrameLight
from runtime.twins.random import random_rotation
from runtime.world import World

DISTANCE_SIZE = 16
"""Texels of a probe's map of distances along a side."""


class DdgiInfo(GpuStruct):
    normal_bias: f32
    view_bias: f32
    farthest: f32
    gamma: f32


class RelocateSettings(GpuStruct):
    probe_count: u32
    is_first: u32
    may_sleep: u32
    clearance: f32
    reach: f32
    reach_of_rays: f32
    jump: f32


class DdgiUpdate(GpuStruct):
    rotation: vec4f
    probe_count: u32
    columns: u32
    rays: u32
    hysteresis: f32
    hysteresis_drop: f32
    change_clear: f32
    change_altogether: f32
    gamma: f32
    distance_exponent: f32
    farthest: f32
    reach: f32
    bounce: f32


@dataclass(frozen=True)
class DdgiSettings:
    """Lengths in metres, or shares of the probe spacing.

    tracer: what probe rays meet, "primitives" or "triangles", those of the scene's meshes.
    grid, probe_spacing, max_probes: as `SdfddgiSettings` has them.
    rays_per_probe: a multiple of 64.
    bounce: share of the light of the last frame's probes that is reflected on, 1 for all.
    max_ray_distance: rays end there and take the sky.
    gamma: irradiance is blended, compared and stored as its gamma-th root.
    hysteresis: share of a texel that a frame keeps. Where the root changed by more than `change_clear` of the
    larger of old and new it is less by `hysteresis_drop`; by more than `change_altogether`, nothing is kept.
    At gamma 5 the defaults stand for irradiance 4.2 and 3125 times as large, or as small.
    distance_exponent: a texel's distance is the mean over a cosine to this power.
    farthest: longer distances count as so many diagonals of a probe cell.
    normal_bias, view_bias: how far, in spacings, a point moves from its surface, along the normal and towards
    the viewer, before it asks which probes see it.
    relocation: how far, in spacings and along each axis, a probe may stand from its node.
    clearance: probes keep this many spacings from surfaces where they can.
    relocation_frames: for so many frames after the world changed, probes move; one that is then still inside
    something is off.
    sleep: a probe without a surface in its cells is not updated; points in the open then get no light of it.
    """

    tracer: str = "primitives"
    grid: ProbeGrid | None = None
    probe_spacing: float | None = None
    max_probes: int = 9856
    rays_per_probe: int = 192
    bounce: float = 1.0
    max_ray_distance: float = 1e30
    hysteresis: float = 0.97
    hysteresis_drop: float = 0.15
    change_clear: float = 0.25
    change_altogether: float = 0.8
    gamma: float = 5.0
    distance_exponent: float = 50.0
    farthest: float = 1.5
    normal_bias: float = 0.045
    view_bias: float = 0.18
    relocation: float = 0.45
    clearance: float = 0.2
    relocation_frames: int = 8
    sleep: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        check_rays(self.rays_per_probe)
        for name in ("bounce", "hysteresis"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} is {getattr(self, name)}; it must be between 0 and 1")


class Ddgi:
    """The technique "ddgi"."""

    name = "ddgi"

    def __init__(self, gpu: Gpu, world: World, settings: DdgiSettings | None = None) -> None:
        self.gpu, self.world = gpu, world
        self.settings = s = settings or DdgiSettings()
        self.grid = grid = s.grid or ProbeGrid.around(world.bounds, s.probe_spacing, s.max_probes)
        self.farthest = s.farthest * float(np.sqrt(3)) * grid.spacing
        self._grid_info = Buffer(gpu, ProbeGridInfo.dtype.itemsize, "uniform", label="probe grid")
        self._grid_info.write(grid.info(world.origin))
        self._info = Buffer(gpu, DdgiInfo.dtype.itemsize, "uniform", label="ddgi")
        self._info.write(
            DdgiInfo.pack(
                normal_bias=s.normal_bias * grid.spacing,
                view_bias=s.view_bias * grid.spacing,
                farthest=self.farthest,
                gamma=s.gamma,
            )
        )
        self._relocate_settings = Buffer(gpu, RelocateSettings.dtype.itemsize, "uniform", label="relocate")
        self._update_settings = Buffer(gpu, DdgiUpdate.dtype.itemsize, "uniform", label="ddgi update")
        count = len(grid)
        self._states = Buffer(gpu, 16 * count, label="probe states")
        self._histories = Buffer(gpu, 4 * count, label="probe histories")
        self._rays = Buffer(gpu, 16 * count * s.rays_per_probe, label="probe rays")
        self._encoded = Buffer(gpu, 16 * count * IRRADIANCE_SIZE**2, label="probe irradiance")
        self._moments = Buffer(gpu, 8 * count * DISTANCE_SIZE**2, label="probe distances")
        self._irradiance = self._atlas(IRRADIANCE_SIZE, "probe irradiance atlas")
        self._distance = self._atlas(DISTANCE_SIZE, "probe distance atlas")
        self._sampler = Sampler(gpu, "linear", label="probe atlas")
        self.tracer = open_tracer(s.tracer, gpu, world)
        aliases = {"tracer": self.tracer.folder}
        self._relocate = Kernel(gpu, "ddgi/relocate_probes", aliases=aliases)
        self._trace = Kernel(gpu, "ddgi/trace_probes", aliases=aliases)
        self._blend_distances = Kernel(gpu, "ddgi/blend_distances")
        self._blend_irradiance = Kernel(gpu, "ddgi/blend_irradiance")
        self.reset()

    def _atlas(self, size: int, label: str) -> Texture:
        return Texture(self.gpu, self.grid.atlas_size(size), "rgba16float", "sample|storage", label=label)

    def record(self, rec: Recorder, frame: FrameLight) -> None:
        """Moves the probes where the world changed, traces all of them, and blends what they saw."""
        self._write_settings(frame)
        scene, lookup, groups = self.tracer.bindings(), self.lookup_bindings(), workgroups(len(self.grid))
        if self._since_change < self.settings.relocation_frames:
            with rec.compute(self._relocate.name) as compute_pass:
                self._relocate.dispatch(
                    compute_pass,
                    groups,
                    scene,
                    lookup,
                    settings=self._relocate_settings,
                    states=self._states,
                    histories=self._histories,
                )
        with rec.compute(self._trace.name) as compute_pass:
            self._trace.dispatch(
                compute_pass,
                (*groups, self.settings.rays_per_probe // RAYS_AT_ONCE),
                scene,
                lookup,
                frame.bindings,
                settings=self._update_settings,
                probe_rays=self._rays,
            )
        probes = {
            "settings": self._update_settings,
            "states": self._states,
            "histories": self._histories,
            "probe_rays": self._rays,
        }
        with rec.compute(self._blend_distances.name) as compute_pass:
            self._blend_distances.dispatch(
                compute_pass, groups, probes, moments=self._moments, atlas=self._distance
            )
        with rec.compute(self._blend_irradiance.name) as compute_pass:
            self._blend_irradiance.dispatch(
                compute_pass, groups, probes, encoded=self._encoded, atlas=self._irradiance
            )

    def lookup_bindings(self) -> Mapping[str, Any]:
        return {
            "probe_grid": self._grid_info,
            "ddgi": self._info,
            "probe_states": self._states,
            "irradiance_atlas": self._irradiance,
            "distance_atlas": self._distance,
            "probe_sampler": self._sampler,
        }

    def reset(self) -> None:
        """Forgets all history: every probe starts anew with the next frame."""
        self._states.write(np.zeros((len(self.grid), 4), np.float32))
        self._histories.write(np.zeros(len(self.grid), np.uint32))
        self._encoded.write(np.zeros((len(self.grid), IRRADIANCE_SIZE**2, 4), np.float32))
        self._moments.write(np.zeros((len(self.grid), DISTANCE_SIZE**2, 2), np.float32))
        self._seen_version = -1
        self._since_change = 0
        self._is_first = True

    def views(self) -> Mapping[str, Texture]:
        return {
            f"{self.name}/irradiance-atlas": self._irradiance,
            f"{self.name}/distance-atlas": self._distance,
        }

    @property
    def memory(self) -> int:
        """Bytes on the GPU."""
        buffers = (
            self._grid_info, self._info, self._relocate_settings, self._update_settings, self._states,
            self._histories, self._rays, self._encoded, self._moments,
        )  # fmt: skip
        texels = sum(int(np.prod(self.grid.atlas_size(size))) for size in (IRRADIANCE_SIZE, DISTANCE_SIZE))
        return sum(buffer.size for buffer in buffers) + 8 * texels + self.tracer.memory

    def _write_settings(self, frame: FrameLight) -> None:
        s, spacing = self.settings, self.grid.spacing
        self._since_change = 0 if self.world.version != self._seen_version else self._since_change + 1
        self._seen_version = self.world.version
        self._relocate_settings.write(
            RelocateSettings.pack(
                probe_count=len(self.grid),
                is_first=int(self._is_first),
                may_sleep=int(s.sleep),
                clearance=s.clearance * spacing,
                reach=s.relocation * spacing,
                reach_of_rays=min(s.max_ray_distance, 1e3 * self.world.diagonal),
                jump=0.1 * spacing,
            )
        )
        self._is_first = False
        turn = np.random.default_rng((s.seed, frame.index)).random((1, 3))
        self._update_settings.write(
            DdgiUpdate.pack(
                rotation=random_rotation(turn)[0],
                probe_count=len(self.grid),
                columns=self.grid.columns,
                rays=s.rays_per_probe,
                hysteresis=s.hysteresis,
                hysteresis_drop=s.hysteresis_drop,
                change_clear=s.change_clear,
                change_altogether=s.change_altogether,
                gamma=s.gamma,
                distance_exponent=s.distance_exponent,
                farthest=self.farthest,
                reach=s.max_ray_distance,
                bounce=s.bounce,
            )
        )
