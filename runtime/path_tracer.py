"""The truth on the GPU: irradiance at any points by path tracing the scene's triangles, or its primitives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fit.primitives import PrimitiveSet
from fit.scene import Scene
from runtime.device import Gpu
from runtime.direct import LightMaps
from runtime.encoder import Recorder
from runtime.estimate import Estimate
from runtime.kernel import Kernel
from runtime.lights import Illumination
from runtime.resources import Buffer
from runtime.scene_tracer import PrimitiveTracer, SceneTracer, TriangleTracer
from runtime.settings import ShadowSettings
from runtime.sky import SkyMap
from runtime.structs import GpuStruct, f32, u32
from runtime.world import World

SAMPLES_AT_ONCE = 4
"""Samples of one dispatch: few enough that no driver takes it for a hang."""

RAYS_AT_ONCE = 64
"""The same of single rays."""

ROW = 1 << 15
"""Points in a row of workgroups; more go to further rows."""


class PathSettings(GpuStruct):
    count: u32
    row: u32
    samples: u32
    first_sample: u32
    seed: u32


class OcclusionSettings(GpuStruct):
    row: u32
    samples: u32
    first_sample: u32
    seed: u32
    radius: f32
    falloff: f32


class PathTracer:
    """Path traces one scene under one light.

    Diffuse base colour with textures and cut-outs, interpolated normals, every face two-sided; lamps shine
    from their front, double-sided ones from both sides. With `primitives`, these are traced in the place of
    the triangles, from points that follow the runtime's own start rule; where it finds no start, E is 0.
    Raises ValueError where there is nothing to trace.
    """

    def __init__(
        self, gpu: Gpu, scene: Scene, illumination: Illumination, primitives: PrimitiveSet | None = None
    ) -> None:
        self.gpu = gpu
        lower, upper = scene.bounds()
        self.origin = (lower + upper) / 2
        self.tracer: SceneTracer
        if primitives is None:
            self.tracer = TriangleTracer(gpu, scene, self.origin)
        else:
            self.tracer = PrimitiveTracer(World(gpu, scene, primitives, self.origin))
        self._sky = SkyMap(gpu, illumination.sky)
        self._lights = LightMaps(gpu, self.origin, ShadowSettings(max_suns=0, max_spots=0), None)
        self._lights.set(illumination.lights)
        self._kernel = Kernel(gpu, "paths/gather_paths", aliases={"tracer": self.tracer.folder})

    def irradiance(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        *,
        samples: int = 256,
        target: float | None = None,
        seed: int = 0,
        progress: Callable[[float], None] | None = None,
    ) -> Estimate:
        """Indirect E, W/m2, at world points (n, 3) with unit normals (n, 3): sky, emission and all bounces.

        target: mean absolute noise, a share of the mean, at which to end before `samples`.
        """
        rows = self._rows(points, normals)
        if len(rows) == 0:
            return Estimate.of_nothing()
        buffer = Buffer(self.gpu, rows, label="points")
        halves = [Buffer(self.gpu, np.zeros((len(rows), 4), np.float32), label="sums") for _ in range(2)]
        done = 0
        check_at = 64
        while done < samples:
            for half in halves:
                self._add(buffer, half, len(rows), done, seed)
                done += SAMPLES_AT_ONCE
            if progress:
                progress(min(done / samples, 1.0))
            if target is not None and done >= check_at:
                check_at *= 2
                if _summary(halves, len(rows), done).noise <= target:
                    break
        return _summary(halves, len(rows), done)

    def direct(self, points: ArrayLike, normals: ArrayLike) -> NDArray[np.float64]:
        """Direct E (n, 3), W/m2, of all lamps at world points (n, 3) with unit normals (n, 3)."""
        rows = self._rows(points, normals)
        if len(rows) == 0:
            return np.zeros((0, 3))
        kernel = Kernel(self.gpu, "paths/gather_lamps", aliases={"tracer": self.tracer.folder})
        irradiance = Buffer(self.gpu, 16 * len(rows), label="direct irradiance")
        rec = Recorder(self.gpu, label="lamps")
        with rec.compute(kernel.name) as compute_pass:
            kernel.dispatch(
                compute_pass,
                kernel.groups_for(len(rows)),
                self.tracer.bindings(),
                self._lights.bindings(),
                points=Buffer(self.gpu, rows, label="points"),
                irradiance=irradiance,
            )
        rec.submit()
        return irradiance.read(np.float32, (len(rows), 4))[:, :3].astype(np.float64)

    def openness(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        radius: float,
        falloff: float,
        *,
        samples: int = 256,
        seed: int = 0,
    ) -> NDArray[np.float64]:
        """Ambient occlusion (n,) at world points (n, 3) with unit normals (n, 3): the share of the
        hemisphere, weighted by the cosine, that nothing within `radius` metres covers; what covers it fades
        out over the last share `falloff` of them."""
        rows = self._rows(points, normals)
        if len(rows) == 0:
            return np.zeros(0)
        kernel = Kernel(self.gpu, "paths/gather_occlusion", aliases={"tracer": self.tracer.folder})
        buffer = Buffer(self.gpu, rows, label="points")
        sums = Buffer(self.gpu, np.zeros(len(rows), np.float32), label="openness")
        row = min(len(rows), ROW)
        for first in range(0, samples, RAYS_AT_ONCE):
            count = min(RAYS_AT_ONCE, samples - first)
            settings = OcclusionSettings.pack(
                row=row, samples=count, first_sample=first, seed=seed, radius=radius, falloff=falloff
            )
            rec = Recorder(self.gpu, label="occlusion")
            with rec.compute(kernel.name) as compute_pass:
                kernel.dispatch(
                    compute_pass,
                    kernel.groups_for(row, -(-len(rows) // row)),
                    self.tracer.bindings(),
                    settings=Buffer(self.gpu, settings, "uniform", label="occlusion settings"),
                    points=buffer,
                    sums=sums,
                )
            rec.submit()
        return sums.read(np.float32, (len(rows),)).astype(np.float64) / samples

    def _rows(self, points: ArrayLike, normals: ArrayLike) -> NDArray[np.float32]:
        """Local positions and normals (n, 2, 4) as the kernels read them."""
        rows = np.zeros((len(np.asarray(points)), 2, 4), np.float32)
        if len(rows):
            rows[:, 0, :3] = np.asarray(points, np.float64) - self.origin
            rows[:, 1, :3] = normals
        return rows

    def _add(self, points: Buffer, sums: Buffer, count: int, first: int, seed: int) -> None:
        row = min(count, ROW)
        settings = PathSettings.pack(
            count=count,
            row=row,
            samples=SAMPLES_AT_ONCE,
            first_sample=first,
            seed=seed,
        )
        rec = Recorder(self.gpu, label="paths")
        with rec.compute(self._kernel.name) as compute_pass:
            self._kernel.dispatch(
                compute_pass,
                self._kernel.groups_for(row, -(-count // row)),
                self.tracer.bindings(),
                self._sky.bindings(),
                self._lights.bindings(),
                settings=Buffer(self.gpu, settings, "uniform", label="path settings"),
                points=points,
                sums=sums,
            )
        rec.submit()


def _summary(halves: list[Buffer], count: int, samples: int) -> Estimate:
    first, second = (half.read(np.float32, (count, 4)).astype(np.float64) for half in halves)
    mean = (first + second)[:, :3] / samples
    spread = np.maximum((first + second)[:, 3] / samples - mean.mean(axis=1) ** 2, 0)
    half = samples / 2
    error: NDArray[np.float64] = np.sqrt(spread / samples)
    return Estimate(mean, first[:, :3] / half, second[:, :3] / half, error, samples)
