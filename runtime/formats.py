"""Texture formats: how NumPy holds a texel, and what a portable device may do with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Format:
    """`channels` values of `dtype` a texel, of WebGPU's `sample_type`.

    `storage`, `renderable`: whether every device has storage textures and render targets of it.
    """

    dtype: np.dtype
    channels: int
    sample_type: str
    storage: bool
    renderable: bool

    @property
    def texel_bytes(self) -> int:
        return self.dtype.itemsize * self.channels


def _format(code: str, channels: int, sample_type: str, use: str) -> Format:
    return Format(np.dtype(code), channels, sample_type, "s" in use, "r" in use)


# WebGPU, 26.1 "Texture Format Capabilities": s storage, r renderable.
FORMATS = {
    "r8unorm": _format("u1", 1, "float", "r"),
    "rg8unorm": _format("u1", 2, "float", "r"),
    "rgba8unorm": _format("u1", 4, "float", "sr"),
    "rgba8unorm-srgb": _format("u1", 4, "float", "r"),
    "rgba8snorm": _format("i1", 4, "float", "s"),
    "r8uint": _format("u1", 1, "uint", "r"),
    "rgba8uint": _format("u1", 4, "uint", "sr"),
    "r16uint": _format("<u2", 1, "uint", "r"),
    "rg16uint": _format("<u2", 2, "uint", "r"),
    "rgba16uint": _format("<u2", 4, "uint", "sr"),
    "r16float": _format("<f2", 1, "float", "r"),
    "rg16float": _format("<f2", 2, "float", "r"),
    "rgba16float": _format("<f2", 4, "float", "sr"),
    "r32float": _format("<f4", 1, "unfilterable-float", "sr"),
    "rg32float": _format("<f4", 2, "unfilterable-float", "sr"),
    "rgba32float": _format("<f4", 4, "unfilterable-float", "sr"),
    "r32uint": _format("<u4", 1, "uint", "sr"),
    "rg32uint": _format("<u4", 2, "uint", "sr"),
    "rgba32uint": _format("<u4", 4, "uint", "sr"),
    "r32sint": _format("<i4", 1, "sint", "sr"),
    "rgb10a2unorm": _format("<u4", 1, "float", "r"),
    "rg11b10ufloat": _format("<u4", 1, "float", ""),
    "rgb9e5ufloat": _format("<u4", 1, "float", ""),
    "depth32float": _format("<f4", 1, "depth", "r"),
}


def lookup(name: str) -> Format:
    """The format of that name. Raises ValueError listing those that there are."""
    if name not in FORMATS:
        raise ValueError(f"no texture format {name!r}; there are {', '.join(FORMATS)}")
    return FORMATS[name]
