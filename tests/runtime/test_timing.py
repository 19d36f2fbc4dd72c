"""GPU time by pass."""

from __future__ import annotations

import pytest

from runtime import timing
from runtime.encoder import Recorder
from runtime.resources import Texture
from runtime.timing import Timer


@pytest.fixture
def timer(gpu):
    if "timestamp-query" not in gpu.features:
        pytest.skip("this adapter has no timestamp queries")
    return Timer(gpu)


def test_longer_work_takes_longer(gpu, timer):
    """Render passes: llvmpipe stamps the beginning of a compute pass when that has ended."""
    sizes = {"short": (4, 4), "long": (4096, 4096)}
    targets = {label: Texture(gpu, size, "rgba16float") for label, size in sizes.items()}
    runs = []
    for _ in range(5):
        recorder = Recorder(gpu, timer)
        for label, target in targets.items():
            with recorder.render(label, [target]):
                pass
        recorder.submit()
        runs.append(timer.results())
    assert list(runs[0]) == ["short", "long"]
    short, long = (min(run[label] for run in runs) for label in ("short", "long"))
    assert 0 < short < long / 4
    assert long < 60_000


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
