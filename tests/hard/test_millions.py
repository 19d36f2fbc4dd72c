"""Meshes of millions of triangles, within the memory and the time of an ordinary machine."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

MOST_BYTES = 8 << 30

FIT = """
import importlib.util, json, resource, sys, time
import numpy as np
spec = importlib.util.spec_from_file_location("hard_meshes", sys.argv[1])
meshes = importlib.util.module_from_spec(spec)
spec.loader.exec_module(meshes)
from fit.solve import FitSettings, fit
scene = meshes.scene_of(meshes.wavy_globe(int(sys.argv[2])))
started = time.process_time()
result = fit(scene, FitSettings(max_primitives=16))
print(json.dumps({
    "triangles": scene.triangle_count, "seconds": time.process_time() - started, "stages": result.seconds,
    "bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, "primitives": len(result.primitives),
    "error": result.metrics.surface_to_set_mean_m / result.metrics.diag_m,
}))
"""


@pytest.mark.slow
@pytest.mark.parametrize(("millions", "most_seconds"), [(1, 120), (10, 180)])
def test_millions_of_triangles(millions: int, most_seconds: float, repository: Path) -> None:
    """In a process of its own, so that its peak of memory is its own."""
    generators = Path(__file__).with_name("meshes.py")
    ran = subprocess.run(
        [sys.executable, "-c", FIT, str(generators), str(millions * 1_000_000)],
        cwd=repository, capture_output=True, text=True, check=True, timeout=3600,
    )  # fmt: skip
    found = json.loads(ran.stdout)
    print(found)
    assert found["triangles"] >= millions * 1_000_000
    assert found["bytes"] < MOST_BYTES
    assert found["seconds"] < most_seconds
    assert 1 <= found["primitives"] <= 16
    assert found["error"] < 0.02
