"""The wheel: everything that the program reads at run time is inside."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def wheel(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    done = subprocess.run(command, cwd=repository, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return next(folder.glob("*.whl"))


def test_shaders_scenes_and_template_are_inside(wheel: Path, repository: Path) -> None:
    held = set(zipfile.ZipFile(wheel).namelist())
    wanted = {path.relative_to(repository).as_posix() for path in (repository / "runtime").rglob("*.wgsl")}
    wanted |= {f"pipelines/assets/{path.name}" for path in (repository / "assets").glob("*.glb")}
    wanted |= {"pipelines/assets/views.toml", "pipelines/report/template.html", "pipelines/gi_presets.json"}
    assert len(wanted) > 20
    assert wanted <= held, sorted(wanted - held)


def test_nothing_else_is_inside(wheel: Path) -> None:
    tops = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"fit", "runtime", "pipelines"}


def test_it_runs_away_from_the_checkout(wheel: Path, tmp_path: Path) -> None:
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    program = (
        f"import sys; sys.path.insert(0, {str(tmp_path / 'site')!r})\n"
        "from pipelines import cli, demo; from pathlib import Path\n"
        "print(demo.settings(Path('out')).scene, end='')"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert Path(done.stdout) == tmp_path / "site" / "pipelines" / "assets" / "atrium.glb"
