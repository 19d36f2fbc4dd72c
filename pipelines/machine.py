"""What a report says about the machine, and how much memory a process took."""

from __future__ import annotations

import os
import platform
import sys
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

MEBIBYTE = 1 << 20

LIBRARIES = ("numpy", "scipy", "nlopt", "manifold3d", "trimesh", "wgpu", "coacd", "vhacdx", "mitsuba")
"""Those whose version can change a result; the last three are optional."""


def package_version() -> str:
    """Version of the installed package; a checkout that is not installed says so."""
    try:
        return metadata.version("sdfprim")
    except metadata.PackageNotFoundError:
        return "0+uninstalled"


@cache
def describe_machine() -> dict[str, Any]:
    """Operating system, processor, memory, Python, the numerical libraries' versions and the GPU adapters."""
    return {
        "system": platform.platform(),
        "processor": _processor_name(),
        "cores": os.cpu_count(),
        "memory_mb": _total_memory_mb(),
        "python": platform.python_version(),
        "libraries": {name: _library_version(name) for name in LIBRARIES},
        "adapters": _adapters(),
    }


def peak_rss_mb(process_id: int | None = None) -> float | None:
    """Largest resident memory so far of a process (this one by default), MiB; None where it can't be read.

    Linux reads VmHWM, which unlike getrusage does not start at the size of the process that forked this one.
    """
    status = Path(f"/proc/{process_id or os.getpid()}/status")
    try:
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return round(int(line.split()[1]) / 1024, 1)
    except (OSError, ValueError):
        pass
    if process_id is not None:
        return None
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / MEBIBYTE if sys.platform == "darwin" else peak / 1024, 1)


def _library_version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _processor_name() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def _total_memory_mb() -> int | None:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // MEBIBYTE
    except (AttributeError, OSError, ValueError):
        return None


def _adapters() -> list[str]:
    from runtime.device import adapter_summaries

    try:
        return adapter_summaries()
    except Exception as error:  # a broken driver must not cost anyone a report
        return [f"could not be listed: {error}"]
