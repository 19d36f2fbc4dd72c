"""GPU time by pass."""

from __future__ import annotations

import numpy as np
import pytest

from runtime import timing
from runtime.encoder import Recorder
from runtime.kernel import Kernel
from runtime.resources import Buffer, Texture
from runtime.timing import Timer

SPIN = """
@group(0) @binding(0) var<storage, read_write> out: array<f32>;
override TURNS: u32 = 1;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    var x = f32(id.x);
    for (var i = 0u; i < TURNS; i++) { x = sin(x + f32(i)); }
    out[id.x] = x;
}
"""


@pytest.fixture
def timer(gpu):
    if "timestamp-query" not in gpu.features:
        pytest.skip("this adapter has no timestamp queries")
    return Timer(gpu)


def test_longer_work_takes_longer(gpu, shaders, timer):
    root = shaders({"spin": SPIN})
    out = Buffer(gpu, np.zeros(4096, np.float32))
    kernels = {
        label: Kernel(gpu, "spin", constants={"TURNS": turns}, root=root)
        for label, turns in (("short", 10), ("long", 20_000))
    }
    runs = []
    for _ in range(4):  # a software driver compiles in the first one
        recorder = Recorder(gpu, timer)
        for label, kernel in kernels.items():
            with recorder.compute(label) as compute_pass:
                kernel.dispatch(compute_pass, kernel.groups_for(4096), out=out)
        recorder.submit()
        runs.append(timer.results())
    assert list(runs[0]) == ["short", "long"]
    short, long = (min(run[label] for run in runs[1:]) for label in ("short", "long"))
    assert 0 < short < long < 60_000


def test_passes_of_one_label_are_added_up(gpu, timer):
    target = Texture(gpu, (512, 512), "rgba16float")

    def clear(count):
        recorder = Recorder(gpu, timer)
        for _ in range(count):
            with recorder.render("clear", [target]):
                pass
        recorder.submit()
        return timer.results()

    clear(2)
    assert list(clear(1)) == ["clear"]
    assert min(clear(12)["clear"] for _ in range(5)) > min(clear(1)["clear"] for _ in range(5))
    assert timer.results() == {}


def test_results_that_nobody_reads_are_forgotten(gpu, timer, monkeypatch):
    monkeypatch.setattr(timing, "MAX_PASSES", 3)
    recorder = Recorder(gpu, timer)
    for label in "abcde":
        with recorder.compute(label):
            pass
    recorder.submit()
    assert list(timer.results()) == ["d", "e"]


def test_without_timestamps_each_pass_has_none(gpu, monkeypatch):
    monkeypatch.setattr(gpu, "features", frozenset())
    recorder = Recorder(gpu)
    target = Texture(gpu, (2, 2), "rgba16float")
    with recorder.compute("first"):
        pass
    with recorder.render("second", [target]):
        pass
    recorder.submit()
    assert recorder.timer.results() == {"first": None, "second": None}


def test_a_pass_ends_when_its_block_fails(gpu):
    recorder = Recorder(gpu)
    with pytest.raises(ZeroDivisionError), recorder.compute("broken"):
        raise ZeroDivisionError
    with recorder.compute("next"):
        pass
    recorder.submit()
    assert list(recorder.timer.results()) == ["broken", "next"]
