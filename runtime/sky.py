"""The sky: constant, a gradient, or an equirectangular picture. Radiance in W/m2/sr; also what the
background shows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.device import Gpu
from runtime.images import area_resample, read_image
from runtime.resources import Buffer, Texture
from runtime.structs import GpuStruct, u32, vec3f
from runtime.twins.sky import sky_gradient, sky_texel_blend, sky_uv

MAX_WIDTH = 2048
"""Wider pictures are averaged down to this, by solid angle, so that their energy is kept."""

Triple = tuple[float, float, float]


class SkyModel(GpuStruct):
    base: vec3f
    has_picture: u32
    slope: vec3f
    axis: vec3f


@dataclass(frozen=True)
class Sky:
    """Radiance base + slope (axis . direction), or that of `picture` (height, width, 3) float32, which goes
    first.

    Picture: u = atan2(x, -z) / 2 pi mod 1, v = acos(y) / pi, row 0 at the zenith.
    """

    base: Triple = (0.0, 0.0, 0.0)
    slope: Triple = (0.0, 0.0, 0.0)
    axis: Triple = (0.0, 1.0, 0.0)
    picture: NDArray[np.float32] | None = None
    name: str = ""

    @staticmethod
    def constant(rgb: Triple) -> Sky:
        """The same radiance everywhere."""
        return Sky(base=_triple(rgb))

    @staticmethod
    def gradient(base: Triple, slope: Triple, axis: Triple) -> Sky:
        """base + slope (axis . direction); `axis` may have any length but zero."""
        unit = np.asarray(axis, np.float64) / np.linalg.norm(axis)
        return Sky(_triple(base), _triple(slope), _triple(tuple(unit)))

    @staticmethod
    def from_file(path: str | Path, max_width: int = MAX_WIDTH) -> Sky:
        """An equirectangular .hdr or .exr. Negative and non-finite texels become 0.

        Raises:
            ImageError: the file cannot be read.
        """
        return Sky.from_picture(read_image(path), max_width, Path(path).name)

    @staticmethod
    def from_picture(pixels: NDArray[np.float32], max_width: int = MAX_WIDTH, name: str = "picture") -> Sky:
        """A picture (height, width, 1 or more) as a sky, at most `max_width` texels wide."""
        rgb = pixels[..., :3] if pixels.shape[-1] >= 3 else np.repeat(pixels[..., :1], 3, axis=-1)
        rgb = np.maximum(np.nan_to_num(rgb.astype(np.float32), nan=0.0, posinf=0.0, neginf=0.0), 0)
        width = min(rgb.shape[1], max_width)
        height = max(1, round(rgb.shape[0] * width / rgb.shape[1]))
        return Sky(picture=resample_sky(rgb, width, min(height, 4096)), name=name)

    def scaled(self, factor: float) -> Sky:
        """The same sky, brighter by a factor."""
        base, slope = (_triple(np.multiply(factor, part)) for part in (self.base, self.slope))
        picture = None if self.picture is None else (self.picture * factor).astype(np.float32)
        return replace(self, base=base, slope=slope, picture=picture)

    @property
    def is_black(self) -> bool:
        return self.picture is None and not any(self.base) and not any(self.slope)

    def radiance(self, direction: NDArray[np.floating]) -> NDArray[np.floating]:
        """Radiance (n, 3) seen in unit directions (n, 3), as the shaders compute it."""
        if self.picture is not None:
            return sky_texel_blend(sky_uv(direction), self.picture.astype(np.float64))
        base, slope, axis = (np.asarray(part, np.float64) for part in (self.base, self.slope, self.axis))
        return sky_gradient(base, slope, axis, direction)

    def describe(self) -> str:
        """One line for people."""
        if self.picture is not None:
            return f"sky {self.name}, {self.picture.shape[1]} x {self.picture.shape[0]}"
        if any(self.slope):
            return f"gradient sky {self.base} + {self.slope} along {self.axis}"
        return "no sky" if self.is_black else f"constant sky {self.base} W/m2/sr"


def resample_sky(picture: NDArray[np.float32], width: int, height: int) -> NDArray[np.float32]:
    """Area average to another size, rows by solid angle: the integral over the sphere is kept."""
    if picture.shape[:2] == (height, width):
        return picture
    narrow = area_resample(picture, 1, width)
    return area_resample(narrow, 0, height, lambda share: (1 - np.cos(np.pi * share)) / 2).astype(np.float32)


def sky_pyramid(picture: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    """The picture and its halvings down to one texel, energy kept."""
    levels = [picture]
    while max(levels[-1].shape[:2]) > 1:
        height, width = levels[-1].shape[:2]
        levels.append(resample_sky(levels[-1], max(width // 2, 1), max(height // 2, 1)))
    return levels


class SkyMap:
    """A sky on the GPU. `set` replaces it; the pipelines stay."""

    def __init__(self, gpu: Gpu, sky: Sky) -> None:
        self._gpu = gpu
        self._model = Buffer(gpu, SkyModel.dtype.itemsize, "uniform", label="sky")
        self.set(sky)

    def set(self, sky: Sky) -> None:
        """Uploads another sky."""
        self.sky = sky
        has_picture = int(sky.picture is not None)
        self._model.write(
            SkyModel.pack(base=sky.base, has_picture=has_picture, slope=sky.slope, axis=sky.axis)
        )
        black = np.zeros((1, 1, 3), np.float32)
        levels = sky_pyramid(black if sky.picture is None else sky.picture)
        height, width = levels[0].shape[:2]
        texture = Texture(
            self._gpu, (width, height), "rgba32float", "sample", mips=len(levels), label="sky picture"
        )
        for mip, level in enumerate(levels):
            texture.write(np.concatenate([level, np.ones((*level.shape[:2], 1), np.float32)], axis=-1), mip)
        self._texture = texture

    def bindings(self) -> dict[str, Buffer | Texture]:
        """What `lib/sky.wgsl` binds."""
        return {"sky": self._model, "sky_texture": self._texture}


def _triple(values: tuple[float, ...] | NDArray[np.floating]) -> Triple:
    r, g, b = (float(value) for value in values)
    return r, g, b
