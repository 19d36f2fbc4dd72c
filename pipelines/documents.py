"""JSON documents: what every report starts with, and how one is written."""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from datetime import UTC, datetime
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.machine import describe_machine, package_version

SCHEMA_VERSION = 1
"""Raised when a key of a report changes its meaning or goes away; new keys do not raise it."""


def report_header(command: str, settings: Any, seed: int | None = None) -> dict[str, Any]:
    """The keys that open every report: what ran, which version, on which machine, with which settings."""
    return {
        "schema_version": SCHEMA_VERSION,
        "command": command,
        "version": package_version(),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": describe_machine(),
        "seed": seed,
        "settings": to_json_value(settings),
    }


def to_json_value(value: Any) -> Any:
    """`value` as JSON can hold it: dataclasses and arrays opened, paths as text, NaN and infinity as null."""
    if isinstance(value, str | int | bool | None) and not isinstance(value, Enum):
        return value
    if isinstance(value, Enum):
        return to_json_value(value.value)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, np.generic | np.ndarray):
        return to_json_value(value.tolist())
    if is_dataclass(value) and not isinstance(value, type):
        return to_json_value(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): to_json_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_json_value(item) for item in value]
    if isinstance(value, Path):
        return value.as_posix()
    raise TypeError(f"no JSON form for {type(value).__name__}: {value!r}")


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Writes `document` so that a reader sees the old file or the new one, never half of either."""
    text = json.dumps(to_json_value(document), indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    write_text(path, text)


def write_text(path: Path, text: str) -> None:
    """Writes UTF-8 text through a temporary file beside `path`."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as stream:
            stream.write(text)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
