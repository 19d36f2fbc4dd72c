"""Writes the bundled scenes: `python assets/generate.py [FOLDER]`, by default into this file's folder."""

from __future__ import annotations

import sys
from pathlib import Path

from demonstrations import DEMONSTRATIONS
from glb import Glb
from scenes import SCENES
from stage import Stage
from stages import STAGES


def generate(folder: Path) -> list[Path]:
    """Writes every scene into `folder`, stages with their primitive sets, and returns the files."""
    files = []
    for name, fill in SCENES.items():
        scene = Glb(name)
        fill(scene)
        files.append(folder / f"{name}.glb")
        scene.write(files[-1])
    for name, build in (STAGES | DEMONSTRATIONS).items():
        stage = Stage(name)
        build(stage)
        files += stage.write(folder / f"{name}.glb")
    return files


if __name__ == "__main__":
    for file in generate(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent):
        print(file)
