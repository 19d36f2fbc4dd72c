"""Runs one job in a process of its own, so that a crash, a hang or a full memory costs that job only."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from pipelines.machine import peak_rss_mb

Progress = Callable[[str, float], None]
"""Called with the name of the stage at work and the share of it that is done."""

Job = Callable[..., Any]
"""A module-level function called as `job(*arguments, progress=...)`; its result must be picklable."""

POLL_SECONDS = 0.2


@dataclass(frozen=True)
class Outcome:
    """How a job ended: `result`, or `error` in words; seconds of wall clock, and peak memory in MiB."""

    result: Any
    error: str | None
    seconds: float
    peak_rss_mb: float | None


def run_isolated(job: Job, *arguments: Any, timeout: float, progress: Progress | None = None) -> Outcome:
    """Calls `job(*arguments, progress=...)` in a spawned process and waits for it, at most `timeout` seconds.

    An interrupt in this process ends the worker and is raised again.
    """
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(sender, job, arguments), daemon=True)
    started = time.monotonic()
    process.start()
    sender.close()
    try:
        return _listen(process, receiver, started, timeout, progress)
    finally:
        _end(process)
        receiver.close()


def _listen(
    process: Any, receiver: Connection, started: float, timeout: float, progress: Progress | None
) -> Outcome:
    stage, memory = "start", None
    while (elapsed := time.monotonic() - started) < timeout:
        memory = peak_rss_mb(process.pid) or memory
        if not receiver.poll(min(POLL_SECONDS, timeout - elapsed)):
            continue
        try:
            message, *content = receiver.recv()
        except EOFError:
            process.join(5)
            return Outcome(None, _cause_of_death(process.exitcode, stage), time.monotonic() - started, memory)
        if message == "stage":
            stage = content[0]
            if progress:
                progress(*content)
            continue
        result, error, peak = content
        return Outcome(result, error, time.monotonic() - started, peak or memory)
    error = f"stopped after {timeout:g} s in stage '{stage}'; --timeout SECONDS gives it longer"
    return Outcome(None, error, time.monotonic() - started, memory)


def _cause_of_death(exit_code: int | None, stage: str) -> str:
    if exit_code is not None and exit_code < 0:
        number = -exit_code
        name = signal.Signals(number).name if number in set(signal.Signals) else f"signal {number}"
        hint = " (out of memory?)" if name == "SIGKILL" else ""
        return f"the worker process died of {name}{hint} in stage '{stage}'"
    return f"the worker process ended with exit code {exit_code} in stage '{stage}'"


def _end(process: Any) -> None:
    if process.is_alive():
        process.terminate()
        process.join(2)
    if process.is_alive():
        process.kill()
    process.join()
    process.close()


def _serve(sender: Connection, job: Job, arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides when an interrupt ends this process
    _silence_stdout()

    def progress(stage: str, fraction: float) -> None:
        sender.send(("stage", stage, fraction))

    result, error = None, None
    try:
        result = job(*arguments, progress=progress)
    except MemoryError:
        error = "out of memory"
    except Exception as caught:
        error = describe_error(caught)
    with contextlib.suppress(BrokenPipeError):
        sender.send(("done", result, error, peak_rss_mb()))


def _silence_stdout() -> None:
    """Native libraries print where they please; stdout belongs to the command, so theirs goes to stderr."""
    sys.stdout.flush()
    os.dup2(2, 1)


def describe_error(error: Exception) -> str:
    """The message of bad input; where it may be a fault, with the place in the code and the error's kind."""
    frame = error.__traceback__
    while frame is not None and frame.tb_next is not None:
        frame = frame.tb_next
    place = f"{os.path.basename(frame.tb_frame.f_code.co_filename)}:{frame.tb_lineno}" if frame else "?"
    if isinstance(error, ValueError | OSError) and str(error):
        return f"{error} ({place})" if type(error) is ValueError else str(error)
    return f"{type(error).__name__}: {error} ({place})"
