"""Fixtures for every test: where the shared assets lie, and strict NumPy arithmetic."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

REPOSITORY = Path(__file__).resolve().parent.parent

# A division by zero or an invalid operation is a fault unless the code says otherwise with np.errstate.
np.seterr(divide="raise", over="raise", invalid="raise", under="ignore")

os.environ.setdefault("XDG_RUNTIME_DIR", "/tmp")  # the Vulkan loader prints noise without it


@pytest.fixture(scope="session")
def repository() -> Path:
    """Root of the checkout."""
    return REPOSITORY


@pytest.fixture(scope="session")
def bundled_assets() -> Path:
    """The small scenes that the project generates and commits."""
    return REPOSITORY / "assets"


@pytest.fixture(scope="session")
def shared_assets() -> Path:
    """Folder of the large third-party test scenes; the test is skipped where there is none."""
    named = os.environ.get("SDFPRIM_ASSETS")
    folder = Path(named) if named else REPOSITORY.parent / "shared" / "assets"
    if not (folder / "MANIFEST.csv").is_file():
        pytest.skip(
            f"no shared assets in {folder}: point SDFPRIM_ASSETS at the folder that holds MANIFEST.csv"
        )
    return folder


@pytest.fixture(scope="session")
def gpu():
    """An open GPU, a software one too; skipped where there is none, and the reason is the remedy."""
    from runtime.device import NoAdapter, open_device

    try:
        return open_device()
    except NoAdapter as error:
        pytest.skip(str(error))
