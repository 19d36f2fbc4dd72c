"""`sdfprim bench gi` on a scene of 24 triangles: times, errors, presets, and a page that needs no network."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from fit import export
from fit.primitives import PrimitiveSet, make_box
from pipelines import bench_gi
from pipelines.gi_errors import TruthSettings
from pipelines.gi_presets import find_preset
from pipelines.reference.store import FOLDER
from pipelines.report.gi_advice import advice_lines
from pipelines.report.gi_page import build_page
from pipelines.studio import LightingOptions

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

CAMERAS = ("-3,1.5,2,0,0.8,0,60", "3,2,3,0,0.5,0,60")


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER, str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def benched(gpu: Any, wall: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """A floor with its wall and the floor alone, by two methods and in two views."""
    folder = tmp_path_factory.mktemp("bench")
    floor = make_box((0, -0.1, 0), (6, 0.2, 4), albedo=(0.5, 0.5, 0.5))
    both = PrimitiveSet.concatenate([floor, make_box((0, 1, 0), (0.06, 2, 3), albedo=(0.7, 0.4, 0.4))])
    files = (folder / "both.prims.npz", folder / "floor.prims.npz")
    for file, primitives in zip(files, (both, floor), strict=True):
        export.write(primitives, file)
    settings = bench_gi.GiBenchSettings(
        (wall,),
        folder / "out",
        TruthSettings("reference-gpu", samples=32),
        sets=files,
        budgets=(),
        methods=("sdfddgi", "ddgi-triangles"),
        probes=(18,),
        rays=(64,),
        cameras=CAMERAS,
        lighting=LightingOptions(sky="0.5,0.6,0.7", keep_file_lights=True),
        size=(32, 20),
        frames=6,
        timed_frames=2,
        cullings=("grid", "clusters"),
    )
    return bench_gi.run(settings, lambda text, share: None), settings.output


def test_every_run_has_its_times_and_its_errors(benched: tuple[dict[str, Any], Path]) -> None:
    _, folder = benched
    report = json.loads((folder / "report.json").read_text())
    (scene,) = report["scenes"]
    assert [(row["set"], row["method"]) for row in scene["runs"]] == [
        ("floor", "sdfddgi"), ("both", "sdfddgi"), ("both", "ddgi-triangles"), ("both", "none"),
    ], "the mesh is the same for every set"  # fmt: skip
    assert [view["name"] for view in scene["views"]] == ["view 1", "view 2"]
    for run in scene["runs"]:
        assert 0 < run["gi_ms"] < run["frame_ms"]
        assert run["frame_ms"] in (pytest.approx(sum(run["passes_ms"].values())), run["wall_ms"])
        assert run["gi_ms"] == pytest.approx(run["update_ms"] + run["lookup_ms"])
        totals = [run["views"][view]["total"]["irradiance"]["ratio"] for view in ("view 1", "view 2")]
        assert run["total"] == pytest.approx(np.mean(totals))
        assert totals[0] != totals[1]
        assert run["cullings_ms"]["grid"] == run["gi_ms"]
        assert ("clusters" in run["cullings_ms"]) == (run["method"] == "sdfddgi")
        assert all(milliseconds > 0 for milliseconds in run["cullings_ms"].values())
    _, both, mesh, dark = scene["runs"]
    fits = [row["views"]["view 2"]["fit"]["irradiance"]["ratio"] for row in scene["sets"]]
    assert fits == [run["views"]["view 2"]["fit"]["irradiance"]["ratio"] for run in scene["runs"][:2]]
    assert fits[0] != fits[1]
    assert dark["total"] == pytest.approx(1, abs=0.02)
    assert dark["update_ms"] == 0
    assert mesh["fit"] is None
    assert mesh["solver"] == mesh["total"] < 0.5 > both["total"]
    assert {"adapter", "settings", "seed", "version", "schema_version", "machine"} <= set(report)


def test_the_presets_are_settings_that_ran(benched: tuple[dict[str, Any], Path]) -> None:
    report, folder = benched
    assert set(report["presets"]) == {"fast", "balanced", "best"}
    best = find_preset("best", folder / "presets.json")
    least = min(row["total"] for row in report["tried"] if "total" in row["pareto"])
    row = report["presets"]["best"]
    assert row["total"] <= 1.05 * max(least, 1e-4)
    assert (best.gi, best.max_primitives, best.max_probes, best.rays_per_probe) == (
        row["method"], row["max_primitives"], 18, 64,
    )  # fmt: skip


def test_the_page_stands_alone_and_answers_first(benched: tuple[dict[str, Any], Path]) -> None:
    report, folder = benched
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert not re.findall(r"""(?:src|href)=["'](?!data:)|url\(|@import|https?://""", page)
    assert "$" not in page
    body = page[page.index("<body>") :]
    first = advice_lines(report)[0]
    assert first.startswith("Take balanced: ")
    assert body.index(first) < body.index('type="range"') < body.index("<svg")
    assert body.count('type="range"') == body.count('class="blink"') >= 5
    for words in ("Speed against error", "Which pass takes which time", "FLIP of the solver error"):
        assert words in body
    shown = sorted(path.name for path in folder.glob("*.png"))
    assert "two_colour_wall-view-1-mesh.png" in shown
    assert any(re.fullmatch(r"two_colour_wall-view-2-.*-sdfddgi-18-64-ours\.png", name) for name in shown)


def test_the_tables_hold_every_run(benched: tuple[dict[str, Any], Path]) -> None:
    report, folder = benched
    text = (folder / "report.md").read_text(encoding="utf-8")
    rows = [line.split(" | ") for line in text.splitlines() if line.startswith("| sdfddgi, 2 primitives")]
    assert len(rows) == 2, "errors and times, and times by culling"
    assert len(rows[1]) == 3
    (run,) = (
        run for run in report["scenes"][0]["runs"] if run["set"] == "both" and run["method"] == "sdfddgi"
    )
    assert float(rows[0][7]) == pytest.approx(100 * run["total"], rel=0.01)
    assert text.startswith("Take balanced: ")
    assert "view 2: " in text


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium to open the page with")
def test_the_first_screen_opens_in_a_browser(benched: tuple[dict[str, Any], Path], tmp_path: Path) -> None:
    _, folder = benched
    shot = tmp_path / "page.png"
    command = [
        str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
        "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={tmp_path / 'profile'}",
        "--window-size=1100,1200", f"--screenshot={shot}", (folder / "report.html").as_uri(),
    ]  # fmt: skip
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    pixels = np.asarray(Image.open(shot).convert("RGB")).astype(int)
    edge = np.abs(pixels - (31, 111, 120)).max(axis=-1) < 12
    red = (pixels[..., 0] > 120) & (pixels[..., 1] < 90) & (pixels[..., 2] < 90)
    assert edge.sum() > 100, "the advice's frame is not drawn"
    assert red.sum() > 5000, "the picture with the red wall is not on the first screen"


def test_a_scene_that_fails_does_not_stop_the_others(
    sdfprim: Callable[..., Any], broken_file: Path, tmp_path: Path
) -> None:
    ran = sdfprim("bench", "gi", broken_file, "-o", tmp_path, "--truth", "reference-gpu")
    assert ran.code == 1
    assert "failed   broken: " in ran.out
    assert "No setting can be advised" in ran.out
    assert "broken failed" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_what_failed_is_on_the_page(benched: tuple[dict[str, Any], Path]) -> None:
    report = json.loads((benched[1] / "report.json").read_text())
    failed = {"name": "c<d", "failure": "no face", "runs": [], "sets": [], "views": [], "notes": []}
    page = build_page(report | {"scenes": [failed], "presets": {}, "tried": []}, {})
    assert "c&lt;d failed: no face" in page
    assert "No setting can be advised" in page


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--gi", "none"), "--gi none"),
        (("--gi", "magic"), "--gi magic"),
        (("--rays", "65"), "--rays 65"),
        (("--probes", "4"), "--probes 4"),
        (("--samples", 1), "--samples 1"),
        (("--set", "nothing.npz"), "nothing.npz"),
        (("--timed-frames", 0), "--timed-frames 0"),
        (("--views", "nothing.toml"), "nothing.toml"),
        (("--views", "nothing.toml", "--sky", "1,1,1"), "leave those options out"),
        (("--presets", "finest"), "finest"),
        (("--sets", "nowhere"), "sdfprim convert"),
    ],
)
def test_wrong_usage(
    sdfprim: Callable[..., Any], wall: Path, tmp_path: Path, options: tuple[Any, ...], word: str
) -> None:
    ran = sdfprim("bench", "gi", wall, "--truth", "reference-gpu", *options, "-o", tmp_path / "out")
    assert ran.code == 2
    assert word in ran.err


def test_render_takes_a_preset(
    benched: tuple[dict[str, Any], Path], sdfprim: Callable[..., Any], wall: Path, tmp_path: Path
) -> None:
    _, folder = benched
    given = ("--presets", folder / "presets.json", "--set", folder.parent / "both.prims.npz", "--json")
    small = ("--size", "16x10", "--frames", 2, "-o", tmp_path / "a.png")
    ran = sdfprim("render", wall, *small, "--quality", "best", *given)
    assert ran.code == 0, ran.err
    assert ran.report["gi"] == find_preset("best", folder / "presets.json").gi
    assert sdfprim("render", wall, *small, "--quality", "best", "--gi", "ddgi").code == 2
    assert sdfprim("render", wall, *small, "--presets", folder / "presets.json").code == 2
