"""What a finished frame can show: its layers as numbers, and debug pictures made from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from runtime.device import Gpu
from runtime.encoder import Recorder
from runtime.images import encode
from runtime.kernel import Kernel, Resource
from runtime.resources import Buffer, Texture
from runtime.settings import RenderSettings, ToneCurve
from runtime.structs import GpuStruct, f32, u32
from runtime.technique import Drawing

Float32 = NDArray[np.float32]
UInt8 = NDArray[np.uint8]

LAYERS = (
    "direct",
    "indirect",
    "irradiance",
    "albedo",
    "normal",
    "face_normal",
    "position",
    "depth",
    "emission",
    "roughness",
    "motion",
    "mesh",
)
"""In the order of `view/extract_layer.wgsl`."""

TRACED = {
    "primitives": "view/show_primitives",
    "blend": "view/blend_primitives",
    "sdf-steps": "view/count_steps",
    "candidate-counts": "view/count_candidates",
}
"""Views that trace the primitive set itself, and their kernels."""

AOV_LAYERS = ("position", "normal", "albedo", "direct", "indirect", "irradiance")
"""Layers that an EXR with `aov` carries beside the picture."""

PANELS = {"side-by-side": ("mesh", "blend", "primitives")}
"""Views that are several others, from left to right."""

VIEWS = ("final", *LAYERS, *TRACED, *PANELS)
"""Every view but the technique's own, which are named `<technique>/<texture>`."""

UNLIT = ("albedo", "normal", "face_normal", "position", "depth", "emission", "mesh", *TRACED, *PANELS)
"""Views that show no light: one frame without a technique gives them."""

SHARES = ("contact/ao", "contact/ao-raw")
"""Views of shares in [0, 1]: no exposure makes them brighter."""

MOST_STEPS = 64
"""Steps of a ray that `sdf-steps` shows as white."""

MOST_CANDIDATES = 32
"""Primitives asked at a place that `candidate-counts` shows as white."""


class Readable(Protocol):
    """What is worth looking at: a texture, or a part of one."""

    def read(self) -> NDArray[Any]:
        """Its texels (height, width[, channels]); waits for the GPU."""


@dataclass(frozen=True)
class Channel:
    """One channel of a texture."""

    texture: Texture
    index: int

    def read(self) -> NDArray[Any]:
        """Its texels (height, width); waits for the GPU."""
        texels: NDArray[Any] = self.texture.read()[..., self.index]
        return texels


class Display(GpuStruct):
    exposure: f32
    tone_curve: u32


class ToneMap:
    """Scene radiance to the picture that a screen shows."""

    def __init__(self, gpu: Gpu, size: tuple[int, int], exposure: float, curve: ToneCurve) -> None:
        self._kernel = Kernel(gpu, "composite/tone_map")
        self._size = size
        self._display = Buffer(
            gpu, Display.pack(exposure=exposure, tone_curve=curve.code), "uniform", label="display"
        )
        self.picture = Texture(gpu, size, "rgba8unorm", "sample|storage", label="picture")

    def set(self, exposure: float, curve: ToneCurve) -> None:
        """Changes exposure (EV) and curve for the next frame."""
        self._display.write(Display.pack(exposure=exposure, tone_curve=curve.code))

    def record(self, rec: Recorder, radiance: Texture) -> None:
        """Fills `picture` with sRGB bytes."""
        with rec.compute(self._kernel.name) as compute_pass:
            self._kernel.dispatch(
                compute_pass,
                self._kernel.groups_for(*self._size),
                radiance=radiance,
                display=self._display,
                picture=self.picture,
            )


class Views:
    """Extracts layers of a frame; a view's kernel is made when it is first asked for."""

    def __init__(self, gpu: Gpu, size: tuple[int, int]) -> None:
        self._gpu = gpu
        self._size = size
        self._kernels: dict[str, Kernel] = {}
        self._layer = Texture(gpu, size, "rgba32float", "sample|storage", label="layer")

    def extract(self, name: str, shared: Mapping[str, Resource]) -> NDArray[np.float32]:
        """The layer or traced view called `name`, (height, width, 4) float32, alpha 1 where there is a
        surface.

        `shared` holds what its kernel binds: frame, world, G-buffer, irradiances.

        Raises:
            KeyError: there is no such view.
        """
        if name not in self._kernels:
            if name in TRACED:
                self._kernels[name] = Kernel(self._gpu, TRACED[name])
            else:
                code = dict(zip(LAYERS, range(len(LAYERS)), strict=True))[name]
                self._kernels[name] = Kernel(self._gpu, "view/extract_layer", constants={"LAYER": code})
        return self._run(name, self._kernels[name], shared)

    def draw(self, name: str, drawing: Drawing, shared: Mapping[str, Resource]) -> NDArray[np.float32]:
        """A technique's debug picture, in the form of `extract`'s."""
        if name not in self._kernels:
            self._kernels[name] = Kernel(self._gpu, drawing.kernel, constants=drawing.constants)
        return self._run(name, self._kernels[name], {**shared, **drawing.bindings})

    def _run(self, name: str, kernel: Kernel, shared: Mapping[str, Resource]) -> NDArray[np.float32]:
        rec = Recorder(self._gpu, label=name)
        with rec.compute(kernel.name) as compute_pass:
            kernel.dispatch(compute_pass, kernel.groups_for(*self._size), shared, layer=self._layer)
        rec.submit()
        pixels: NDArray[np.float32] = self._layer.read()
        return pixels


def to_display(name: str, pixels: Float32, settings: RenderSettings) -> UInt8:
    """A view's numbers (height, width, 3) as sRGB bytes for people.

    Radiance and irradiance get the exposure and the tone curve; colours that are shares are shown as they
    are; directions, positions, depths and motions are mapped to [0, 1] first.
    """
    if name in ("final", "direct", "indirect", "irradiance", "emission"):
        return encode(pixels, settings.exposure, settings.tone_curve)
    if name in ("normal", "face_normal"):
        is_surface = np.any(pixels != 0, axis=-1, keepdims=True)
        return _bytes(np.where(is_surface, pixels * 0.5 + 0.5, 0.0))
    if name in ("position", "depth"):
        return _bytes(_normalised(pixels))
    if name == "motion":
        return _bytes(0.5 + pixels * [10.0, 10.0, 0.0])
    if name == "sdf-steps":
        return _bytes(_heat(pixels[..., 0] / MOST_STEPS))
    if name == "candidate-counts":
        return _bytes(_heat(pixels[..., 0] / MOST_CANDIDATES))
    if name in ("albedo", "roughness", "mesh", "primitives", "blend", *PANELS, *SHARES):
        return encode(pixels)
    return encode(pixels, settings.exposure, settings.tone_curve)


def _bytes(shares: NDArray[Any]) -> UInt8:
    """Display values in [0, 1], not linear light, as bytes."""
    return np.floor(np.clip(shares, 0, 1) * 255 + 0.5).astype(np.uint8)


def _normalised(pixels: Float32) -> NDArray[np.float64]:
    is_surface = np.any(pixels != 0, axis=-1)
    if not is_surface.any():
        return np.zeros(pixels.shape)
    lower, upper = pixels[is_surface].min(axis=0), pixels[is_surface].max(axis=0)
    shares = (pixels - lower) / np.maximum(upper - lower, 1e-12)
    return np.where(is_surface[..., None], shares, 0.0)


def _heat(share: NDArray[np.floating]) -> NDArray[np.float64]:
    """Black, blue, red, yellow, white over [0, 1]."""
    stops = np.array([[0, 0, 0], [0.1, 0.1, 0.7], [0.8, 0.1, 0.3], [1, 0.8, 0.1], [1, 1, 1]])
    place = np.linspace(0, 1, len(stops))
    clipped = np.clip(share, 0, 1)
    return np.stack([np.interp(clipped, place, stops[:, k]) for k in range(3)], axis=-1)
