"""The page of `bench fit`: it stands alone, speaks first, and its curves lie where the figures are."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pipelines.bench_fit import EMPTY_RUN
from pipelines.bench_fit_summary import summarize
from pipelines.report.curves import Point, axis, curves
from pipelines.report.fit_advice import advice_in_words
from pipelines.report.fit_markdown import build_markdown
from pipelines.report.fit_page import build_page
from pipelines.report.plots import stacked_bars

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

POINTS = [
    Point(4, 20, "4", "four", True),
    Point(64, 0, "64", "none < all", True),
    Point(16, 2, "16", "", False),
]


def make_run(budget: int, error: float, **changes: Any) -> dict[str, Any]:
    """A run over budgets."""
    metrics = {
        "surface_to_set_mean_m": error, "leaks": error / 4, "blocked": error / 9, "false_solid": 0.0,
        "air_distance_error_pct": error, "covered_half_pct": 0.875, "iou": None,
    }  # fmt: skip
    found = {
        "series": "budget", "label": str(budget), "budget": budget, "status": "ok", "primitives": budget,
        "bytes": 64 * budget, "kinds": {"box": budget}, "error": error, "cpu_seconds": budget / 4,
        "total_cpu_seconds": 1 + budget / 4, "wall_seconds": budget / 2, "metrics": metrics,
        "stages": {"build": budget / 4},
        "by_kind": {"box": {"surface_share": 1, "surface_to_set_mean_m": 0.1}},
    }  # fmt: skip
    return EMPTY_RUN | found | changes


@pytest.fixture
def report() -> dict[str, Any]:
    """A report of one scene with runs of every series, and one that failed."""
    runs = [
        *(make_run(budget, 1 / budget) for budget in (4, 16, 64)),
        make_run(64, 0.5, series="step", label="parts"),
        make_run(64, 0.1, series="kind", label="without box"),
        make_run(64, 0.7, series="peer", method="vhacd boxes"),
        make_run(64, 0.7, series="peer", method="coacd boxes", status="failed", failure="stopped <here>")
        | {"primitives": None, "metrics": None, "error": None},
    ]
    scene = {
        "name": "a&b", "source": "a&b.glb", "status": "ok", "failure": None, "triangles": 1234,
        "diagonal_m": 9.0, "cpu_seconds": 1.0, "stages": {"air": 1.0}, "runs": runs,
        "air": [{"point": [0, 1, 0], "volume": 8.0, "evidence": "the outside"}], "summary": summarize(runs),
    }  # fmt: skip
    return {
        "settings": {"budgets": [4, 16, 64], "timeout": 300.0, "seed": 0}, "version": "1", "seed": 0,
        "created": "today", "machine": {"processor": "abacus", "cores": 2}, "scenes": [scene],
    }  # fmt: skip


def test_the_page_stands_alone_and_speaks_first(report: dict[str, Any]) -> None:
    page = build_page(report)
    assert not re.findall(r"""(?:src|href)=|url\(|@import|https?://""", page)
    assert "$" not in page
    assert "a&b" not in page.replace("a&amp;b", "")
    assert "stopped &lt;here&gt;" in page
    body = page[page.index("<body>") :]
    assert body.index("a&amp;b: take 16.") < body.index("<svg") < body.index("What each step brings")
    assert re.search(r"Lost against 64 \(64 primitives, 12 s of CPU more\).*leaks 0.39 %", body)
    assert "What each kind brings" in body
    assert "Beside convex decompositions" in body


def test_several_scenes_start_with_a_line_each(report: dict[str, Any]) -> None:
    first = report["scenes"][0]
    failed = first | {"name": "c", "failure": "no face stops light", "runs": [], "summary": summarize([])}
    report["scenes"] = [first, failed]
    page = build_page(report)
    overview = page[page.index("Which budget to take") : page.index("<h2>a&amp;b")]
    assert re.search(r"a&amp;b</td><td[^>]*>16</td>", overview)
    assert "no face stops light" in overview


def test_the_advice_names_what_is_missed_and_what_rises(report: dict[str, Any]) -> None:
    scene = report["scenes"][0]
    for run in scene["runs"]:
        if run["metrics"]:
            run["metrics"]["leaks"] = 0.5
    scene["runs"].append(make_run(128, 0.02, metrics=scene["runs"][2]["metrics"]))
    scene["summary"] = summarize(scene["runs"])
    words = advice_in_words(scene)
    assert "misses leaks at most 2.00 %" in words
    assert "raised the error by 28.0% at most (64 to 128), MORE than" in words


def test_one_budget_is_no_curve(report: dict[str, Any]) -> None:
    runs = [make_run(64, 0.1)]
    report["scenes"][0] |= {"runs": runs, "summary": summarize(runs)}
    page = build_page(report)
    assert "No other budget was tried" in page
    assert "Error over primitives" not in page


def test_a_report_without_any_run_is_a_page(report: dict[str, Any]) -> None:
    report["scenes"][0] |= {"runs": [], "summary": summarize([])}
    assert "no fit succeeded" in build_page(report)


def test_the_tables_hold_every_run(report: dict[str, Any]) -> None:
    text = build_markdown(report)
    rows = [line.split(" | ") for line in text.splitlines() if line.startswith("| a&b")]
    assert [row[1] for row in rows] == [f"sdfprim, {n}" for n in (4, 16, 64)] + [
        "vhacd boxes, 64", "coacd boxes, 64",
    ]  # fmt: skip
    assert rows[1][2:6] == ["16", "6.25", "0.694", "87.5"], "the surface's distance is in % of the diagonal"
    assert rows[4][2] == "stopped <here>"
    assert {line.count("|") for line in text.splitlines() if line.startswith("|")} == {13}
    assert "| 64 | without box |" in text


def test_curves_lie_where_the_figures_are() -> None:
    plot = curves({"a < b": POINTS}, "primitives", "error, %")
    dots = re.findall(r'<circle class="c0 (\w+)" cx="([\d.]+)" cy="([\d.]+)"', plot)
    assert [dot[0] for dot in dots] == ["best", "beaten", "best"]
    x, y = np.array([[float(dot[1]), float(dot[2])] for dot in dots]).T
    assert x[1] - x[0] == pytest.approx(x[2] - x[1], abs=0.2), (
        "4, 16 and 64 are even steps on a logarithmic axis"
    )
    assert y[0] < y[1] < y[2] == 284, "less error is lower; none lies on the axis"
    assert "<title>none &lt; all</title>" in plot
    assert curves({}, "x", "y") == ""


@pytest.mark.parametrize("values", [[0.0], [0.0, 0.0], [3.0], [1e-9, 1e3], [0, 1e-6, 5e4], [1.0, 2.0, 10.0]])
def test_an_axis_holds_its_values_and_few_ticks(values: list[float]) -> None:
    found = axis(values, 284, 56)
    assert all(56 <= found.place(value) <= 284 + 1e-9 for value in values)
    assert 1 <= len(found.ticks()) <= 14


def test_stacked_bars_add_up() -> None:
    plot = stacked_bars({"air": [1.0, 1.0], "build": [1.0, 3.0]}, ["a", "b"], "s")
    widths = [float(width) for width in re.findall(r'width="([\d.]+)" height="13"', plot)]
    assert widths == pytest.approx([160, 160, 160, 480])
    assert ">4 s<" in plot


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium to open the page with")
def test_the_page_opens_in_a_browser(report: dict[str, Any], tmp_path: Path) -> None:
    page, shot = tmp_path / "report.html", tmp_path / "page.png"
    page.write_text(build_page(report), encoding="utf-8")
    command = [
        str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
        f"--user-data-dir={tmp_path / 'profile'}", "--window-size=1100,1800", f"--screenshot={shot}",
        page.as_uri(),
    ]  # fmt: skip
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    pixels = np.asarray(Image.open(shot).convert("RGB")).astype(int)
    own, peer = ((np.abs(pixels - color).max(axis=-1) < 12) for color in ((31, 111, 120), (180, 88, 42)))
    assert own.sum() > 1000, "the own curves are not drawn"
    assert peer.sum() > 200, "the peers' points are not drawn"
