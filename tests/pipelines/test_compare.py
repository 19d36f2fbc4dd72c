"""`sdfprim compare`: the report's figures, the pictures, and a page that opens without a network."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from fit import export
from pipelines import compare
from pipelines.difference import flip, relative_error, twice
from pipelines.quantities import METRICS
from pipelines.report.plots import bars

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.fixture(scope="module")
def compared(gpu: Any, wall: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """A comparison of the smallest scene, and its folder."""
    folder = tmp_path_factory.mktemp("compare")
    settings = compare.CompareSettings(wall, folder, size=(80, 48), frames=3)
    return compare.run(settings, lambda text, share: None), folder


def test_report(compared: tuple[dict[str, Any], Path], wall: Path) -> None:
    _, folder = compared
    report = json.loads((folder / "report.json").read_text())
    assert report["settings"]["scene"] == wall.as_posix()
    assert set(report["sets"]) == {"coarse", "fine"}
    for preset, row in report["sets"].items():
        assert row["primitives"] == len(export.read(folder / f"{preset}.prims.npz"))
        assert {metric.key for metric in METRICS} <= set(row["metrics"])
        assert "sdfddgi/update_probes" in row["passes_ms"]
    assert "sdfddgi/update_probes" not in report["without_gi"]["passes_ms"]
    assert 0 < report["differences"]["without-gi"]["flip"] < 1
    assert report["lights"]


def test_pictures(compared: tuple[dict[str, Any], Path]) -> None:
    report, folder = compared
    for name in report["pictures"]:
        assert Image.open(folder / name).size == (80, 48), name
    lit, unlit = (np.asarray(Image.open(folder / f"{name}.png")) for name in ("fine", "without-gi"))
    assert lit.astype(int).sum() > unlit.astype(int).sum()


def test_the_page_stands_alone(compared: tuple[dict[str, Any], Path]) -> None:
    _, folder = compared
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert not re.findall(r"""(?:src|href)=["'](?!data:)|url\(|@import|https?://""", page)
    sources = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert len(sources) >= 9
    for source in sources:
        assert Image.open(io.BytesIO(base64.b64decode(source))).size == (80, 48)
    assert page.count('type="range"') == 3
    assert "$" not in page


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium to open the page with")
def test_the_page_opens_in_a_browser(compared: tuple[dict[str, Any], Path], tmp_path: Path) -> None:
    _, folder = compared
    shot = tmp_path / "page.png"
    command = [
        str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
        f"--user-data-dir={tmp_path / 'profile'}", "--window-size=1000,5000", f"--screenshot={shot}",
        (folder / "report.html").as_uri(),
    ]  # fmt: skip
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    pixels = np.asarray(Image.open(shot).convert("RGB")).astype(int)
    assert pixels.shape[:2] == (5000, 1000)
    bar_rows = (np.abs(pixels - (0xB4, 0x58, 0x2A)).max(axis=-1) < 12).any(axis=1).sum()
    assert bar_rows > 60, "the plots' bars are not drawn"


def test_numbers_of_the_command_line(
    sdfprim: Callable[..., Any], compared: tuple[dict[str, Any], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    report, folder = compared
    monkeypatch.setattr(compare, "run", lambda settings, progress: report)
    ran = sdfprim("compare", report["settings"]["scene"], "-o", folder)
    assert ran.code == 0
    assert f"report   {folder / 'report.html'}" in ran.out
    assert "coarse against fine: FLIP" in ran.out


def test_flip_is_zero_for_equal_pictures_and_not_for_others() -> None:
    rng = np.random.default_rng(1)
    picture = rng.integers(0, 256, (32, 48, 3), dtype=np.uint8)
    same, colors = flip(picture, picture)
    other, _ = flip(picture, 255 - picture)
    assert same == 0
    assert other > 0.3
    assert colors.shape == (32, 48, 3)


def test_relative_error_is_over_geometry_alone() -> None:
    reference = np.full((4, 4, 3), 2.0, np.float32)
    picture = reference.copy()
    picture[0] = 3.0
    picture[3] = 100.0
    shown = np.ones((4, 4), bool)
    shown[3] = False
    error = relative_error(twice(picture[shown]), twice(reference[shown]))
    assert error.rel_mse == pytest.approx((1 / 3) / (4 + 0.02**2))
    assert error.numerator == pytest.approx(1 / 3)
    black = np.zeros_like(reference)
    assert relative_error(twice(black), twice(black)).rel_mse == 0
    assert relative_error(twice(picture), twice(black)).rel_mse == float("inf")


def test_bars_are_as_long_as_their_values() -> None:
    plot = bars({"coarse": [1.0, None], "fine": [4.0, 2.0]}, ["a < b", "c"], "ms")
    widths = [float(width) for width in re.findall(r'width="([\d.]+)" height="13"', plot)]
    assert widths == pytest.approx([160, 640, 320])
    assert "a &lt; b" in plot
