"""What kernels bind: buffers, textures, samplers, and pairs that change roles from frame to frame."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np
import wgpu

from runtime import formats
from runtime.device import Gpu

_uids = itertools.count(1)

BUFFER_USAGES = {
    "storage": wgpu.BufferUsage.STORAGE,
    "uniform": wgpu.BufferUsage.UNIFORM,
    "vertex": wgpu.BufferUsage.VERTEX,
    "index": wgpu.BufferUsage.INDEX,
    "indirect": wgpu.BufferUsage.INDIRECT,
}
TEXTURE_USAGES = {
    "sample": wgpu.TextureUsage.TEXTURE_BINDING,
    "storage": wgpu.TextureUsage.STORAGE_BINDING,
    "render": wgpu.TextureUsage.RENDER_ATTACHMENT,
}
ROW_ALIGNMENT = 256  # of texture rows in a buffer, by WebGPU


def _flags(table: dict[str, Any], usage: str, what: str) -> Any:
    flags = 0
    for word in usage.replace("|", " ").split():
        if word not in table:
            raise ValueError(f"{what}: no usage {word!r}; there are {', '.join(table)}")
        flags |= table[word]
    return flags


def _as_bytes(data: Any) -> np.ndarray:
    if isinstance(data, bytes | bytearray | memoryview):
        return np.frombuffer(data, np.uint8)
    return np.ascontiguousarray(data).reshape(-1).view(np.uint8)


class Buffer:
    """A buffer of `data` bytes (an int) or with `data`'s contents (an array, a packed struct, bytes).

    `usage`: words of storage, uniform, vertex, index, indirect, joined by `|`; copying is always allowed.
    Sizes are rounded up to 4 bytes (16 for uniforms); the padding is zero. Raises ValueError for an empty
    buffer, because it could not be bound.
    """

    def __init__(self, gpu: Gpu, data: Any, usage: str = "storage", *, label: str = "") -> None:
        contents = None if isinstance(data, int | np.integer) else _as_bytes(data)
        wanted = int(data) if contents is None else len(contents)
        if wanted <= 0:
            raise ValueError(
                f"buffer {label!r}: {wanted} bytes; an empty buffer cannot be bound, make room for one"
            )
        self.gpu = gpu
        self.uid = next(_uids)
        self.label = label
        self.usage = _flags(BUFFER_USAGES, usage, f"buffer {label!r}")
        step = 16 if self.usage & wgpu.BufferUsage.UNIFORM else 4
        self.size = -(-wanted // step) * step
        self.dtype = data.dtype if isinstance(data, np.ndarray | np.generic) else None
        self.shape = data.shape if isinstance(data, np.ndarray | np.generic) else None
        copying = wgpu.BufferUsage.COPY_SRC | wgpu.BufferUsage.COPY_DST
        self.wgpu_buffer = gpu.wgpu_device.create_buffer(
            size=self.size, usage=self.usage | copying, label=label
        )
        if contents is not None:
            self.write(contents)

    @cached_property
    def binding(self) -> dict[str, Any]:
        return {"buffer": self.wgpu_buffer, "offset": 0, "size": self.size}

    def write(self, data: Any, offset: int = 0) -> None:
        """Replaces the bytes from `offset` on (a multiple of 4). Raises ValueError past the end."""
        contents = _as_bytes(data)
        if offset % 4 or offset < 0 or offset + len(contents) > self.size:
            raise ValueError(
                f"buffer {self.label!r}: {len(contents)} bytes at {offset} do not fit into {self.size}"
            )
        padded = np.pad(contents, (0, -len(contents) % 4)) if len(contents) % 4 else contents
        if len(padded):
            self.gpu.queue.write_buffer(self.wgpu_buffer, offset, padded)

    def read(
        self, dtype: Any = None, shape: int | Sequence[int] | None = None, *, offset: int = 0
    ) -> np.ndarray:
        """The contents once all submitted work is done.

        By default with the type and shape of the array that the buffer was made from, else all of it as
        uint8. Raises ValueError past the end.
        """
        if dtype is None:
            dtype = np.uint8 if self.dtype is None else self.dtype
            shape = self.shape if shape is None else shape
        dtype = np.dtype(dtype)
        available = (self.size - offset) // dtype.itemsize
        dimensions = (available,) if shape is None else (shape,) if isinstance(shape, int) else tuple(shape)
        count = int(np.prod(dimensions, dtype=np.int64))
        if count > available:
            raise ValueError(
                f"buffer {self.label!r}: {count} x {dtype.itemsize} bytes at {offset} exceed {self.size}"
            )
        if count == 0:
            return np.zeros(dimensions, dtype)
        size = -(-count * dtype.itemsize // 4) * 4
        data = self.gpu.queue.read_buffer(self.wgpu_buffer, offset, size)
        flat: np.ndarray = np.frombuffer(data, np.uint8, count * dtype.itemsize).copy()
        return flat.view(dtype).reshape(dimensions)


@dataclass(frozen=True, eq=False)
class TextureView:
    """Some mips or layers of a texture; binds and renders like one."""

    uid: int
    binding: Any
    format: str
    dimension: str
    size: tuple[int, int, int]
    usage: int
    label: str


class Texture:
    """A texture of `size` (width, height[, depth or layers]) texels.

    `dimension`: 2d, 3d, 2d-array or cube; by default 2d for a size of two numbers and 3d for three.
    `usage`: words of sample, storage, render, joined by `|`; by default all that the format allows.
    `data` fills mip 0.

    Arrays are (height, width, channels) or (depth or layers, height, width, channels), of the format's own
    type (rgba16float: float16); formats of one channel have no channel axis.
    """

    def __init__(
        self,
        gpu: Gpu,
        size: Sequence[int],
        format: str,
        usage: str | None = None,
        *,
        dimension: str | None = None,
        mips: int = 1,
        data: Any = None,
        label: str = "",
    ) -> None:
        self.gpu = gpu
        self.uid = next(_uids)
        self.label = label
        self.format = format
        self.texel = formats.lookup(format)
        width, height, depth = [*(int(length) for length in size), 1][:3]
        self.size = (width, height, depth)
        self.dimension = dimension or ("2d" if len(size) == 2 else "3d")
        self.mips = mips
        if min(self.size) < 1 or self.dimension not in ("2d", "3d", "2d-array", "cube"):
            raise ValueError(f"texture {label!r}: no {self.dimension} texture has size {tuple(size)}")
        self.usage = _flags(
            TEXTURE_USAGES, self._default_usage() if usage is None else usage, f"texture {label!r}"
        )
        self.wgpu_texture = gpu.wgpu_device.create_texture(
            size=self.size,
            format=format,
            dimension="3d" if self.dimension == "3d" else "2d",
            mip_level_count=mips,
            usage=self.usage | wgpu.TextureUsage.COPY_SRC | wgpu.TextureUsage.COPY_DST,
            label=label,
        )
        self._views: dict[tuple[int | None, int | None], TextureView] = {}
        if data is not None:
            self.write(data)

    def _default_usage(self) -> str:
        words = ["sample"]
        words += ["storage"] * (self.texel.storage and self.dimension != "cube")
        words += ["render"] * (self.texel.renderable and self.dimension != "3d")
        return "|".join(words)

    @property
    def binding(self) -> Any:
        return self.view().binding

    def view(self, mip: int | None = None, layer: int | None = None) -> TextureView:
        """The whole texture, or one mip, or one layer of an array as a 2D texture; the same each time."""
        key = (mip, layer)
        if key not in self._views:
            dimension = self.dimension if layer is None else "2d"
            view = self.wgpu_texture.create_view(
                dimension=dimension,
                base_mip_level=mip or 0,
                mip_level_count=self.mips if mip is None else 1,
                base_array_layer=layer or 0,
                array_layer_count=1 if layer is not None or self.dimension == "3d" else self.size[2],
                label=self.label,
            )
            size = self.mip_size(mip or 0)
            self._views[key] = TextureView(
                next(_uids), view, self.format, dimension, size, self.usage, self.label
            )
        return self._views[key]

    def mip_size(self, mip: int) -> tuple[int, int, int]:
        """(width, height, depth or layers) of a mip level."""
        width, height, depth = self.size
        return (
            max(width >> mip, 1),
            max(height >> mip, 1),
            max(depth >> mip, 1) if self.dimension == "3d" else depth,
        )

    def _array_shape(self, mip: int) -> tuple[int, ...]:
        width, height, depth = self.mip_size(mip)
        leading = (height, width) if self.dimension == "2d" else (depth, height, width)
        return leading + ((self.texel.channels,) if self.texel.channels > 1 else ())

    def write(self, data: Any, mip: int = 0) -> None:
        """Replaces a mip level. Raises ValueError when the array's shape or type does not fit."""
        values = np.asarray(data)
        shape = self._array_shape(mip)
        if values.shape != shape:
            raise ValueError(f"texture {self.label!r}: mip {mip} takes shape {shape}, not {values.shape}")
        if values.dtype.kind != self.texel.dtype.kind:
            raise ValueError(
                f"texture {self.label!r}: {self.format} takes {self.texel.dtype}, not {values.dtype}"
            )
        if self.format == "depth32float":
            raise ValueError(
                f"texture {self.label!r}: WebGPU lets nobody write depth32float but a render pass"
            )
        width, height, depth = self.mip_size(mip)
        self.gpu.queue.write_texture(
            {"texture": self.wgpu_texture, "mip_level": mip, "origin": (0, 0, 0)},
            np.ascontiguousarray(values, self.texel.dtype),
            {"offset": 0, "bytes_per_row": width * self.texel.texel_bytes, "rows_per_image": height},
            (width, height, depth),
        )

    def read(self, mip: int = 0) -> np.ndarray:
        """A mip level once all submitted work is done."""
        width, height, depth = self.mip_size(mip)
        row = width * self.texel.texel_bytes
        pitch = -(-row // ROW_ALIGNMENT) * ROW_ALIGNMENT
        usage = wgpu.BufferUsage.COPY_DST | wgpu.BufferUsage.COPY_SRC
        staging = self.gpu.wgpu_device.create_buffer(
            size=pitch * height * depth, usage=usage, label="read texture"
        )
        encoder = self.gpu.wgpu_device.create_command_encoder(label="read texture")
        encoder.copy_texture_to_buffer(
            {"texture": self.wgpu_texture, "mip_level": mip, "origin": (0, 0, 0)},
            {"buffer": staging, "offset": 0, "bytes_per_row": pitch, "rows_per_image": height},
            (width, height, depth),
        )
        self.gpu.queue.submit([encoder.finish()])
        rows = np.frombuffer(self.gpu.queue.read_buffer(staging), np.uint8).reshape(depth, height, pitch)
        return np.ascontiguousarray(rows[:, :, :row]).view(self.texel.dtype).reshape(self._array_shape(mip))


class Sampler:
    """How a texture is filtered (linear, nearest) and continued past its edges.

    `address` (clamp-to-edge, repeat, mirror-repeat) is one for all axes or one for each. `compare` (less,
    less-equal, greater ...) makes a `sampler_comparison`.
    """

    def __init__(
        self,
        gpu: Gpu,
        filter: str = "linear",
        address: str | Sequence[str] = "clamp-to-edge",
        *,
        mip_filter: str | None = None,
        compare: str | None = None,
        anisotropy: int = 1,
        label: str = "",
    ) -> None:
        axes = (address,) * 3 if isinstance(address, str) else (*address, "clamp-to-edge")[:3]
        self.uid = next(_uids)
        self.label = label
        self.is_comparison = compare is not None
        self.binding = gpu.wgpu_device.create_sampler(
            mag_filter=filter,
            min_filter=filter,
            mipmap_filter=mip_filter or filter,
            address_mode_u=axes[0],
            address_mode_v=axes[1],
            address_mode_w=axes[2],
            compare=compare,
            max_anisotropy=anisotropy,
            label=label,
        )


T = TypeVar("T")


class PingPong(Generic[T]):
    """A history pair: a frame writes `current` and reads `previous`; `swap` ends the frame."""

    def __init__(self, first: T, second: T) -> None:
        self._pair = (first, second)

    @property
    def current(self) -> T:
        return self._pair[0]

    @property
    def previous(self) -> T:
        return self._pair[1]

    def swap(self) -> None:
        self._pair = (self._pair[1], self._pair[0])
