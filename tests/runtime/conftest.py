"""A temporary shader folder for tests that write their own kernels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest


@pytest.fixture
def shaders(tmp_path: Path) -> Callable[[Mapping[str, str]], Path]:
    """Writes {"lib/sdf": text, ...} to a folder and returns it, for `root=`."""

    def write(texts: Mapping[str, str]) -> Path:
        for name, text in texts.items():
            path = (tmp_path / name).with_suffix(".wgsl")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        return tmp_path

    return write
