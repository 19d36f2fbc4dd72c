"""`sdfprim convert`: files in, sets and one report out, whatever the files are like."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fit import export
from pipelines import convert
from pipelines.convert import ConvertSettings, FileProgress

ROW_KEYS = {
    "source", "status", "primitives", "kinds", "bytes", "seconds", "peak_rss_mb", "metrics", "air", "repairs",
    "ignored", "skipped_parts", "per_primitive",
}  # fmt: skip

METRIC_KEYS = {
    "surface_to_set_mean_m", "surface_to_set_p95_m", "surface_to_set_max_m", "covered_25cm",
    "covered_half_pct", "set_to_surface_mean_m", "false_solid", "air_distance_error_m",
    "air_distance_error_pct", "leaks", "blocked", "hit_error_pct", "largest_hole_m", "diag_m",
    "iou", "volume_error",
}  # fmt: skip


@pytest.fixture(scope="module")
def batch(
    wall: Path, broken_file: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[dict[str, Any], Path, list[list[str]]]:
    """A good file, a broken one, a good one of the first's name; and the report's rows after each file."""
    folder = tmp_path_factory.mktemp("batch")
    twin = folder / "twin" / wall.name
    twin.parent.mkdir()
    shutil.copy(wall, twin)
    output = folder / "out"
    states: list[list[str]] = []

    def finished(row: dict[str, Any]) -> None:
        states.append(
            [asset["status"] for asset in json.loads((output / "report.json").read_text())["assets"]]
        )

    settings = ConvertSettings((wall, broken_file, twin), output, max_primitives=8)
    return convert.run(settings, finished=finished), output, states


def test_a_bad_file_stops_nothing(batch: tuple[dict[str, Any], Path, list[list[str]]]) -> None:
    report, _, _ = batch
    assert [row["status"] for row in report["assets"]] == ["ok", "failed", "ok"]
    assert "broken.glb" in report["assets"][1]["error"]


def test_the_report_is_rewritten_after_every_file(
    batch: tuple[dict[str, Any], Path, list[list[str]]],
) -> None:
    _, _, states = batch
    assert states == [["ok"], ["ok", "failed"], ["ok", "failed", "ok"]]


def test_rows_have_the_promised_keys(batch: tuple[dict[str, Any], Path, list[list[str]]]) -> None:
    report, output, _ = batch
    assert json.loads((output / "report.json").read_text())["assets"] == json.loads(
        json.dumps([convert.EMPTY_ROW | row for row in report["assets"]], default=list)
    )
    for row in report["assets"]:
        assert set(row) >= ROW_KEYS
    good = report["assets"][0]
    assert set(good["metrics"]) >= METRIC_KEYS
    assert good["bytes"] == 64 * good["primitives"]
    assert sum(good["kinds"].values()) == good["primitives"] <= 8
    assert good["seconds"] > 0
    assert good["air"]
    assert len(good["per_primitive"]) == good["primitives"]


def test_results_carry_unique_names_and_agree(
    batch: tuple[dict[str, Any], Path, list[list[str]]], wall: Path
) -> None:
    report, output, _ = batch
    written = sorted(file.name for file in output.iterdir())
    names = [f"{wall.parent.name}_{wall.stem}", f"twin_{wall.stem}"]
    assert [report["assets"][0]["name"], report["assets"][2]["name"]] == names
    suffixes = (".prims.glb", ".prims.npz")
    assert written == sorted([f"{name}{suffix}" for name in names for suffix in suffixes] + ["report.json"])
    sets = [export.read(output / f"{names[0]}{suffix}") for suffix in suffixes]
    assert len(sets[0]) == len(sets[1]) == report["assets"][0]["primitives"]


def test_equal_inputs_give_equal_sets(
    batch: tuple[dict[str, Any], Path, list[list[str]]], wall: Path
) -> None:
    _, output, _ = batch
    first, second = (output / f"{name}_{wall.stem}.prims.glb" for name in (wall.parent.name, "twin"))
    assert first.read_bytes() == second.read_bytes()


def test_progress_names_file_and_stage() -> None:
    state = FileProgress(index=1, count=4, name="chair", stage="build", fraction=0.5)
    assert state.describe() == "[2/4] chair: build"
    assert state.share == pytest.approx(0.375)


def test_a_crash_is_a_row(wall: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(convert, "convert_file", os._exit)  # called with a path: dies of a TypeError at once
    row = convert.convert_isolated(wall, "wall", ConvertSettings((wall,), tmp_path), lambda *state: None)
    assert row["status"] == "failed"
    assert row["error"]


def test_a_result_may_not_replace_an_input(sdfprim: Callable[..., Any], wall: Path, tmp_path: Path) -> None:
    scene, earlier = tmp_path / "a.glb", tmp_path / "a.prims.glb"
    for file in (scene, earlier):
        shutil.copy(wall, file)
    ran = sdfprim("convert", scene, earlier, "-o", tmp_path)
    assert ran.code == 2
    assert "a.prims.glb would be overwritten" in ran.err


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_an_interrupt_keeps_what_is_finished(wall: Path, bundled_assets: Path, tmp_path: Path) -> None:
    program = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); " + (
        "from pipelines.cli import main; main()"
    )
    command = [sys.executable, "-c", program, "convert", "--max-primitives", "4"]
    files = [str(wall), str(bundled_assets / "atrium.glb")]
    process = subprocess.Popen(
        [*command, *files, "-o", str(tmp_path)], cwd=bundled_assets.parent, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    for line in process.stderr:
        if "[2/2]" in line:
            break
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    rest = process.stderr.read()
    assert process.wait(60) == 130
    assert "interrupted" in rest
    assert "Traceback" not in rest
    assert [row["status"] for row in json.loads((tmp_path / "report.json").read_text())["assets"]] == ["ok"]
    assert not [file for file in tmp_path.iterdir() if file.name.startswith(".")]
