"""Opening a GPU: which one, with what, and what the message says when there is none."""

from __future__ import annotations

import os
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import wgpu

from runtime import device
from runtime.device import ALIGNMENTS, LIMITS, OPTIONAL_FEATURES, NoAdapter, open_device
from runtime.resources import Buffer


def fake_adapter(name, kind, backend="Vulkan", **limits):
    info = {"adapter_type": kind, "backend_type": backend}
    return SimpleNamespace(
        summary=f"{name} ({kind}) via {backend}", info=info, limits={**LIMITS, **limits}, features=set()
    )


def test_a_device_has_what_was_asked_for(gpu):
    assert {name: gpu.limits[name] for name in LIMITS} == LIMITS
    assert {name: gpu.limits[name] for name in ALIGNMENTS} == ALIGNMENTS
    assert gpu.features <= set(OPTIONAL_FEATURES)
    assert gpu.features <= set(gpu.wgpu_device.features)
    assert gpu.adapter_summary in device.adapter_summaries()
    assert gpu.is_software == ("CPU" in gpu.adapter_summary)


def test_limits_hold(gpu):
    """A workgroup that this adapter may well run, but a portable one may not, is refused."""
    code = "@compute @workgroup_size(257)\nfn main() {}\n"
    module = gpu.wgpu_device.create_shader_module(code=code)
    with pytest.raises(wgpu.GPUValidationError):
        gpu.wgpu_device.create_compute_pipeline(
            layout="auto", compute={"module": module, "entry_point": "main"}
        )


def test_the_best_adapter_is_chosen(monkeypatch):
    software = fake_adapter("llvmpipe", "CPU")
    integrated = fake_adapter("UHD", "IntegratedGPU")
    discrete = fake_adapter("H200", "DiscreteGPU")
    old = fake_adapter("H200", "DiscreteGPU", "OpenGL")
    monkeypatch.setattr(
        device.wgpu.gpu, "enumerate_adapters_sync", lambda: [old, software, integrated, discrete]
    )
    assert device._choose("") is discrete
    assert device._choose("LLVM") is software
    assert device._choose("uhd") is integrated
    monkeypatch.setattr(device.wgpu.gpu, "enumerate_adapters_sync", lambda: [old, software])
    assert device._choose("") is software


def test_opengl_alone_is_refused_with_the_remedy(monkeypatch):
    """It would open, and fail at the first kernel that loads from a depth texture."""
    old = fake_adapter("llvmpipe", "CPU", "OpenGL")
    monkeypatch.setattr(device.wgpu.gpu, "enumerate_adapters_sync", lambda: [old])
    with pytest.raises(NoAdapter, match=r"(?s)llvmpipe .* OpenGL.*apt-get install mesa-vulkan-drivers"):
        open_device()
    assert device.adapter_summaries() == []


def test_without_an_adapter_the_message_names_the_remedy(monkeypatch):
    monkeypatch.setattr(device.wgpu.gpu, "enumerate_adapters_sync", list)
    with pytest.raises(NoAdapter, match="apt-get install mesa-vulkan-drivers"):
        open_device()


def test_an_unknown_name_lists_the_adapters(gpu, monkeypatch):
    with pytest.raises(NoAdapter) as error:
        open_device("no such card")
    assert gpu.adapter_summary in str(error.value)
    monkeypatch.setenv("SDFPRIM_ADAPTER", "nor this one")
    with pytest.raises(NoAdapter, match="nor this one"):
        open_device()


def test_a_small_adapter_is_refused(monkeypatch):
    small = fake_adapter("Tiny", "DiscreteGPU", **{"max-bind-groups": 2})
    monkeypatch.setattr(device.wgpu.gpu, "enumerate_adapters_sync", lambda: [small])
    with pytest.raises(NoAdapter, match=r"Tiny .* is too small: max-bind-groups is 2, 4 needed"):
        open_device()


def test_opening_is_quiet_without_a_runtime_folder(gpu):
    """The Vulkan loader complains on stderr when XDG_RUNTIME_DIR is unset."""
    environment = {name: value for name, value in os.environ.items() if name != "XDG_RUNTIME_DIR"}
    code = "from runtime.device import open_device; print(open_device().adapter_summary)"
    result = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert result.stderr == ""
    assert result.stdout.strip() == gpu.adapter_summary


def test_waiting_waits(gpu):
    buffer = Buffer(gpu, np.arange(4, dtype=np.uint32))
    gpu.synchronize()
    assert buffer.read().tolist() == [0, 1, 2, 3]
