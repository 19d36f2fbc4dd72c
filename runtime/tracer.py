"""Traces any rays through the world's primitives: what tests check, and what views are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.device import Gpu
from runtime.encoder import Recorder
from runtime.kernel import Kernel
from runtime.resources import Buffer
from runtime.structs import GpuStruct, f32, u32, vec3f
from runtime.timing import Timer
from runtime.world import World

NO_PRIMITIVE = 0xFFFFFFFF
"""The GPU's index of a hit that is none."""

STRIDES = ("plain", "relaxed", "enhanced", "auto")
"""How long the strides of sphere tracing are, in the order of `lib/stride.wgsl`. All give the same hits."""

MOST_STEPS = 128
"""Of a ray, as in `lib/march.wgsl`: one that has not arrived by then has met what it creeps along."""

RAYS_AT_ONCE = 64 * 65535


class TracedRay(GpuStruct):
    origin: vec3f
    reach: f32
    direction: vec3f
    softness: f32


class RayHit(GpuStruct):
    position: vec3f
    t: f32
    normal: vec3f
    primitive: u32
    albedo: vec3f
    steps: u32
    emission: vec3f
    visibility: f32
    asked: u32


@dataclass(frozen=True)
class Hits:
    """What n rays met. primitive (n,): index in the world's primitive set, -1 for none, and then t is the
    reach.

    t (n,) metres; position (n, 3) world; normal, albedo, emission (n, 3); steps (n,) of the march;
    asked (n,): distances to primitives that it took; visibility (n,) of the ray's end from its origin, with
    the penumbra asked for.
    """

    t: NDArray[np.float32]
    primitive: NDArray[np.int64]
    position: NDArray[np.float64]
    normal: NDArray[np.float32]
    albedo: NDArray[np.float32]
    emission: NDArray[np.float32]
    steps: NDArray[np.uint32]
    asked: NDArray[np.uint32]
    visibility: NDArray[np.float32]


class Tracer:
    """Hits and visibility of rays, by the same functions that the techniques call.

    strides: one of `STRIDES` instead of what the techniques use; bounded: whether a query is told how far
    its answer can be.
    """

    def __init__(self, gpu: Gpu, world: World, strides: str | None = None, *, bounded: bool = True) -> None:
        self.gpu, self.world = gpu, world
        constants: dict[str, float] = {"MARCH_BOUND": bounded}
        if strides is not None:
            constants["MARCH_STRIDES"] = STRIDES.index(strides)
        self._kernel = Kernel(gpu, "world/trace_rays", constants=constants)

    def trace(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        reach: ArrayLike = 1e30,
        softness: float = 1e-6,
        timer: Timer | None = None,
    ) -> Hits:
        """Hits of rays from world positions (n, 3) in unit directions (n, 3), at most `reach` metres far;
        waits for the GPU.

        softness: radians; with 0 there is no penumbra, and no second march for it. timer: takes the pass's
        time. Raises ValueError for more rays than one dispatch takes.
        """
        origins = np.asarray(origins, dtype=np.float64)
        if len(origins) > RAYS_AT_ONCE or not len(origins):
            raise ValueError(f"{len(origins)} rays; trace between 1 and {RAYS_AT_ONCE} at once")
        rays = TracedRay.pack_array(
            len(origins),
            origin=self.world.to_local(origins),
            direction=np.asarray(directions, dtype=np.float64),
            reach=np.broadcast_to(np.asarray(reach, dtype=np.float64), len(origins)),
            softness=np.full(len(origins), softness),
        )
        hits = Buffer(self.gpu, RayHit.dtype.itemsize * len(rays), label="hits")
        rec = Recorder(self.gpu, timer, label="trace")
        self.world.record(rec)
        with rec.compute(self._kernel.name) as compute_pass:
            groups = self._kernel.groups_for(len(rays))
            ray_buffer = Buffer(self.gpu, rays, label="rays")
            self._kernel.dispatch(compute_pass, groups, self.world.bindings(), rays=ray_buffer, hits=hits)
        rec.submit()
        found = hits.read(RayHit.dtype, (len(rays),))
        is_hit = found["primitive"] != NO_PRIMITIVE
        primitive = np.full(len(rays), -1, np.int64)
        primitive[is_hit] = self.world.order[found["primitive"][is_hit]]
        return Hits(
            t=found["t"],
            primitive=primitive,
            position=found["position"].astype(np.float64) + self.world.origin,
            normal=found["normal"],
            albedo=found["albedo"],
            emission=found["emission"],
            steps=found["steps"],
            asked=found["asked"],
            visibility=found["visibility"],
        )
