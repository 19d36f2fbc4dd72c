"""Indirect irradiance at every pixel: asked for one by one, or for one of sixteen that lights the others too.

The shared form is that of SDFDDGI, section 3.4: a few pixels that cover the picture's whole range of depths
are chosen, others in each frame; neighbours among them share tests of visibility; every pixel takes its light
from the samples on its own surface and from the last frame. docs/gi.md tells each pass with its cost.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from runtime.device import Gpu
from runtime.encoder import Recorder
from runtime.kernel import Kernel
from runtime.resources import Buffer, PingPong, Texture
from runtime.settings import ShadingMode, ShadingSettings
from runtime.structs import GpuStruct, atomic_u32, f32
from runtime.technique import Technique
from runtime.world import World

Size = tuple[int, int]
Shared = Mapping[str, Any]

NO_PIXEL = 0xFFFFFFFF
"""What stands where no pixel shows a surface."""

ROUND = 16
"""Frames in which every pixel of a still picture has its turn."""


class ShadingInfo(GpuStruct):
    share_distance: f32
    normal_agreement: f32
    slope: f32
    slack: f32
    filter_width: f32
    normal_exponent: f32
    history_weight: f32
    guess_weight: f32
    clip_margin: f32


class ShadingCounts(GpuStruct):
    samples: atomic_u32
    visibility_tests: atomic_u32
    join_tests: atomic_u32
    rings: atomic_u32
    lookups: atomic_u32


@dataclass(frozen=True)
class Counts:
    """What the last frame of the shared form took.

    pixels: that show a surface. samples: pixels that were lit by a lookup whose tests are shared.
    visibility_tests: traces to probes. join_tests: short traces from one pixel to another. rings: samples
    that saw none of their cell's probes. filled: pixels that nothing proves to be joined to a sample.
    lookups: those of them that saw none either, so that they had a lookup of their own, of up to 8 tests.
    """

    pixels: int
    samples: int
    visibility_tests: int
    join_tests: int
    rings: int
    lookups: int
    filled: int

    @property
    def tests_per_pixel(self) -> float:
        """Traces for each pixel, of every kind; a whole lookup is taken for 8."""
        return (self.visibility_tests + self.join_tests + 8 * self.lookups) / max(self.pixels, 1)


class PixelShading(Protocol):
    """Fills a picture of `irradiance` once a frame, after the G-buffer and the technique.

    frames_to_settle: whole frames after which a still picture is as good as it gets.
    """

    frames_to_settle: int

    @property
    def irradiance(self) -> Texture:
        """Indirect irradiance of the last frame, W/m2."""

    def record(self, rec: Recorder, shared: Shared) -> None:
        """shared: G-buffer, world, the technique's lookup, frame."""

    def views(self) -> tuple[str, ...]:
        """What there is to look at, by the kernels' names."""

    def read_view(self, name: str, depth: Texture) -> NDArray[np.float32]:
        """A view of the last frame; depth: of its G-buffer."""


def create(
    gpu: Gpu, size: Size, settings: ShadingSettings, technique: Technique, world: World
) -> PixelShading:
    """The form of shading that the settings ask for; without a technique there is nothing to share."""
    if settings.mode is ShadingMode.FULL or technique.name == "none":
        return FullShading(gpu, size, technique)
    return SharedShading(gpu, size, settings, technique, world)


class FullShading:
    """A whole lookup at every pixel: the reference that the shared form is held against."""

    frames_to_settle = 1

    def __init__(self, gpu: Gpu, size: Size, technique: Technique) -> None:
        self.irradiance = _irradiance(gpu, size)
        self._gather = Kernel(gpu, "composite/gather_irradiance", aliases={"technique": technique.name})

    def record(self, rec: Recorder, shared: Shared) -> None:
        """One dispatch."""
        self._gather.dispatch_pass(rec, self.irradiance.size, shared, pixel_irradiance=self.irradiance)

    def views(self) -> tuple[str, ...]:
        return ()

    def read_view(self, name: str, depth: Texture) -> NDArray[np.float32]:
        raise KeyError(name)


class SharedShading:
    """One pixel of 4 x 4 asks in a frame, and every pixel has its turn within `ROUND` frames."""

    frames_to_settle = 2 * ROUND

    def __init__(
        self, gpu: Gpu, size: Size, settings: ShadingSettings, technique: Technique, world: World
    ) -> None:
        half, quarter = _reduced(size, 2), _reduced(size, 4)
        self._settings, self._world, self._size = settings, world, size
        self._info = Buffer(gpu, ShadingInfo.dtype.itemsize, label="shading")
        self._half_pixels = Texture(gpu, half, "r32uint", "sample|storage", label="half_pixels")
        self._sample_pixels = Texture(gpu, quarter, "r32uint", "sample|storage", label="sample_pixels")
        self._sample_starts = Texture(gpu, quarter, "rgba32float", "sample|storage", label="sample_starts")
        self._sample_light = Texture(gpu, quarter, "rgba32float", "sample|storage", label="sample_light")
        self._irradiance = PingPong(_irradiance(gpu, size), _irradiance(gpu, size))
        self._missing = Buffer(gpu, 4 * (1 + size[0] * size[1]), label="missing pixels")
        self._groups = Buffer(gpu, np.zeros(3, np.uint32), "storage|indirect", label="fill groups")
        self._no_groups = Buffer(gpu, np.array([0, 1, 1], np.uint32), label="no fill groups")
        self._counts = Buffer(gpu, ShadingCounts.dtype.itemsize, label="shading counts")
        self._reduce = Kernel(gpu, "shading/reduce_pixels")
        self._choose = Kernel(gpu, "shading/choose_pixels")
        self._light, self._fill = _lookups(gpu, settings, technique)
        self._upsample = Kernel(gpu, "shading/upsample_pixels")
        self._described: tuple[ShadingSettings, float] | None = None

    @property
    def irradiance(self) -> Texture:
        return self._irradiance.current

    def record(self, rec: Recorder, shared: Shared) -> None:
        """Chooses samples, lights them, and carries their light to all pixels."""
        self._describe()
        self._irradiance.swap()
        rec.copy_buffer(self._no_groups, self._groups, 12)
        rec.copy_buffer(self._no_groups, self._missing, 4)
        rec.clear(self._counts)
        bound = {**shared, "shading": self._info, "counts": self._counts}
        half, samples, light = self._half_pixels, self._sample_pixels, self._sample_light
        starts, history = {"sample_starts": self._sample_starts}, {"history": self._irradiance.previous}
        self._reduce.dispatch_pass(rec, half.size, bound, half_pixels=half)
        self._choose.dispatch_pass(rec, samples.size, bound, half_pixels=half, sample_pixels=samples)
        self._light.dispatch_pass(
            rec, samples.size, bound | starts, sample_pixels=samples, sample_light=light
        )
        self._upsample.dispatch_pass(
            rec,
            self.irradiance.size,
            bound | history,
            sample_pixels=samples,
            sample_light=light,
            pixel_irradiance=self.irradiance,
            missing=self._missing,
            fill_groups=self._groups,
        )
        found = {"sample_pixels": samples, "sample_light": light}
        with rec.compute(self._fill.name) as compute_pass:
            self._fill.dispatch_indirect(
                compute_pass,
                self._groups,
                0,
                bound | starts | history | found,
                missing=self._missing,
                pixel_irradiance=self.irradiance,
            )

    def views(self) -> tuple[str, ...]:
        kernels = (self._reduce, self._choose, self._light, self._upsample, self._fill)
        return tuple(kernel.name for kernel in kernels)

    def read_view(self, name: str, depth: Texture) -> NDArray[np.float32]:
        """Stored depths of the pixels that the first two passes chose, the samples' light, how many samples
        of its own stand behind a pixel's light, and which pixels had to be filled."""
        if name == self._reduce.name:
            return _depths(self._half_pixels.read(), depth.read())
        if name == self._choose.name:
            return _depths(self._sample_pixels.read(), depth.read())
        if name == self._light.name:
            return np.asarray(self._sample_light.read()[..., :3])
        if name == self._upsample.name:
            return _grey(self.irradiance.read()[..., 3] / self._settings.history_weight)
        if name == self._fill.name:
            return _grey(self._filled_mask())
        raise KeyError(name)

    def counts(self, depth: Texture) -> Counts:
        """What the last frame took; waits for the GPU. depth: of its G-buffer.

        Raises:
            ValueError: the settings did not ask for it.
        """
        if not self._settings.is_counted:
            raise ValueError("nothing was counted: set ShadingSettings.is_counted")
        record = self._counts.read(ShadingCounts.dtype, ())
        counted = {name: int(record[name]) for name in ShadingCounts.dtype.names or ()}
        return Counts(pixels=int(np.count_nonzero(depth.read())), filled=len(self._filled()), **counted)

    def _filled(self) -> NDArray[np.uint32]:
        words = self._missing.read(np.uint32)
        return np.asarray(words[1 : 1 + int(words[0])])

    def _filled_mask(self) -> NDArray[np.float32]:
        mask = np.zeros(self._size[::-1], np.float32)
        packed = self._filled()
        mask[packed >> 16, packed & 0xFFFF] = 1
        return mask

    def _describe(self) -> None:
        """Writes the settings when they, or the world's measures, have changed."""
        s, margin = self._settings, self._world.start_margin
        if self._described == (s, margin):
            return
        self._described = (s, margin)
        names = [field.name for field in ShadingInfo.layout.fields]
        self._info.write(
            ShadingInfo.pack(**{name: getattr(s, name) for name in names} | {"slack": s.slack * margin})
        )


def _irradiance(gpu: Gpu, size: Size) -> Texture:
    return Texture(gpu, size, "rgba32float", "sample|storage", label="indirect_irradiance")


def _reduced(size: Size, factor: int) -> Size:
    return -(-size[0] // factor), -(-size[1] // factor)


def _lookups(gpu: Gpu, settings: ShadingSettings, technique: Technique) -> tuple[Kernel, Kernel]:
    """How samples and left-over pixels are lit: the technique's own way, or by a whole lookup for each."""
    names = ("light_samples", "fill_pixels")
    if not technique.shares_tests:
        light, fill = (
            Kernel(gpu, f"shading/{name}", aliases={"technique": technique.name}) for name in names
        )
        return light, fill
    counted = {"IS_COUNTED": int(settings.is_counted)}
    return (
        Kernel(gpu, f"{technique.name}/light_samples", constants={"UNIT": settings.unit, **counted}),
        Kernel(gpu, f"{technique.name}/fill_pixels", constants=counted),
    )


def _depths(packed: NDArray[np.uint32], depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Stored depths (h, w, 3) of packed pixels (h, w); 0 where there is none."""
    is_pixel = packed != NO_PIXEL
    rows, columns = np.where(is_pixel, packed >> 16, 0), np.where(is_pixel, packed & 0xFFFF, 0)
    return _grey(np.where(is_pixel, depth[rows, columns], 0))


def _grey(values: NDArray[Any]) -> NDArray[np.float32]:
    return np.repeat(values[..., None].astype(np.float32), 3, axis=-1)
