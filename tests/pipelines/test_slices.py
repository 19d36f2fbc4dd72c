"""`sdfprim slices`: what a cut holds, and what is told of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from fit import export, gltf
from fit.air import find_air
from fit.primitives import PrimitiveSet, make_box, make_sphere
from fit.surface import from_scene
from pipelines.cuts import FILLED, MESH, cut_scene, draw_cuts, pixel_size


@pytest.fixture(scope="module")
def room(bundled_assets: Path) -> tuple[Any, Any]:
    """A closed room of 3 x 3 x 3 m with walls of 4 cm, and its air on a coarse grid."""
    scene = gltf.load(bundled_assets / "sealed_room.glb")
    return scene, find_air(from_scene(scene), scene, resolution=60)


def walls() -> PrimitiveSet:
    slabs = []
    for axis in range(3):
        for side in (-1, 1):
            size, center = np.full(3, 3.08), np.array([0, 1.5, 0])
            size[axis], center[axis] = 0.04, center[axis] + side * 1.52
            slabs.append(make_box(center, size))
    return PrimitiveSet.concatenate(slabs)


@pytest.mark.parametrize("axis", range(3))
def test_a_cut_shows_mesh_air_and_set_where_they_are(room: tuple[Any, Any], axis: int) -> None:
    _, air = room
    metres = pixel_size(air, 200)
    floating = PrimitiveSet.concatenate([walls(), make_sphere((0.5, 1.0, -0.25), 0.4)])
    cut = cut_scene(floating, air, axis, np.array([0.5, 1.0, -0.25]), metres)
    lengths = np.linalg.norm(np.diff(cut.segments, axis=1), axis=2).sum() * metres
    # 4 slabs are cut, each 3 m or 3.08 m long and 4 cm wide
    assert lengths == pytest.approx(8 * 3.04 + 8 * 0.04, abs=0.2)
    filled = cut.is_air & (cut.owner == 6)
    assert filled.sum() * metres**2 == pytest.approx(np.pi * 0.4**2, rel=0.03)
    assert not (cut.is_air & (cut.owner >= 0) & (cut.owner != 6)).any(), "walls fill no air"
    height, width = cut.label.shape
    assert len({cut.label[0, 0], cut.label[height // 2, width // 5]}) == 2, "outside and room are two spaces"
    row, column = np.argwhere(filled).mean(axis=0) / (height, width)
    expected = {0: (-0.25, 1.0), 1: (0.5, -0.25), 2: (0.5, 1.0)}[axis]
    across = 0.5 + expected[0] / (width * metres)
    along = 0.5 + (expected[1] if axis == 1 else 1.5 - expected[1]) / (height * metres)
    assert (column, row) == pytest.approx((across, along), abs=0.01)


def test_the_picture_holds_its_parts_and_a_legend(room: tuple[Any, Any]) -> None:
    _, air = room
    floating = PrimitiveSet.concatenate([walls(), make_sphere((0.5, 1.0, -0.25), 0.4)])
    metres = pixel_size(air, 180)
    cuts = [cut_scene(floating, air, axis, np.array([0.5, 1.0, -0.25]), metres) for axis in range(3)]
    pixels = draw_cuts(cuts, air, 640)
    assert pixels.shape[1] == 640
    red = (pixels == FILLED).all(axis=-1)
    expected = sum((cut.is_air & (cut.owner >= 0)).sum() for cut in cuts)
    assert red.sum() == pytest.approx(expected, rel=0.15)
    assert (pixels == MESH).all(axis=-1).sum() > 3 * 8 * 100


def test_the_command(sdfprim: Callable[..., Any], wall: Path, tmp_path: Path) -> None:
    floor, sheet = make_box((0, -0.1, 0), (6, 0.2, 4)), make_box((0, 1, 0), (0.06, 2, 3))
    export.write(PrimitiveSet.concatenate([floor, sheet]), tmp_path / "a.npz")
    command = ("slices", wall, "--set", tmp_path / "a.npz", "-o", tmp_path / "a.png", "--width", 400)
    ran = sdfprim(*command, "--at", "-1,0.5,0.2", "--json")
    assert ran.code == 0, ran.err
    assert np.asarray(Image.open(tmp_path / "a.png")).shape[1] == 400
    assert ran.report["at"] == [-1, 0.5, 0.2]
    assert [cut["axis"] for cut in ran.report["cuts"]] == ["x", "y", "z"]
    assert max(cut["air_filled"] for cut in ran.report["cuts"]) < 0.01
    shown = sdfprim(*command)
    assert "2 primitives" in shown.out
    assert "air" in shown.out


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("-o", "a.jpg"), ".png"),
        (("-o", "a.png", "--at", "1,2"), "x,y,z"),
        (("-o", "a.png", "--width", 7), "pixels"),
    ],
)
def test_mistakes_are_told_first(
    options: tuple[object, ...], word: str, sdfprim: Callable[..., Any], wall: Path
) -> None:
    ran = sdfprim("slices", wall, *options)
    assert ran.code == 2
    assert word in ran.err
