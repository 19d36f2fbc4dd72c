"""Reports as JSON: what is in each, and that none is ever half written."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from fit.primitives import Kind
from fit.scene import AlphaMode
from pipelines import documents
from pipelines.documents import report_header, to_json_value, write_json


def test_values() -> None:
    value = {
        "array": np.arange(3, dtype=np.uint32),
        "number": np.float32(0.5),
        "nan": float("nan"),
        "infinite": np.array([np.inf, 1.0]),
        "path": Path("a") / "b",
        "words": AlphaMode.MASK,
        "kind": Kind.SPHERE,
        "pair": (1, None),
        "flag": np.bool_(True),
    }
    assert to_json_value(value) == {
        "array": [0, 1, 2],
        "number": 0.5,
        "nan": None,
        "infinite": [None, 1.0],
        "path": "a/b",
        "words": "MASK",
        "kind": 1,
        "pair": [1, None],
        "flag": True,
    }


def test_what_json_cannot_hold_is_an_error() -> None:
    with pytest.raises(TypeError, match="set"):
        to_json_value({"a": {1, 2}})


def test_a_failed_write_keeps_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "report.json"
    write_json(path, {"run": 1})

    def full_disk(source: str, target: str) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(documents.os, "replace", full_disk)
    with pytest.raises(OSError, match="no space left"):
        write_json(path, {"run": 2})
    assert json.loads(path.read_text()) == {"run": 1}
    assert [file.name for file in tmp_path.iterdir()] == ["report.json"]


def test_header_tells_what_ran_where() -> None:
    header = report_header("convert", {"files": [Path("a.glb")]}, seed=3)
    assert header["schema_version"] == documents.SCHEMA_VERSION
    assert (header["command"], header["seed"]) == ("convert", 3)
    assert header["settings"] == {"files": ["a.glb"]}
    assert header["version"]
    assert {"system", "processor", "cores", "memory_mb", "python", "libraries", "adapters"} <= set(
        header["machine"]
    )
