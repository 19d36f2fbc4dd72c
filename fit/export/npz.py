"""Primitive sets as .npz: the arrays of `PrimitiveSet` under their own names, to the last bit."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from fit.export.files import FormatError, write_atomically
from fit.primitives import PrimitiveSet

FORMAT, VERSION = "sdfprim", 1

ARRAYS = ("kinds", "positions", "rotations", "sizes", "albedo", "emission")

LARGEST_ARRAY = 1 << 30
"""Bytes an array may claim: a small archive can otherwise unpack to more than the memory."""


def write_npz(primitives: PrimitiveSet, path: Path) -> None:
    """Write the set; the same set gives the same bytes (entries carry no time).

    Raises:
        ValueError: the set is invalid.
    """
    primitives.validate()
    arrays = {name: getattr(primitives, name) for name in ARRAYS}
    if primitives.nodes:
        arrays["nodes"] = np.array(primitives.nodes, np.int32)
    content = io.BytesIO()
    np.savez(
        content,
        format=np.array(FORMAT),
        version=np.array(VERSION, np.uint32),
        names=np.frombuffer(json.dumps(primitives.names).encode(), np.uint8),
        **arrays,
    )
    write_atomically(path, content.getvalue())


def read_npz(path: Path) -> PrimitiveSet:
    """Read a set that `write_npz` wrote.

    Raises:
        FormatError: the file is no such archive, is of a newer version, or holds an invalid set.
        OSError: the file can't be opened.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            for entry in archive.infolist():
                if entry.file_size > LARGEST_ARRAY:
                    raise FormatError(
                        path, entry.filename, f"claims {entry.file_size} bytes; no set needs them"
                    )
        with np.load(path, allow_pickle=False) as arrays:
            return _read_arrays(path, arrays)
    except (zipfile.BadZipFile, EOFError, NotImplementedError) as error:
        raise FormatError(
            path, "archive", f"is no whole .npz file ({error}); convert the scene again"
        ) from error


def _read_arrays(path: Path, arrays: Any) -> PrimitiveSet:
    missing = [name for name in ("format", "version", "names", *ARRAYS) if name not in arrays]
    if missing:
        raise FormatError(path, "archive", f"has no {', '.join(missing)}; it is no primitive set")
    try:
        if str(arrays["format"]) != FORMAT or int(arrays["version"]) > VERSION:
            raise FormatError(
                path,
                "version",
                f"is {arrays['format']} {arrays['version']}; this program reads {FORMAT} {VERSION}",
            )
        names = json.loads(arrays["names"].tobytes())
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise FormatError(path, "names", "is no list of strings; convert the scene again")
        nodes = tuple(int(node) for node in arrays["nodes"]) if "nodes" in arrays else ()
        return PrimitiveSet(
            names=tuple(names), nodes=nodes, **{name: arrays[name] for name in ARRAYS}
        ).validate()
    except FormatError:
        raise
    except (ValueError, TypeError, IndexError, AttributeError, OSError) as error:
        raise FormatError(path, "arrays", f"hold no valid set: {error}") from error
