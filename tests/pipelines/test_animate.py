"""Which time of an animation is shown, and rows of pictures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from fit import gltf
from pipelines.animate import TimeOptions, camera_at, numbered, parse_span
from pipelines.bundled import bundled_file
from pipelines.errors import UsageError


def test_times_of_a_row_reach_its_end() -> None:
    assert TimeOptions(span=(0.5, 1.0), frames_per_second=4).times() == (0.5, 0.75, 1.0)
    assert TimeOptions(seconds=3.0).times() == (3.0,)
    assert TimeOptions().times() == ()
    assert parse_span("-1:2.5") == (-1.0, 2.5)
    assert numbered(Path("out/%04d.png"), 7) == Path("out/0007.png")


@pytest.mark.parametrize(
    ("options", "output", "message"),
    [
        ({"seconds": 1.0, "span": (0.0, 1.0)}, "a.png", "not both"),
        ({"span": (0.0, 1.0)}, "a.png", "number them, as in %04d.png"),
        ({"seconds": 1.0}, "%d.png", "name it without %d"),
        ({"frames_per_second": 0.0}, "a.png", "above zero"),
        ({"seconds": float("nan")}, "a.png", "give seconds"),
    ],
)
def test_mistakes_are_named(options: dict[str, Any], output: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        TimeOptions(**options).check(Path(output))


@pytest.mark.parametrize("text", ["1", "1:2:3", "2:1", "a:b", "0:inf"])
def test_spans_that_are_none(text: str) -> None:
    with pytest.raises(UsageError, match="--animate"):
        parse_span(text)


def test_an_animation_is_chosen_by_name() -> None:
    scene = gltf.load(bundled_file("ball_court.glb"))
    assert TimeOptions(animation="all").choose(scene).animations == scene.animations
    with pytest.raises(UsageError, match="the scene has 'all'"):
        TimeOptions(animation="walk").choose(scene)
    with pytest.raises(UsageError, match="the scene has no animation"):
        TimeOptions(seconds=1.0).choose(gltf.load(bundled_file("table.glb")))


def test_a_camera_that_does_not_move_stays() -> None:
    scene = gltf.load(bundled_file("ball_court.glb"))
    assert np.array_equal(
        camera_at(scene.cameras[0], scene, 0.7).world_from_local, scene.cameras[0].world_from_local
    )


def test_a_row_of_pictures_in_which_balls_move(
    sdfprim: Callable[..., Any], bundled_assets: Path, tmp_path: Path, gpu: Any
) -> None:
    outcome = sdfprim(
        "render", bundled_assets / "ball_court.glb", "--set", bundled_assets / "ball_court.npz",
        "--animate", "0:0.5", "--frames-per-second", "4", "--size", "48x32", "--gi", "none",
        "-o", tmp_path / "%02d.png", "--json",
    )  # fmt: skip
    assert outcome.report["times_s"] == [0.0, 0.25, 0.5]
    pictures = [np.asarray(Image.open(tmp_path / f"{k:02d}.png"), float) for k in range(3)]
    assert len(list(tmp_path.iterdir())) == 3
    for one, other in ((0, 1), (1, 2)):
        moved = np.abs(pictures[one] - pictures[other]).max(axis=-1) > 16
        assert 0.02 < moved.mean() < 0.6
