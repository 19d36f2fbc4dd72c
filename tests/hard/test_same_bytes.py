"""The same seed gives the same bytes: again, and with any number of threads."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

FIT = """
import importlib.util, hashlib, sys
import numpy as np
spec = importlib.util.spec_from_file_location("hard_meshes", sys.argv[1])
meshes = importlib.util.module_from_spec(spec)
spec.loader.exec_module(meshes)
from fit.solve import FitSettings, fit
scene = meshes.scene_of(meshes.finer(getattr(meshes, sys.argv[2])(), float(sys.argv[3])))
print(scene.triangle_count, file=sys.stderr)
primitives = fit(scene, FitSettings(resolution=60, max_primitives=4)).primitives
arrays = ("kinds", "positions", "rotations", "sizes", "albedo", "emission")
print(hashlib.sha256(b"".join(getattr(primitives, name).tobytes() for name in arrays)).hexdigest())
"""


def bytes_with(threads: int, mesh: str, longest: float, repository: Path) -> str:
    """Hash of the set that a process of so many threads fits to a mesh of so long edges."""
    generators = Path(__file__).with_name("meshes.py")
    ran = subprocess.run(
        [sys.executable, "-c", FIT, str(generators), mesh, str(longest)],
        cwd=repository, env=os.environ | dict.fromkeys(THREADS, str(threads)),
        capture_output=True, text=True, check=True, timeout=600,
    )  # fmt: skip
    return ran.stdout.strip()


@pytest.mark.parametrize(
    ("mesh", "longest"),
    [
        ("table", 1.0),
        pytest.param("furnished_room", 0.03, marks=pytest.mark.slow),
        pytest.param("lumpy_ball", 0.01, marks=pytest.mark.slow),
    ],
)
def test_any_number_of_threads_gives_the_same_bytes(mesh: str, longest: float, repository: Path) -> None:
    assert bytes_with(1, mesh, longest, repository) == bytes_with(4, mesh, longest, repository)
