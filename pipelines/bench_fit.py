"""`sdfprim bench fit`: error and seconds over budgets, by kind, by step of the method, and beside peers."""

from __future__ import annotations

import csv
import io
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipelines.bench_fit_summary import COSTS, summarize
from pipelines.console import Terminal, Update
from pipelines.convert import check_air, input_names, make_folder, require_file
from pipelines.documents import report_header, to_json_value, write_json, write_text
from pipelines.errors import UsageError
from pipelines.worker import Job, Outcome, run_isolated

if TYPE_CHECKING:
    from pipelines.bench_fit_jobs import Trial

BUDGETS = (4, 8, 16, 32, 64, 128, 256, 512)

DETAIL = 64
"""Budget at which kinds and steps are left out, or the nearest one asked for."""

EMPTY_RUN: dict[str, Any] = {
    "scene": None,
    "series": None,
    "label": None,
    "method": "sdfprim",
    "budget": None,
    "status": "failed",
    "failure": None,
    "primitives": None,
    "kinds": {},
    "bytes": None,
    "cpu_seconds": None,
    "total_cpu_seconds": None,
    "wall_seconds": None,
    "peak_rss_mb": None,
    "error": None,
    "metrics": None,
    "by_kind": {},
    "stages": {},
    "pareto": {},
    "notes": [],
}
"""Every run of the report has these keys; a failed one keeps the values that it has here."""


@dataclass(frozen=True)
class BenchSettings:
    """What `bench fit` was asked for.

    details: leave out kinds and steps as well; timeout: seconds that one run may take; air: as for `convert`.
    """

    files: tuple[Path, ...]
    output: Path
    budgets: tuple[int, ...] = BUDGETS
    details: bool = True
    peers: bool = False
    peer_budgets: tuple[int, ...] = (DETAIL,)
    air: tuple[str, ...] = ()
    scale: float = 1.0
    seed: int = 0
    timeout: float = 300.0

    @property
    def detail(self) -> int:
        """The budget at which kinds and steps are left out."""
        return min(self.budgets, key=lambda budget: abs(budget - DETAIL))

    @property
    def page(self) -> Path:
        """The report for people."""
        return self.output / "report.html"


@dataclass(frozen=True)
class Run:
    """One process: the job, its arguments after the scene's store, and the rows that it fills."""

    job: Job
    arguments: tuple[Any, ...]
    rows: dict[str, dict[str, Any]]

    @property
    def label(self) -> str:
        """What is at work, in words."""
        first = next(iter(self.rows.values()))
        return f"{first['method']} {first['label']}"


@dataclass
class Bench:
    """The report as it grows; written to the folder after every run, so that an interrupt costs one run."""

    settings: BenchSettings
    update: Update
    report: dict[str, Any]
    done: int = 0
    count: int = 1
    spent: dict[str, float] = field(default_factory=dict)

    def run_scene(self, file: Path, name: str, folder: Path) -> None:
        """Makes one scene ready and runs everything on it."""
        from pipelines import bench_fit_jobs as jobs

        settings = self.settings
        scene: dict[str, Any] = {"name": name, "source": file.as_posix(), "status": "failed", "failure": None}
        scene |= {"triangles": None, "diagonal_m": None, "air": [], "cpu_seconds": None, "stages": {}}
        scene |= {"runs": [], "summary": summarize([])}
        self.report["scenes"].append(scene)
        store = folder / f"{name}.pickle"
        outcome = self._isolated(
            name, "prepare", jobs.prepare, file, settings.scale, settings.air, settings.seed, store
        )
        if outcome.error is not None:
            scene["failure"] = outcome.error
            self.done += len(list(plan(settings, name)))
        else:
            scene |= outcome.result | {"status": "ok"}
            for run in plan(settings, name):
                self._run(scene, run, store)
        self.write()
        store.unlink(missing_ok=True)

    def _run(self, scene: dict[str, Any], run: Run, store: Path) -> None:
        outcome = self._isolated(scene["name"], run.label, run.job, store, *run.arguments)
        for key, row in run.rows.items():
            if outcome.error is None:
                found = outcome.result[key] if len(run.rows) > 1 else outcome.result
                row |= found | {"status": "ok"}
                row["total_cpu_seconds"] = scene["cpu_seconds"] + row["cpu_seconds"]
            else:
                row |= {"failure": outcome.error, "wall_seconds": outcome.seconds}
            row["peak_rss_mb"] = outcome.peak_rss_mb
            scene["runs"].append(row)
        scene["summary"] = summarize(scene["runs"])
        self.write()

    def _isolated(self, scene: str, label: str, job: Job, *arguments: Any) -> Outcome:
        start = self.done

        def at_stage(stage: str, fraction: float) -> None:
            self.update(f"{scene}, {label}: {stage}", (start + min(fraction, 1.0) * 0.9) / self.count)

        outcome = run_isolated(job, *arguments, timeout=self.settings.timeout, progress=at_stage)
        self.done += 1
        return outcome

    def write(self) -> None:
        """`report.json`, `.csv`, `.md` and `.html` of what is done so far."""
        from pipelines.report.fit_markdown import build_markdown
        from pipelines.report.fit_page import build_page

        folder = self.settings.output
        write_json(folder / "report.json", self.report)
        write_text(folder / "report.csv", to_csv(self.report))
        values = to_json_value(self.report)
        write_text(folder / "report.md", build_markdown(values))
        write_text(self.settings.page, build_page(values))


def run(settings: BenchSettings, update: Update) -> dict[str, Any]:
    """Runs everything on every scene and returns the report; each run is a process with a time limit.

    Raises:
        UsageError: a file is missing, the options make no sense, or a peer is not installed.
    """
    check(settings)
    names = input_names(settings.files)
    make_folder(settings.output)
    report = report_header("bench fit", settings, settings.seed) | {"scenes": []}
    count = len(names) * (1 + len(list(plan(settings, ""))))
    bench = Bench(settings, update, report, count=count)
    with tempfile.TemporaryDirectory(prefix="sdfprim-bench-") as folder:
        for file, name in zip(settings.files, names, strict=True):
            bench.run_scene(file, name, Path(folder))
    return report


def check(settings: BenchSettings) -> None:
    """Raises UsageError for what can be seen to be wrong before any work is done."""
    if not settings.files:
        raise UsageError("no file given: name at least one .gltf or .glb")
    for file in settings.files:
        require_file(file)
    check_air(settings.air)
    for option, value in (("--scale", settings.scale), ("--timeout", settings.timeout)):
        if not 0 < value < float("inf"):
            raise UsageError(f"{option} {value}: give a number above zero")
    if settings.peers:
        from pipelines.bench_fit_peers import require_peers

        require_peers()


def plan(settings: BenchSettings, scene: str) -> Iterator[Run]:
    """All runs on a scene: every budget; steps joining one by one; kinds left out; the peers."""
    from fit.shapes import KINDS
    from fit.solve import STEPS
    from pipelines.bench_fit_jobs import Trial

    for budget in settings.budgets:
        yield _fit_run(scene, "budget", str(budget), Trial(budget, KINDS, STEPS), settings.seed)
    if settings.details:
        yield from _detail_runs(settings, scene)
    if settings.peers:
        yield from _peer_runs(settings, scene)


def _detail_runs(settings: BenchSettings, scene: str) -> Iterator[Run]:
    from fit.shapes import KINDS
    from fit.solve import STEPS
    from pipelines.bench_fit_jobs import Trial

    budget = settings.detail
    for last in range(1, len(STEPS)):
        label = STEPS[0] if last == 1 else f"+ {STEPS[last - 1]}"
        yield _fit_run(scene, "step", label, Trial(budget, KINDS, STEPS[:last]), settings.seed)
    for kind in KINDS:
        others = tuple(other for other in KINDS if other != kind)
        yield _fit_run(scene, "kind", f"without {kind}", Trial(budget, others, STEPS), settings.seed)


def _fit_run(scene: str, series: str, label: str, trial: Trial, seed: int) -> Run:
    from pipelines.bench_fit_jobs import fit_once

    row = EMPTY_RUN | {"scene": scene, "series": series, "label": label, "budget": trial.budget}
    return Run(fit_once, (trial, seed), {label: row})


def _peer_runs(settings: BenchSettings, scene: str) -> Iterator[Run]:
    from pipelines.bench_fit_jobs import run_peer
    from pipelines.bench_fit_peers import PACKAGES, VARIANTS

    for peer in PACKAGES:
        for budget in settings.peer_budgets:
            shared = EMPTY_RUN | {"scene": scene, "series": "peer", "label": str(budget), "budget": budget}
            rows: dict[str, dict[str, Any]] = {
                variant: shared | {"method": f"{peer} {variant}"} for variant in VARIANTS
            }
            yield Run(run_peer, (peer, budget, settings.seed), rows)


CSV_KEYS = (
    "scene", "series", "label", "method", "budget", "status", "failure", "primitives", "bytes", "error",
    "cpu_seconds", "total_cpu_seconds", "wall_seconds", "peak_rss_mb",
)  # fmt: skip


def to_csv(report: dict[str, Any]) -> str:
    """A line for each run: its own figures, its metrics, the count of each kind, where it is Pareto-best."""
    runs = [run for scene in report["scenes"] for run in scene["runs"]]
    metrics = list(dict.fromkeys(key for run in runs for key in run["metrics"] or {}))
    kinds = list(dict.fromkeys(kind for run in runs for kind in run["kinds"]))
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([*CSV_KEYS, *metrics, *kinds, *(f"pareto_by_{cost}" for cost in COSTS)])
    for run in runs:
        figures = to_json_value(
            [*(run[key] for key in CSV_KEYS), *((run["metrics"] or {}).get(key) for key in metrics)]
            + [run["kinds"].get(kind) for kind in kinds]
        )
        writer.writerow([*figures, *(" ".join(run["pareto"].get(cost, ())) for cost in COSTS)])
    return stream.getvalue()


def failed(report: dict[str, Any]) -> bool:
    """Whether a scene or a fit failed; a peer that did is a result."""
    return any(
        scene["failure"] or any(run["failure"] and run["series"] != "peer" for run in scene["runs"])
        for scene in report["scenes"]
    )


SHOWN: dict[str, Callable[[dict[str, Any]], Any]] = {
    "run": lambda run: f"{run['method']}, {run['label']}",
    "set": lambda run: run["primitives"],
    "error": lambda run: run["error"],
    "air error, % of diagonal": lambda run: (run["metrics"] or {}).get("air_distance_error_pct"),
    "leaks": lambda run: (run["metrics"] or {}).get("leaks"),
    "blocked": lambda run: (run["metrics"] or {}).get("blocked"),
    "false solid": lambda run: (run["metrics"] or {}).get("false_solid"),
    "CPU s": lambda run: run["total_cpu_seconds"],
}
"""Columns of the printed tables."""


def show(report: dict[str, Any], settings: BenchSettings, terminal: Terminal) -> None:
    """Prints a table and the advice for each scene, then what failed and where the report lies."""
    from pipelines.report.fit_advice import advice_in_words

    for scene in report["scenes"]:
        rows = [[column(run) for column in SHOWN.values()] for run in scene["runs"]]
        terminal.table(list(SHOWN), rows, title=scene["name"])
        terminal.line(advice_in_words(scene))
        if scene["failure"]:
            terminal.line(f"failed   {scene['name']}: {scene['failure']}")
        for run in scene["runs"]:
            if run["failure"]:
                terminal.line(f"failed   {scene['name']}, {run['method']} {run['label']}: {run['failure']}")
    terminal.line(f"report   {settings.page}")
