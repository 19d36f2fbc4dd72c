"""Pictures as files: PNG for people, EXR for measurements. Every write is whole or does not happen."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from runtime.settings import ToneCurve
from runtime.twins.color import color_srgb_from_linear, color_tone

Float32 = NDArray[np.float32]
UInt8 = NDArray[np.uint8]

CHANNELS = {
    "position": ("X", "Y", "Z"),
    "normal": ("X", "Y", "Z"),
    "face_normal": ("X", "Y", "Z"),
    "depth": ("Z",),
    "motion": ("U", "V"),
    "roughness": ("roughness", "metallic"),
}
"""EXR channels of the layers that are no colours; the others are R, G, B."""


class ImageError(ValueError):
    """A picture that cannot be read or written; the message names the file."""


def encode(radiance: Float32, exposure: float = 0.0, curve: ToneCurve = ToneCurve.LINEAR) -> UInt8:
    """Linear Rec.709 (..., 3) as sRGB bytes: exposure in EV, then the tone curve. The composite/tone_map
    kernel's twin."""
    toned = color_tone(np.asarray(radiance, np.float64), exposure, curve.code)
    return np.floor(color_srgb_from_linear(toned) * 255 + 0.5).astype(np.uint8)


def write_png(path: str | Path, pixels: UInt8) -> None:
    """Writes (height, width, 1, 3 or 4) or (height, width) bytes, row 0 on top."""
    if pixels.dtype != np.uint8:
        raise ImageError(f"{path}: a PNG takes uint8, not {pixels.dtype}; encode() turns radiance into it")
    squeezed = pixels[..., 0] if pixels.ndim == 3 and pixels.shape[2] == 1 else pixels
    with _Replacing(path) as beside:
        Image.fromarray(np.ascontiguousarray(squeezed)).save(beside, format="PNG", optimize=True)


def write_exr(path: str | Path, picture: Float32, layers: Mapping[str, Float32] | None = None) -> None:
    """Writes a picture (height, width, 3) as R, G, B, and layers as `name.channel`, all float32, row 0 on
    top.

    No exposure, no tone curve. `layers` may hold any view by its name; `CHANNELS` names what is no colour.

    Raises:
        ImageError: the sizes differ or the file cannot be written.
    """
    import OpenImageIO as oiio

    names, planes = ["R", "G", "B"], [picture[..., :3]]
    for layer, values in (layers or {}).items():
        if values.shape[:2] != picture.shape[:2]:
            raise ImageError(f"{path}: layer {layer} is {values.shape[:2]}, the picture {picture.shape[:2]}")
        channels = CHANNELS.get(layer, ("R", "G", "B"))
        names += [f"{layer}.{channel}" for channel in channels]
        planes.append(values[..., : len(channels)])
    pixels = np.ascontiguousarray(np.concatenate(planes, axis=-1), np.float32)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT)
    spec.channelnames = tuple(names)
    spec.attribute("compression", "zip")
    spec.attribute("oiio:ColorSpace", "lin_rec709")
    spec.attribute("Software", "sdfprim")
    with _Replacing(path) as beside:
        output = oiio.ImageOutput.create("exr")
        fine = output and output.open(str(beside), spec) and output.write_image(pixels) and output.close()
        if not fine:
            reason = output.geterror() if output else oiio.geterror()
            raise ImageError(f"{path}: cannot write the EXR: {reason.strip()}")


def read_image(path: str | Path) -> Float32:
    """Linear pixels (height, width, channels) float32 of an .exr or .hdr, row 0 on top.

    Raises:
        ImageError: the file is missing, no picture, or absurdly large.
    """
    return read_layers(path)[0]


def read_layers(path: str | Path) -> tuple[Float32, tuple[str, ...]]:
    """Pixels (height, width, channels) float32 with the name of each channel. Errors as `read_image`."""
    import OpenImageIO as oiio

    if not Path(path).is_file():
        raise ImageError(f"{path}: there is no such file")
    source: Any = oiio.ImageInput.open(str(path))
    if source is None:
        raise ImageError(f"{path}: cannot be read as a picture: {oiio.geterror().strip()}")
    spec = source.spec()
    if spec.width * spec.height * spec.nchannels > 1 << 30:
        raise ImageError(f"{path}: {spec.width} x {spec.height} x {spec.nchannels} is too large; shrink it")
    pixels = source.read_image(oiio.FLOAT)
    names = tuple(spec.channelnames)
    source.close()
    if pixels is None:
        raise ImageError(f"{path}: cannot be read as a picture: {source.geterror().strip()}")
    return np.asarray(pixels, np.float32).reshape(spec.height, spec.width, spec.nchannels), names


def area_resample(
    values: NDArray[np.floating],
    axis: int,
    count: int,
    measure: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None,
) -> NDArray[np.float64]:
    """Averages along an axis to `count` equal cells, each over exactly the samples it covers, parts included.

    `measure` tells how much lies before a share in [0, 1] of the axis, when that is not the share itself
    (on a sphere: the solid angle above a row).
    """
    moved = np.moveaxis(np.asarray(values, np.float64), axis, 0)
    size = len(moved)
    before, edges = np.arange(size + 1) / size, np.arange(count + 1) / count
    if measure is not None:
        before, edges = measure(before), measure(edges)
    shape = (-1,) + (1,) * (moved.ndim - 1)
    sums = np.concatenate(
        [np.zeros_like(moved[:1]), np.cumsum(moved * np.diff(before).reshape(shape), axis=0)]
    )
    sample = np.clip(np.searchsorted(before, edges, side="right") - 1, 0, size - 1)
    integral = sums[sample] + (edges - before[sample]).reshape(shape) * moved[sample]
    return np.moveaxis(np.diff(integral, axis=0) / np.diff(edges).reshape(shape), 0, axis)


class _Replacing:
    """A file beside the target that takes its place when the block ends without an error."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.beside = self.path.with_name(f".{self.path.name}.{os.getpid()}.tmp")

    def __enter__(self) -> Path:
        if not self.path.parent.is_dir():
            raise ImageError(f"{self.path}: there is no folder {self.path.parent}; make it first")
        return self.beside

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            os.replace(self.beside, self.path)
        else:
            self.beside.unlink(missing_ok=True)
