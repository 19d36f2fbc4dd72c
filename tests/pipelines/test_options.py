"""Values of options: what is read, and what a wrong one is told."""

from __future__ import annotations

import pytest

from pipelines.errors import UsageError
from pipelines.options import looks_like_numbers, parse_camera, parse_color, parse_size, parse_sun


def test_sizes() -> None:
    assert parse_size("640x360") == (640, 360)
    assert parse_size("1920X1080") == (1920, 1080)


@pytest.mark.parametrize("text", ["640", "640*360", "0x10", "640x9000", "-1x5", "axb", ""])
def test_wrong_sizes_name_the_remedy(text: str) -> None:
    with pytest.raises(UsageError, match=r"--size .*(640x360|1 to 8192)"):
        parse_size(text)


def test_sun() -> None:
    sun = parse_sun("-1,2,0.5,10")
    assert (sun.direction, sun.strength) == ((-1.0, 2.0, 0.5), 10.0)


@pytest.mark.parametrize("text", ["0,0,0,1", "1,2,3", "1,2,3,-4", "1,2,3,nan", "a,b,c,d"])
def test_wrong_suns(text: str) -> None:
    with pytest.raises(UsageError, match="--sun"):
        parse_sun(text)


def test_camera() -> None:
    camera = parse_camera("-1,2,3,0,1e-3,0,60")
    assert camera.position == (-1.0, 2.0, 3.0)
    assert camera.target == (0.0, 0.001, 0.0)
    assert camera.fov == 60.0


@pytest.mark.parametrize("text", ["1,2,3,1,2,3,60", "0,0,0,1,1,1,180", "0,0,0,1,1,1,0", "0,0,0,1,1,1"])
def test_wrong_cameras(text: str) -> None:
    with pytest.raises(UsageError, match="--camera"):
        parse_camera(text)


def test_colors_are_not_negative() -> None:
    assert parse_color("--sky", "0,0.5,1") == (0.0, 0.5, 1.0)
    with pytest.raises(UsageError, match="--sky"):
        parse_color("--sky", "0,-1,0")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1,2,3", True),
        ("-1.5,2e-3,0", True),
        ("nan,1,2", True),
        ("sky,evening.hdr", False),
        ("court", False),
        ("3", False),
    ],
)
def test_numbers_are_told_from_names(text: str, expected: bool) -> None:
    assert looks_like_numbers(text) is expected
