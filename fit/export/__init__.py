"""Primitive sets to and from files; the suffix chooses the format. docs/formats.md describes them all."""

from __future__ import annotations

import warnings
from os import PathLike
from pathlib import Path

from fit.export.files import FormatError
from fit.export.gltf import write_glb
from fit.export.gltf_reader import read_gltf
from fit.export.npz import read_npz, write_npz
from fit.export.usd import write_usda
from fit.export.wgsl import write_wgsl
from fit.primitives import PrimitiveSet

__all__ = ["FormatError", "read", "write"]

_WRITERS = {".npz": write_npz, ".glb": write_glb, ".usda": write_usda, ".wgsl": write_wgsl}


def write(primitives: PrimitiveSet, path: str | PathLike[str]) -> None:
    """Write a set as .npz, .glb, .usda or .wgsl. The same set gives the same bytes.

    The file appears whole or not at all.

    Raises:
        FormatError: the suffix is none of these.
        ValueError: the set is invalid; the message names the primitive.
        OSError: the file can't be written.
    """
    path = Path(path)
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise FormatError(path, "suffix", f"is unknown; use one of {', '.join(_WRITERS)}")
    writer(primitives, path)


def read(path: str | PathLike[str], notes: list[str] | None = None) -> PrimitiveSet:
    """Read a set from .npz (lossless), .glb or .gltf (also edited ones, and other tools' colliders).

    Whatever a file holds that can't become a primitive, or had to be guessed, is appended to `notes`, or
    becomes a warning when no list is given.

    Raises:
        FormatError: the file is malformed or holds no primitives; the message names the place in it.
        OSError: the file can't be opened.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".npz":
        return read_npz(path)
    if suffix not in (".glb", ".gltf"):
        raise FormatError(path, "suffix", "can't be read; use a .npz, .glb or .gltf file")
    found: list[str] = [] if notes is None else notes
    primitives = read_gltf(path, found)
    if notes is None:
        for note in found:
            warnings.warn(f"{path}: {note}", stacklevel=2)
    return primitives
