"""Opens a GPU: chooses the adapter, asks for the features and limits that kernels rely on, checks them."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass, field
from typing import Any

# The Vulkan loader and EGL print warnings without it; it must be set before the driver is loaded.
if os.name == "posix" and not os.environ.get("XDG_RUNTIME_DIR"):
    os.environ["XDG_RUNTIME_DIR"] = tempfile.gettempdir()

import wgpu

from runtime.bindgroups import BindGroups

ADAPTER_VARIABLE = "SDFPRIM_ADAPTER"

# The defaults of WebGPU, except as noted, so that what runs here runs everywhere: wgpu-py would otherwise
# grant all that the adapter has, and hide a kernel that asks for too much.
LIMITS = {
    "max-texture-dimension-1d": 8192,
    "max-texture-dimension-2d": 8192,
    "max-texture-dimension-3d": 2048,
    "max-texture-array-layers": 256,
    "max-bind-groups": 4,
    "max-bindings-per-bind-group": 1000,
    "max-sampled-textures-per-shader-stage": 16,
    "max-samplers-per-shader-stage": 16,
    "max-storage-buffers-per-shader-stage": 10,  # WebGPU: 8
    "max-storage-textures-per-shader-stage": 8,  # WebGPU: 4
    "max-uniform-buffers-per-shader-stage": 12,
    "max-uniform-buffer-binding-size": 64 << 10,
    "max-storage-buffer-binding-size": 128 << 20,
    "max-buffer-size": 256 << 20,
    "max-vertex-buffers": 8,
    "max-vertex-attributes": 16,
    "max-vertex-buffer-array-stride": 2048,
    "max-color-attachments": 8,
    "max-color-attachment-bytes-per-sample": 64,  # WebGPU: 32; the G-buffer needs more
    "max-compute-workgroup-storage-size": 16 << 10,
    "max-compute-invocations-per-workgroup": 256,
    "max-compute-workgroup-size-x": 256,
    "max-compute-workgroup-size-y": 256,
    "max-compute-workgroup-size-z": 64,
    "max-compute-workgroups-per-dimension": 65535,
}
ALIGNMENTS = {"min-uniform-buffer-offset-alignment": 256, "min-storage-buffer-offset-alignment": 256}
OPTIONAL_FEATURES = ("timestamp-query", "float32-filterable")

NO_ADAPTER = """no GPU adapter found.
Install a Vulkan driver: the graphics card's own, or the software one:
    Debian, Ubuntu: apt-get install mesa-vulkan-drivers
    Fedora:         dnf install mesa-vulkan-drivers"""


ONLY_OPENGL = """no usable GPU adapter found: {names} cannot translate all of our shaders to OpenGL.
Install a Vulkan driver""" + NO_ADAPTER.partition("Install a Vulkan driver")[2]


class NoAdapter(RuntimeError):
    """No usable GPU; the message says what to install."""


@dataclass
class Gpu:
    """An open device and its queue."""

    wgpu_device: Any
    adapter_summary: str
    is_software: bool
    features: frozenset[str]
    limits: dict[str, int]
    bind_groups: BindGroups = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.bind_groups = BindGroups(self.wgpu_device)

    @property
    def queue(self) -> Any:
        return self.wgpu_device.queue

    def synchronize(self) -> None:
        """Waits until everything submitted so far is done."""
        # wgpu-py 0.32: on_submitted_work_done_sync() raises TypeError; reading four bytes waits as well.
        usage = wgpu.BufferUsage.COPY_SRC | wgpu.BufferUsage.COPY_DST
        self.queue.read_buffer(self.wgpu_device.create_buffer(size=4, usage=usage, label="synchronize"))


def open_device(adapter: str | None = None) -> Gpu:
    """Opens the best adapter: discrete before integrated before software. OpenGL is no choice: wgpu refuses
    what it cannot say in GLSL, such as loads from depth textures, and only when a kernel is made.

    `adapter` (or else the environment variable SDFPRIM_ADAPTER) is a part of the adapter's name, in any case.
    Raises NoAdapter when there is none, with the remedy or the names of those that there are, and when the
    adapter is too small.
    """
    chosen = _choose(adapter or os.environ.get(ADAPTER_VARIABLE) or "")
    _check_limits(chosen.summary, chosen.limits)
    features = [feature for feature in OPTIONAL_FEATURES if feature in chosen.features]
    device = chosen.request_device_sync(
        label="sdfprim", required_features=features, required_limits={**LIMITS, **ALIGNMENTS}
    )
    missing = [feature for feature in features if feature not in device.features]
    if missing:
        raise NoAdapter(f"{chosen.summary} offers {', '.join(missing)} but does not grant it")
    _check_limits(chosen.summary, device.limits)
    return Gpu(
        device, chosen.summary, chosen.info["adapter_type"] == "CPU", frozenset(features), dict(device.limits)
    )


def adapter_summaries() -> list[str]:
    """One line for each usable adapter of this machine: name, kind and interface."""
    return [adapter.summary for adapter in _usable(wgpu.gpu.enumerate_adapters_sync())]


def _usable(adapters: list[Any]) -> list[Any]:
    return [adapter for adapter in adapters if "OpenGL" not in adapter.info["backend_type"]]


def _choose(name: str) -> Any:
    found = wgpu.gpu.enumerate_adapters_sync()
    adapters = _usable(found)
    if not adapters:
        names = ", ".join(adapter.summary for adapter in found)
        raise NoAdapter(ONLY_OPENGL.format(names=names) if found else NO_ADAPTER)
    matching = [adapter for adapter in adapters if name.lower() in adapter.summary.lower()]
    if not matching:
        there = "\n".join(f"    {summary}" for summary in adapter_summaries())
        raise NoAdapter(f"no GPU adapter is named like {name!r}; there are\n{there}")
    return min(matching, key=_rank)


def _rank(adapter: Any) -> int:
    kinds = ["DiscreteGPU", "IntegratedGPU", "Unknown", "CPU"]
    kind = adapter.info["adapter_type"]
    return kinds.index(kind) if kind in kinds else kinds.index("Unknown")


def _check_limits(summary: str, limits: dict[str, int]) -> None:
    short = [
        f"{name} is {limits[name]}, {need} needed" for name, need in LIMITS.items() if limits[name] < need
    ]
    if short:
        raise NoAdapter(f"{summary} is too small: {'; '.join(short)}")
