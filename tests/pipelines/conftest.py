"""Fixtures of the command tests: the command line in this process, and a scene that converts in seconds."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from pipelines import cli


@dataclass(frozen=True)
class Ran:
    """A finished command line."""

    code: int
    out: str
    err: str

    @property
    def report(self) -> dict[str, Any]:
        """stdout as the JSON document that --json promises."""
        document: dict[str, Any] = json.loads(self.out)
        return document


@pytest.fixture
def sdfprim(capfd: pytest.CaptureFixture[str]) -> Callable[..., Ran]:
    """Runs a command line in this process."""

    def run(*arguments: object) -> Ran:
        capfd.readouterr()
        code = cli.execute([str(argument) for argument in arguments])
        return Ran(code, *capfd.readouterr())

    return run


@pytest.fixture(scope="session")
def wall(bundled_assets: Path) -> Path:
    """A scene of 24 triangles."""
    return bundled_assets / "two_colour_wall.glb"


@pytest.fixture(scope="session")
def broken_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file that is no glTF."""
    path = tmp_path_factory.mktemp("broken") / "broken.glb"
    path.write_bytes(b"glTF\2\0\0\0 and then nothing")
    return path
