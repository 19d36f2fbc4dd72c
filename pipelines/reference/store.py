"""What was rendered once is kept in the user's cache folder, under the hash of all that it depends on."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from runtime.estimate import Estimate

Arrays = dict[str, np.ndarray]

FOLDER = "SDFPRIM_CACHE"
"""Environment variable that names another cache folder."""


def cache_folder() -> Path:
    """Where results are kept; safe to delete at any time.

    Raises:
        ValueError: no folder is named and the library that knows the user's is not installed.
    """
    named = os.environ.get(FOLDER)
    if named:
        return Path(named) / "reference"
    try:
        import platformdirs
    except ImportError:
        raise ValueError(
            f"references are kept in the user's cache folder: pip install 'sdfprim[reference]', or name a "
            f"folder in {FOLDER}"
        ) from None
    return Path(platformdirs.user_cache_dir("sdfprim")) / "reference"


def estimate_arrays(estimate: Estimate) -> Arrays:
    """A measurement with its noise, as it is kept."""
    return {field.name: np.asarray(getattr(estimate, field.name)) for field in fields(estimate)}


def estimate_of(arrays: Arrays) -> Estimate:
    """The measurement that was kept so."""
    first, second, error = (arrays[name] for name in ("first", "second", "standard_error"))
    return Estimate(arrays["value"], first, second, error, int(arrays["samples"]))


def cached(parts: Any, make: Callable[[], Arrays]) -> tuple[Arrays, bool]:
    """The arrays that `make` returned for the same `parts` before, or returns now; and whether it was before.

    parts: everything that the result depends on: dataclasses, arrays, mappings, sequences and plain values.
    A file that cannot be read counts as none.
    """
    path = cache_folder() / f"{digest(parts)}.npz"
    if path.exists():
        try:
            with np.load(path, allow_pickle=False) as file:
                return dict(file), True
        except (OSError, ValueError, EOFError, KeyError):
            path.unlink(missing_ok=True)
    arrays = make()
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, beside = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)
        os.replace(beside, path)
    except BaseException:
        Path(beside).unlink(missing_ok=True)
        raise
    return arrays, False


def digest(parts: Any) -> str:
    """SHA-256 of values and of the types that tell equal ones apart, in hexadecimal."""
    sha = hashlib.sha256()
    _feed(sha.update, parts)
    return sha.hexdigest()


def _feed(update: Callable[[bytes], None], value: Any) -> None:
    update(type(value).__name__.encode() + b"\0")
    if isinstance(value, np.ndarray):
        update(f"{value.dtype.str}{value.shape}".encode())
        update(np.ascontiguousarray(value).tobytes())
    elif is_dataclass(value):
        for field in fields(value):
            update(field.name.encode() + b"\0")
            _feed(update, getattr(value, field.name))
    elif isinstance(value, Mapping):
        for key in sorted(value):
            _feed(update, key)
            _feed(update, value[key])
    elif isinstance(value, tuple | list):
        update(str(len(value)).encode())
        for item in value:
            _feed(update, item)
    elif value is None or isinstance(value, str | bytes | int | float | bool | Path | Enum | np.generic):
        update(repr(value).encode() + b"\0")
    else:
        raise TypeError(f"a {type(value).__name__} has no digest: give arrays, dataclasses or plain values")
