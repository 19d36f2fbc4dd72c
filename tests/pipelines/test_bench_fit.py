"""`sdfprim bench fit`: the runs, the report that grows with them, and what it advises."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fit.shapes import KINDS
from fit.solve import STEPS
from pipelines import bench_fit
from pipelines.bench_fit_summary import ENOUGH_FOR_LIGHT, advise, mark_pareto, monotony, pareto_best
from pipelines.worker import Outcome

SCENE = {
    "triangles": 24, "diagonal_m": 5.0, "stages": {"load": 0.25, "air": 0.75}, "cpu_seconds": 1.0,
    "wall_seconds": 1.5, "air": [{"point": [0, 1, 0], "volume": 8.0, "evidence": "the outside"}],
}  # fmt: skip


def row(budget: int, error: float, seconds: float = 1.0, **metrics: float) -> dict[str, Any]:
    """A run that succeeded, good enough for light unless `metrics` say otherwise."""
    good = {"leaks": 0.01, "blocked": 0.01, "false_solid": 0.0, "air_distance_error_pct": 0.1, "iou": None}
    return {
        "budget": budget, "primitives": budget, "bytes": 64 * budget,
        "kinds": {"box": budget - 1, "plane": 1}, "error": error,
        "cpu_seconds": seconds, "wall_seconds": seconds, "total_cpu_seconds": seconds,
        "metrics": good | {"surface_to_set_mean_m": error, "covered_half_pct": 0.9} | metrics,
        "stages": {"build": seconds},
        "by_kind": {"box": {"surface_share": 0.9, "surface_to_set_mean_m": 0.1}}, "notes": [], "status": "ok",
    }  # fmt: skip


class Workers:
    """Stands in for the worker: canned outcomes, and whatever a test wants to happen at one of the calls."""

    def __init__(self, at: dict[int, BaseException | str] | None = None) -> None:
        self.at, self.calls = at or {}, 0

    def __call__(self, job: Any, *arguments: Any, timeout: float, progress: Any) -> Outcome:
        self.calls += 1
        planned = self.at.get(self.calls)
        if isinstance(planned, BaseException):
            raise planned
        if isinstance(planned, str):
            return Outcome(None, planned, 3.0, 100.0)
        progress("build", 0.5)
        return Outcome(self._result(job.__name__, arguments), None, 2.0, 100.0)

    def _result(self, job: str, arguments: tuple[Any, ...]) -> Any:
        if job == "prepare":
            return SCENE
        if job == "fit_once":
            trial = arguments[1]
            return row(trial.budget, 1 / trial.budget, trial.budget / 8)
        return {"boxes": row(arguments[2], 0.5), "best primitives": row(arguments[2], 0.4)}


@pytest.fixture
def bench(
    sdfprim: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, wall: Path, tmp_path: Path
) -> Callable[..., Any]:
    """Runs `bench fit` on one scene into `tmp_path` with canned outcomes."""

    def run(*options: object, at: dict[int, BaseException | str] | None = None) -> Any:
        monkeypatch.setattr(bench_fit, "run_isolated", Workers(at))
        return sdfprim("bench", "fit", wall, "-o", tmp_path, *options)

    return run


def read(folder: Path) -> dict[str, Any]:
    report: dict[str, Any] = json.loads((folder / "report.json").read_text())
    return report


def test_every_budget_kind_and_step_is_a_run(bench: Callable[..., Any], tmp_path: Path) -> None:
    ran = bench("--budgets", "32,4,128", "--seed", 7)
    assert ran.code == 0, ran.err
    report = read(tmp_path)
    assert (report["command"], report["schema_version"], report["seed"]) == ("bench fit", 1, 7)
    assert {"processor", "libraries"} <= set(report["machine"])
    runs = report["scenes"][0]["runs"]
    series = {name: [run for run in runs if run["series"] == name] for name in ("budget", "step", "kind")}
    assert [run["budget"] for run in series["budget"]] == [4, 32, 128]
    assert len(series["step"]) == len(STEPS) - 1
    assert [run["label"] for run in series["kind"]] == [f"without {kind}" for kind in KINDS]
    assert {run["budget"] for name in ("step", "kind") for run in series[name]} == {32}
    assert all(run["total_cpu_seconds"] == run["cpu_seconds"] + SCENE["cpu_seconds"] for run in runs)


def test_without_details_there_are_budgets_alone(bench: Callable[..., Any], tmp_path: Path) -> None:
    bench("--budgets", "4,32", "--no-details")
    assert [run["series"] for run in read(tmp_path)["scenes"][0]["runs"]] == ["budget", "budget"]


def test_the_csv_has_the_same_runs(bench: Callable[..., Any], tmp_path: Path) -> None:
    bench("--budgets", "4,32")
    runs = read(tmp_path)["scenes"][0]["runs"]
    with (tmp_path / "report.csv").open(newline="") as stream:
        lines = list(csv.DictReader(stream))
    assert [line["label"] for line in lines] == [run["label"] for run in runs]
    assert float(lines[0]["leaks"]) == runs[0]["metrics"]["leaks"]
    assert (lines[0]["box"], lines[0]["iou"], lines[0]["status"]) == ("3", "", "ok")
    assert "error" in lines[1]["pareto_by_primitives"].split()


def test_a_failed_run_is_a_row_and_the_others_go_on(bench: Callable[..., Any], tmp_path: Path) -> None:
    ran = bench("--budgets", "4,32", at={2: "the worker process died of SIGSEGV in stage 'build'"})
    assert ran.code == 1
    first, second, *_ = read(tmp_path)["scenes"][0]["runs"]
    assert (first["status"], first["wall_seconds"], first["metrics"]) == ("failed", 3.0, None)
    assert second["status"] == "ok"
    assert "SIGSEGV" in ran.out
    assert "SIGSEGV" in (tmp_path / "report.html").read_text()


def test_a_scene_that_fails_costs_itself_only(
    bench: Callable[..., Any], tmp_path: Path, bundled_assets: Path
) -> None:
    ran = bench(bundled_assets / "cornell.glb", "--budgets", "4", at={1: "no face of the scene stops light"})
    assert ran.code == 1
    wall, cornell = read(tmp_path)["scenes"]
    assert (wall["status"], wall["runs"]) == ("failed", [])
    assert cornell["status"] == "ok"
    assert "no face of the scene stops light" in (tmp_path / "report.html").read_text()


def test_an_interrupt_leaves_what_is_done(bench: Callable[..., Any], tmp_path: Path) -> None:
    ran = bench("--budgets", "4,32", at={4: KeyboardInterrupt()})
    assert ran.code == 130
    assert [run["budget"] for run in read(tmp_path)["scenes"][0]["runs"]] == [4, 32]
    assert (tmp_path / "report.csv").read_text().count("\n") == 3
    assert "take 4." in (tmp_path / "report.html").read_text()


def test_peers_stand_beside_and_their_failure_is_a_result(
    bench: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipelines.bench_fit_peers.require_peers", lambda: None)
    own = 1 + 1 + len(STEPS) - 1 + len(KINDS)
    ran = bench("--budgets", "16", "--peers", "--peer-budgets", "16", at={own + 2: "stopped after 300 s"})
    assert ran.code == 0, ran.err
    peers = [run for run in read(tmp_path)["scenes"][0]["runs"] if run["series"] == "peer"]
    assert [run["method"] for run in peers] == [
        "vhacd boxes", "vhacd best primitives", "coacd boxes", "coacd best primitives",
    ]  # fmt: skip
    assert [run["status"] for run in peers] == ["ok", "ok", "failed", "failed"]
    assert [run["error"] for run in peers[:2]] == [0.5, 0.4]


def test_peers_that_are_not_installed_name_the_extra(
    bench: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipelines.bench_fit_peers.util.find_spec", lambda name: None)
    ran = bench("--peers")
    assert ran.code == 2
    assert "sdfprim[peers]" in ran.err


@pytest.mark.parametrize("text", ["0", "4,-8", "4;8", "many", "4.5"])
def test_budgets_are_whole_numbers(bench: Callable[..., Any], text: str) -> None:
    ran = bench("--budgets", text)
    assert ran.code == 2
    assert "--budgets" in ran.err


# ----------------------------------------------------------------------------------------------- summary


def test_pareto_best_are_those_that_nothing_beats() -> None:
    rows = [row(4, 0.5), row(8, 0.6), row(16, 0.2), row(16, 0.3), row(32, 0.2)]
    assert [(r["budget"], r["error"]) for r in pareto_best(rows, "primitives", "error")] == [
        (4, 0.5),
        (16, 0.2),
    ]
    mark_pareto(rows)
    assert ["error" in r["pareto"]["primitives"] for r in rows] == [True, False, True, False, False]


def test_monotony_finds_the_rise_over_the_least_before() -> None:
    falling = monotony([row(16, 0.2), row(4, 0.5), row(8, 0.3)])
    assert (falling["holds"], falling["rises"]) == (True, [])
    slight = monotony([row(4, 0.2), row(8, 0.2 * 1.015)])
    assert slight["holds"]
    assert slight["rises"][0]["rise"] == pytest.approx(0.015)
    creeping = monotony([row(4, 0.2), row(8, 0.2 * 1.015), row(16, 0.2 * 1.03)])
    assert not creeping["holds"]
    assert creeping["rises"][-1]["from"] == 4


def test_the_smallest_budget_that_is_enough_is_advised() -> None:
    rows = [row(4, 0.5, leaks=0.3), row(16, 0.2, leaks=0.019), row(64, 0.05, leaks=0.001)]
    advice = advise(rows)
    assert advice == {"budget": 16, "primitives": 16, "enough": True, "missed": [], "best_budget": 64}


def test_where_none_is_enough_nearly_the_best_is_advised() -> None:
    leaky = 2 * ENOUGH_FOR_LIGHT["leaks"]
    rows = [row(4, 0.5, leaks=leaky), row(16, 0.21, leaks=leaky), row(64, 0.2, leaks=leaky)]
    advice = advise(rows)
    assert advice is not None
    assert (advice["budget"], advice["enough"], advice["missed"]) == (16, False, ["leaks"])
    assert advise([]) is None
