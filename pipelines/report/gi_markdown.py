"""`report.md` of `bench gi`: the same figures as tables that fit into documentation and issues."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipelines.report.gi_advice import MEANINGS, advice_lines, describe
from pipelines.report.plots import short_number

Report = Mapping[str, Any]

LEGEND = (
    "*Fit*, *solver* and *total* error: mean square over mean squared truth of indirect irradiance at the "
    "mesh's points, in %, means over the views; *relMSE* (*99 %*: without the worst hundredth of the points) "
    "and mean *FLIP* are of the total error. *GI*: every pass that a picture without indirect light does not "
    "need, GPU milliseconds."
)

COLUMNS = {
    "GI": "gi_ms", "probes": "update_ms", "lookup": "lookup_ms", "frame": "frame_ms", "fit": "fit",
    "solver": "solver", "total": "total", "relMSE": "total_rel_mse", "relMSE 99 %": "total_trimmed",
    "FLIP": "flip",
}  # fmt: skip

IN_PERCENT = ("fit", "solver", "total")


def build_markdown(report: Report) -> str:
    """The advice, the presets, and for each scene a row for every setting."""
    lines = [" ".join(advice_lines(report)), "", *_made_with(report), LEGEND]
    if report["presets"]:
        rows = [[f"`{name}`, {MEANINGS[name]}", row] for name, row in report["presets"].items()]
        lines += ["", *_table("`--quality`", rows)]
    for scene in report["scenes"]:
        lines += ["", f"## {scene['name']}", ""]
        if scene["failure"]:
            lines.append(f"Failed: {scene['failure']}")
        else:
            lines += [*_views(scene), "", *_table("", [["", run] for run in scene["runs"]])]
            lines += _cullings(scene["runs"])
    return "\n".join(lines) + "\n"


def _made_with(report: Report) -> list[str]:
    if "adapter" not in report:
        return []
    width, height = report["timed_size"]
    settings, truth = report["settings"], report["settings"]["truth"]
    return [
        f"{report['adapter']}; times are medians of {settings['timed_frames']} frames at {width} x {height}, "
        f"errors after {settings['frames']} frames, truth by {truth['engine']}, seed {report['seed']}.",
        "",
    ]


def _cullings(runs: list[Report]) -> list[str]:
    """GI's milliseconds by every way to find the nearest primitive, where more than one was timed."""
    names = list(dict.fromkeys(name for run in runs for name in run.get("cullings_ms", {})))
    if len(names) < 2:
        return []
    lines = ["", f"| GI by culling | {' | '.join(names)} |", "|---" * (1 + len(names)) + "|"]
    for run in runs:
        times = [short_number(run["cullings_ms"].get(name)) for name in names]
        lines.append(f"| {describe(run)} | {' | '.join(times)} |")
    return lines


def _views(scene: Report) -> list[str]:
    return [
        f"- {view['name']}: {view['camera']}; {'; '.join(view['lights'])}; {view['points']:,} points, "
        f"{view['samples']} paths each, mean absolute noise {100 * view['noise']['mesh']:.1f} % of the mean"
        for view in scene["views"]
    ]


def _table(first: str, rows: list[list[Any]]) -> list[str]:
    titles = [first, "setting"] if first else ["setting"]
    head = [f"| {' | '.join([*titles, *COLUMNS])} |", "|---" * (len(titles) + len(COLUMNS)) + "|"]
    return head + [
        f"| {' | '.join([*([label] if first else []), describe(row), *_figures(row)])} |"
        for label, row in rows
    ]


def _figures(row: Report) -> list[str]:
    factors = {key: 100 if key in IN_PERCENT else 1 for key in COLUMNS.values()}
    return [short_number(None if row[key] is None else factors[key] * row[key]) for key in COLUMNS.values()]
