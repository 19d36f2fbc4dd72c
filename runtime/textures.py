"""Material textures on the GPU: mipmaps averaged in linear light, one sampler for each way of wrapping."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fit.scene import Scene, Texture, TextureUse, Wrap
from runtime import resources
from runtime.device import Gpu
from runtime.images import area_resample
from runtime.resources import Sampler
from runtime.twins.color import color_linear_from_srgb, color_srgb_from_linear

UInt8 = NDArray[np.uint8]

ADDRESS = {Wrap.REPEAT: "repeat", Wrap.MIRROR: "mirror-repeat", Wrap.CLAMP: "clamp-to-edge"}

_LINEAR_FROM_BYTE = color_linear_from_srgb(np.arange(256) / 255).astype(np.float32)


class TextureLibrary:
    """Uploads a scene's textures on demand, each image once for each colour space, and hands out samplers."""

    def __init__(self, gpu: Gpu, scene: Scene, max_size: int) -> None:
        self._gpu = gpu
        self._scene = scene
        self._max_size = max_size
        self._textures: dict[tuple[int, bool], resources.Texture] = {}
        self._samplers: dict[tuple[Wrap, Wrap, bool], Sampler] = {}
        self._white = resources.Texture(
            gpu, (1, 1), "rgba8unorm", "sample", data=np.full((1, 1, 4), 255, np.uint8), label="white"
        )
        self._halved: dict[int, tuple[int, int]] = {}

    def get(self, use: TextureUse | None, *, srgb: bool) -> tuple[resources.Texture, Sampler]:
        """The texture and sampler of a use; a white texel for none."""
        if use is None:
            return self._white, self._sampler(Texture(-1))
        texture = self._scene.textures[use.texture]
        key = (texture.image, srgb)
        if key not in self._textures:
            self._textures[key] = self._upload(texture.image, srgb)
        return self._textures[key], self._sampler(texture)

    @property
    def notes(self) -> tuple[str, ...]:
        """Which images were too large."""
        if not self._halved:
            return ()
        width, height = max(self._halved.values(), key=max)
        return (
            f"{len(self._halved)} images are halved until they fit into {self._max_size} texels a side; "
            f"the largest has {width} x {height}",
        )

    @property
    def bytes(self) -> int:
        """Memory of all uploaded textures, mipmaps included."""
        return sum(
            4 * int(np.prod(texture.mip_size(mip)))
            for texture in self._textures.values()
            for mip in range(texture.mips)
        )

    def _upload(self, image: int, srgb: bool) -> resources.Texture:
        source = self._scene.images[image]
        levels = mipmaps(source.pixels, srgb)
        while max(levels[0].shape[:2]) > self._max_size and len(levels) > 1:
            levels.pop(0)
        (height, width), (full_height, full_width) = levels[0].shape[:2], source.pixels.shape[:2]
        if (width, height) != (full_width, full_height):
            self._halved[image] = (full_width, full_height)
        texture = resources.Texture(
            self._gpu,
            (width, height),
            "rgba8unorm-srgb" if srgb else "rgba8unorm",
            "sample",
            mips=len(levels),
            label=source.name,
        )
        for mip, level in enumerate(levels):
            texture.write(level, mip)
        return texture

    def _sampler(self, texture: Texture) -> Sampler:
        key = (texture.wrap_u, texture.wrap_v, texture.linear)
        if key not in self._samplers:
            self._samplers[key] = Sampler(
                self._gpu,
                "linear" if texture.linear else "nearest",
                (ADDRESS[texture.wrap_u], ADDRESS[texture.wrap_v]),
                mip_filter="linear",
            )
        return self._samplers[key]


def mipmaps(pixels: UInt8, srgb: bool) -> list[UInt8]:
    """The image (height, width, 4) and its halvings down to one texel.

    Colour is averaged in linear light, each level from the unrounded one above; alpha is averaged as it is.
    """
    levels = [np.ascontiguousarray(pixels)]
    exact = _decode(pixels, srgb)
    while max(exact.shape[:2]) > 1:
        exact = _halve(exact)
        levels.append(_encode(exact, srgb))
    return levels


def _halve(values: NDArray[np.float32]) -> NDArray[np.float32]:
    for axis in (0, 1):
        size = values.shape[axis]
        if size > 1 and size % 2 == 0:
            pairs = values.reshape(*values.shape[:axis], size // 2, 2, *values.shape[axis + 1 :])
            values = pairs.mean(axis=axis + 1, dtype=np.float32)
        elif size > 1:
            values = area_resample(values, axis, size // 2).astype(np.float32)
    return values


def _decode(pixels: UInt8, srgb: bool) -> NDArray[np.float32]:
    values = pixels.astype(np.float32) / np.float32(255)
    if srgb:
        values[..., :3] = _LINEAR_FROM_BYTE[pixels[..., :3]]
    return values


def _encode(values: NDArray[np.float32], srgb: bool) -> UInt8:
    coded = values.copy()
    if srgb:
        coded[..., :3] = color_srgb_from_linear(values[..., :3])
    return np.floor(coded * 255 + 0.5).astype(np.uint8)
