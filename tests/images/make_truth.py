"""Writes the references of the image tests: `python tests/images/make_truth.py [NAME...]`, some minutes.

For each scene of assets/stages.toml, truth/NAME.npz holds what Mitsuba measures at the pixels of its camera:
shown (h, w), where there is geometry; irradiance (2, n, 3) float16, W/m2, two independent halves of the
indirect E at these pixels' points; noise, the mean absolute noise of their mean, a share of the mean.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

import numpy as np

from fit import gltf
from pipelines.gi_errors.pixels import Pixels
from pipelines.reference import mesh_reference
from pipelines.studio import LightingOptions, Studio

SIZE = (48, 36)
SAMPLES = 4096

ASSETS = Path(__file__).parents[2] / "assets"
TRUTH = Path(__file__).parent / "truth"


def make_truth(name: str, stage: dict[str, str]) -> Path:
    """Measures one scene and writes its file."""
    scene = gltf.load(ASSETS / f"{name}.glb")
    light = LightingOptions(sky=stage["sky"], keep_file_lights=True)
    studio = Studio.set_up(scene, stage["camera"], light, SIZE, 0.0)
    pixels = Pixels.of(studio)
    found = mesh_reference(scene, studio.illumination).irradiance(
        pixels.points, pixels.normals, samples=SAMPLES
    )
    path = TRUTH / f"{name}.npz"
    path.parent.mkdir(exist_ok=True)
    halves = np.stack([found.first, found.second]).astype(np.float16)
    np.savez_compressed(path, shown=pixels.shown, irradiance=halves, noise=np.float32(found.noise))
    return path


if __name__ == "__main__":
    stages = tomllib.loads((ASSETS / "stages.toml").read_text(encoding="utf-8"))
    for wanted in sys.argv[1:] or stages:
        print(make_truth(wanted, stages[wanted]), flush=True)
