"""Isolation: whatever a job does to its process, the caller gets an outcome."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipelines.worker import run_isolated

# A spawned process finds its job by module name, which a test module run with importlib mode does not have.
JOBS = """
import os, signal, time
def work(number, progress):
    progress("halfway", 0.5)
    return number + 1
def fail(progress):
    raise FileNotFoundError("scene.bin is missing; put it beside scene.gltf")
def reject(progress):
    raise ValueError("nothing stops light")
def stumble(progress):
    return {}["missing"]
def crash(progress):
    progress("fit", 0.1)
    os.kill(os.getpid(), signal.SIGSEGV)
def leave(progress):
    os._exit(7)
def hang(progress):
    progress("build", 0.0)
    time.sleep(600)
def chatter(progress):
    os.write(1, b"native noise")
    return "done"
def hog(progress):
    block = bytearray(200 << 20)
    block[:: 4096] = b"x" * len(block[:: 4096])
    return None
"""


@pytest.fixture(scope="module")
def jobs(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("jobs")
    (folder / "isolated_jobs.py").write_text(JOBS)
    sys.path.insert(0, str(folder))
    import isolated_jobs

    yield isolated_jobs
    sys.path.remove(str(folder))
    del sys.modules["isolated_jobs"]


def test_result_and_progress(jobs: Any) -> None:
    seen: list[tuple[str, float]] = []
    outcome = run_isolated(jobs.work, 41, timeout=60, progress=lambda *state: seen.append(state))
    assert (outcome.result, outcome.error) == (42, None)
    assert seen == [("halfway", 0.5)]
    assert 0 < outcome.seconds < 60


def test_an_expected_error_is_its_message(jobs: Any) -> None:
    outcome = run_isolated(jobs.fail, timeout=60)
    assert outcome.error == "scene.bin is missing; put it beside scene.gltf"


def test_a_general_error_also_names_its_place(jobs: Any) -> None:
    outcome = run_isolated(jobs.reject, timeout=60)
    assert outcome.error == "nothing stops light (isolated_jobs.py:9)"


def test_a_fault_is_told_with_its_place(jobs: Any) -> None:
    outcome = run_isolated(jobs.stumble, timeout=60)
    assert outcome.error == "KeyError: 'missing' (isolated_jobs.py:11)"


def test_a_crash_names_signal_and_stage(jobs: Any) -> None:
    outcome = run_isolated(jobs.crash, timeout=60)
    assert outcome.error == "the worker process died of SIGSEGV in stage 'fit'"


def test_a_silent_exit_is_an_error(jobs: Any) -> None:
    outcome = run_isolated(jobs.leave, timeout=60)
    assert "exit code 7" in (outcome.error or "")


def test_a_hang_ends_at_the_limit(jobs: Any) -> None:
    began = time.monotonic()
    outcome = run_isolated(jobs.hang, timeout=4)
    assert time.monotonic() - began < 15
    assert "stopped after 4 s in stage 'build'" in (outcome.error or "")


def test_stdout_stays_clean(jobs: Any, capfd: pytest.CaptureFixture[str]) -> None:
    assert run_isolated(jobs.chatter, timeout=60).result == "done"
    captured = capfd.readouterr()
    assert captured.out == ""
    assert "native noise" in captured.err


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="peak memory is read from /proc")
def test_peak_memory_is_the_job_s_own(jobs: Any) -> None:
    ballast = np.ones(60 << 20, np.float32)  # 240 MiB in this process must not be counted
    small, large = run_isolated(jobs.work, 1, timeout=60), run_isolated(jobs.hog, timeout=60)
    assert ballast[-1] == 1
    assert small.peak_rss_mb is not None
    assert large.peak_rss_mb is not None
    assert small.peak_rss_mb < 150
    assert large.peak_rss_mb > small.peak_rss_mb + 190


@pytest.fixture
def interruptible() -> Iterator[None]:
    """SIGINT as in a terminal; a shell's background jobs ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_an_interrupt_ends_the_worker(jobs: Any, interruptible: None) -> None:
    def interrupt(stage: str, share: float) -> None:
        os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        run_isolated(jobs.hang, timeout=60, progress=interrupt)
