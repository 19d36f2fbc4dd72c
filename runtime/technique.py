"""What every global illumination technique offers, and the list of those there are."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.device import Gpu
from runtime.encoder import Recorder
from runtime.kernel import Kernel
from runtime.resources import Buffer, Texture
from runtime.scene_tracer import SceneTracer
from runtime.structs import GpuStruct, u32
from runtime.world import World

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

TECHNIQUES: Mapping[str, str] = {
    "sdfddgi": "runtime.sdfddgi:Sdfddgi",
    "ddgi": "runtime.ddgi:Ddgi",
    "none": "runtime.no_gi:NoGi",
}
"""Name -> module and class. The name is also the folder of its shaders."""


class GatherInfo(GpuStruct):
    count: u32


@dataclass(frozen=True)
class FrameLight:
    """What a technique needs to know of a frame.

    index: number of the frame, for random numbers. bindings: group 3 of the kernels (sky, lights, shadow
    maps), bound by name. light_version: a number that changes whenever a light or the sky does, so that
    history can be dropped. viewer: where the camera stands (3,), world space; None where there is none.
    clip_from_local (4, 4): what it sees of the world's local space; None for everything.
    """

    index: int
    bindings: Mapping[str, Any] = field(default_factory=dict)
    light_version: int = 0
    viewer: Float64 | None = None
    clip_from_local: Float64 | None = None


@dataclass(frozen=True)
class Drawing:
    """A debug picture: the kernel that writes it to `layer`, its constants, and what it binds besides the
    frame's layers."""

    kernel: str
    constants: Mapping[str, float] = field(default_factory=dict)
    bindings: Mapping[str, Any] = field(default_factory=dict)


class Technique(Protocol):
    """Answers one question for every consumer: the irradiance at a point with a normal.

    In WGSL, `shaders/<name>/lookup.wgsl` has, in local space, `view` pointing to the viewer,
        fn gi_irradiance(position: vec3f, normal: vec3f, view: vec3f) -> vec3f    E, W/m2
        fn gi_radiance(position: vec3f, direction: vec3f) -> vec3f                L, W/m2/sr
    Kernels import them from `package::technique::lookup` with the alias {"technique": name} and bind
    `lookup_bindings()`, which is group 2.
    """

    name: str
    shares_tests: bool
    """Whether `shaders/<name>/` has its own `light_samples` and `fill_pixels`, where pixels share tests."""

    def __init__(self, gpu: Gpu, world: World, settings: Any = None) -> None: ...

    def record(self, rec: Recorder, frame: FrameLight) -> None:
        """Brings the technique's state to this frame, after the world's and the shadow maps' passes."""

    def lookup_bindings(self) -> Mapping[str, Any]:
        """Group 2 of every kernel that imports the lookup."""

    def reset(self) -> None:
        """Forgets all history."""

    def views(self) -> Mapping[str, Texture]:
        """Textures worth looking at, by name."""

    def drawings(self) -> Mapping[str, Drawing]:
        """Debug pictures that it draws over a frame, by name."""

    @property
    def volume(self) -> tuple[Float64, Float64] | None:
        """Corners (3,), (3,), world space, of where its probes stand; None where it has none."""

    @property
    def memory(self) -> int:
        """Bytes on the GPU."""

    @property
    def tracer(self) -> SceneTracer:
        """What its rays, and those of reflections, meet."""


def create(name: str, gpu: Gpu, world: World, settings: Any = None) -> Technique:
    """The technique called `name`.

    Raises:
        ValueError: there is none; the message lists those there are.
    """
    if name not in TECHNIQUES:
        raise ValueError(f"no technique {name!r}; there are {', '.join(TECHNIQUES)}")
    module, _, attribute = TECHNIQUES[name].partition(":")
    technique: Technique = getattr(importlib.import_module(module), attribute)(gpu, world, settings)
    return technique


class Gather:
    """The technique's irradiance at any points: the one question for tests and reports to ask."""

    def __init__(self, gpu: Gpu, world: World, technique: Technique) -> None:
        self.gpu, self.world, self.technique = gpu, world, technique
        self._kernel = Kernel(gpu, "world/gather_points", aliases={"technique": technique.name})

    def irradiance(self, points: ArrayLike, normals: ArrayLike) -> Float32:
        """E (n, 3) in W/m2 at world positions (n, 3) with unit normals (n, 3); waits for the GPU."""
        local = self.world.to_local(points)
        rows = np.zeros((len(local), 2, 4), np.float32)
        rows[:, 0, :3], rows[:, 1, :3] = local, np.asarray(normals, dtype=np.float64)
        if not len(rows):
            return np.zeros((0, 3), np.float32)
        result = Buffer(self.gpu, 16 * len(rows), label="gathered irradiance")
        rec = Recorder(self.gpu, label="gather")
        self.world.record(rec)
        with rec.compute(self._kernel.name) as compute_pass:
            self._kernel.dispatch(
                compute_pass,
                self._kernel.groups_for(len(rows)),
                self.world.bindings(),
                self.technique.lookup_bindings(),
                gather=Buffer(self.gpu, GatherInfo.pack(count=len(rows)), "uniform", label="gather"),
                points=Buffer(self.gpu, rows, label="points"),
                irradiance=result,
            )
        rec.submit()
        return result.read(np.float32, (len(rows), 4))[:, :3]
