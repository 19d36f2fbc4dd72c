"""Mitsuba, loaded once, in the fastest variant that works on this machine."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

VARIANT = "SDFPRIM_MITSUBA_VARIANT"
"""Environment variable that names a variant, such as scalar_rgb, and so skips the search."""

LLVM_PATH = "DRJIT_LIBLLVM_PATH"
"""Environment variable by which Dr.Jit finds LLVM."""

LLVM_VERSIONS = range(22, 15, -1)
"""Versions looked for, newest first: LLVM 15 of Debian 12 aborts the process that compiles with it."""

_LIBRARY_FOLDERS = ("/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib64", "/usr/lib")

_PROBE = "import mitsuba as m; m.set_variant('llvm_ad_rgb'); import drjit as d; print(d.sum(m.Float([1, 2])))"


class MissingMitsuba(ValueError):
    """Mitsuba is not installed; the message says how to mend that."""


@cache
def load_mitsuba() -> Any:
    """The module `mitsuba` with its variant set: `llvm_ad_rgb` where LLVM works, else `scalar_rgb`.

    Raises:
        MissingMitsuba: it is not installed.
    """
    try:
        import mitsuba
    except ImportError:
        raise MissingMitsuba(
            "the reference needs Mitsuba 3: pip install 'sdfprim[reference]' (or pip install mitsuba)"
        ) from None
    mitsuba.set_variant(os.environ.get(VARIANT) or _best_variant())
    from pipelines.reference import centres, points

    points.register(mitsuba)
    centres.register(mitsuba)
    return mitsuba


def is_vectorized(mi: Any) -> bool:
    """Whether the variant works on arrays of rays, and not on one ray at a time."""
    return not mi.variant().startswith("scalar")


def engine_notes(mi: Any) -> tuple[str, ...]:
    """How to make Mitsuba faster, where it is slow for want of a library."""
    if is_vectorized(mi):
        return ()
    oldest, newest = min(LLVM_VERSIONS), max(LLVM_VERSIONS)
    return (
        f"Mitsuba runs as {mi.variant()}, many times slower than it could: install LLVM {oldest} to {newest} "
        f"(on Debian and Ubuntu: apt-get install libllvm19), or name its library in {LLVM_PATH}",
    )


def _best_variant() -> str:
    """Tried in a process of its own: an LLVM that does not suit aborts the one that loads it."""
    if LLVM_PATH not in os.environ and (library := _find_llvm()):
        os.environ[LLVM_PATH] = library
    if LLVM_PATH not in os.environ:
        return "scalar_rgb"
    probe = subprocess.run([sys.executable, "-c", _PROBE], capture_output=True, timeout=60, check=False)
    return "llvm_ad_rgb" if probe.returncode == 0 and b"3" in probe.stdout else "scalar_rgb"


def _find_llvm() -> str | None:
    for version in LLVM_VERSIONS:
        for name in (f"libLLVM-{version}.so", f"libLLVM.so.{version}.1", f"libLLVM-{version}.so.1"):
            for folder in _LIBRARY_FOLDERS:
                path = Path(folder) / name
                if path.exists() and _loads(path):
                    return str(path)
    return None


def _loads(path: Path) -> bool:
    try:
        ctypes.CDLL(str(path))
    except OSError:
        return False
    return True
