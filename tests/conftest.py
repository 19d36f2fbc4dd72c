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


@pytest.fixture(scope="session")
def mesh_of_boxes():
    """Makes a scene that draws a cube for each box of a set that is not turned, all in one colour."""
    from fit.primitives import PrimitiveSet
    from fit.scene import Instance, Material, Mesh, Scene

    def make(boxes: PrimitiveSet, material: Material | None = None) -> Scene:
        corners = np.array([[(k >> axis & 1) - 0.5 for axis in range(3)] for k in range(8)])
        faces = corners[[[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]]
        normals = np.repeat(2 * faces.mean(axis=1), 4, axis=0)
        triangles = np.array([(4 * k, 4 * k + i + 1, 4 * k + i) for k in range(6) for i in (1, 2)], np.uint32)
        cube = Mesh("cube", faces.reshape(-1, 3), normals, triangles, 0)
        places = [np.diag([*size, 1.0]) for size in boxes.sizes]
        for place, position in zip(places, boxes.positions, strict=True):
            place[:3, 3] = position
        return Scene(
            source=Path(__file__),
            meshes=(cube,),
            materials=(material or Material(base_color=(0.5, 0.5, 0.5, 1.0)),),
            instances=tuple(Instance(0, -1, place) for place in places),
        )

    return make
