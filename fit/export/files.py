"""What every format shares: the error that names the place, and writes that never leave half a file."""

from __future__ import annotations

import os
from pathlib import Path


class FormatError(ValueError):
    """A file that can't be read or written, as "file: place: what is wrong; remedy"."""

    def __init__(self, path: Path | str, place: str, problem: str) -> None:
        super().__init__(f"{path}: {place}: {problem}")


def write_atomically(path: Path, content: bytes) -> None:
    """Write `content` beside `path`, then put it in its place, so that a reader never sees half of it."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(content)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
