"""The house's own checks: lint, format, types, and who imports whom."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

TOOLS = {
    "lint": ["ruff", "check", "."],
    "format": ["ruff", "format", "--check", "."],
    "types": ["mypy"],
    "imports": ["lint-imports", "--no-cache"],
}

SOLVERS = ("nlopt", "manifold3d", "pymeshlab", "trimesh", "scipy.optimize")

DATA_MODEL = ("fit", "fit.scene", "fit.gltf", "fit.motion", "fit.primitives", "fit.sdf", "fit.export")


def run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("tool", TOOLS)
def test_house_rules(tool: str, repository: Path) -> None:
    name, *arguments = TOOLS[tool]
    done = run([str(Path(sys.executable).parent / name), *arguments], repository)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("module", DATA_MODEL)
def test_data_model_loads_no_solver(module: str, repository: Path) -> None:
    program = f"import sys, {module}; print([name for name in {SOLVERS} if name in sys.modules])"
    done = run([sys.executable, "-c", program], repository)
    assert done.stdout.strip() == "[]", done.stdout + done.stderr
