"""`report.md` of `bench fit`: the same figures as tables that fit into documentation and issues."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from pipelines.bench_fit_summary import value_of
from pipelines.report.fit_advice import Report, advice_lines
from pipelines.report.plots import short_number

COLUMNS = ("n", "E", "surface", "covered", "air error", "false solid", "leaks", "blocked", "IoU", "CPU s")

LEGEND = (
    "E, *covered* (within 0.5 % of the diagonal), *false solid*, *leaks* and *blocked* are in %, *surface* "
    "(its mean distance to the set) and *air error* in % of the bounding diagonal."
)

SERIES = {"step": "Steps that join one after the other", "kind": "Kinds left out"}


def build_markdown(report: Report) -> str:
    """All runs: one table over budgets and peers for all scenes, then for each scene its steps and kinds."""
    scenes = [scene for scene in report["scenes"] if not scene["failure"]]
    lines = [LEGEND, "", *_table("scene", "method, budget", _side_by_side(scenes))]
    for scene in scenes:
        lines += ["", f"## {scene['name']}", "", " ".join(advice_lines(scene))]
        for series, title in SERIES.items():
            runs = [run for run in scene["runs"] if run["series"] == series]
            if runs:
                rows = [(str(run["budget"]), run["label"], _figures(scene, run)) for run in runs]
                lines += ["", f"{title}:", "", *_table("budget", series, rows)]
    failures = [f"- {scene['name']}: {scene['failure']}" for scene in report["scenes"] if scene["failure"]]
    return "\n".join([*lines, *([""] if failures else []), *failures]) + "\n"


Row = tuple[str, str, Sequence[str]]


def _side_by_side(scenes: Sequence[Report]) -> Iterable[Row]:
    for scene in scenes:
        for run in scene["runs"]:
            if run["series"] in ("budget", "peer"):
                yield scene["name"], f"{run['method']}, {run['budget']}", _figures(scene, run)


def _figures(scene: Report, run: Report) -> list[str]:
    if run["failure"]:
        return [run["failure"].replace("|", "/"), *[""] * (len(COLUMNS) - 1)]
    surface = 100 * run["metrics"]["surface_to_set_mean_m"] / scene["diagonal_m"]
    return [
        str(run["primitives"]),
        f"{100 * run['error']:.2f}",
        f"{surface:.3f}",
        _percent(run, "covered_half_pct", 1),
        f"{run['metrics']['air_distance_error_pct']:.3f}",
        *(_percent(run, key, 2) for key in ("false_solid", "leaks", "blocked")),
        "-" if value_of(run, "iou") is None else f"{run['metrics']['iou']:.3f}",
        short_number(run["total_cpu_seconds"]),
    ]


def _percent(run: Report, key: str, digits: int) -> str:
    return f"{100 * run['metrics'][key]:.{digits}f}"


def _table(first: str, second: str, rows: Iterable[Row]) -> list[str]:
    head = f"| {first} | {second} | {' | '.join(COLUMNS)} |"
    return [
        head,
        "|---" * (2 + len(COLUMNS)) + "|",
        *(f"| {a} | {b} | {' | '.join(c)} |" for a, b, c in rows),
    ]
