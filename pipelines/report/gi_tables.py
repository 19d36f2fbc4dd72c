"""Tables and bars of the page of `bench gi`."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from pipelines.bench_gi_summary import SETTING, is_setting
from pipelines.report.elements import table
from pipelines.report.gi_advice import describe, percent
from pipelines.report.plots import short_number, stacked_bars

Report = Mapping[str, Any]


def qualities_of(report: Report, run: Report) -> list[str]:
    """Names of the presets that a run is."""
    return [name for name, row in report["presets"].items() if is_setting(run, row)]


def title_of(report: Report, run: Report) -> str:
    """A run in words, with the presets that it is."""
    names = ", ".join(qualities_of(report, run))
    return f"{describe(run)} ({names})" if names else describe(run)


def all_runs(report: Report, scene: Report) -> str:
    """Every setting, with its cost and its errors."""
    headers = [
        "setting",
        "GI ms",
        "probes",
        "lookup",
        "frame ms",
        "fit",
        "solver",
        "total",
        "relMSE",
        "of 99 %",
        "bias",
        "FLIP",
    ]
    rows = []
    for run in scene["runs"]:
        figures = [
            *(short_number(run[key]) for key in ("gi_ms", "update_ms", "lookup_ms", "frame_ms")),
            *(percent(run[key]) for key in ("fit", "solver", "total")),
            short_number(run["total_rel_mse"]),
            short_number(run["total_trimmed"]),
            _signed(run["bias"]),
            short_number(run["flip"]),
        ]
        rows.append([title_of(report, run), f"{run['primitives']} in the set", *figures])
    return f"<h3>Every setting</h3>{table(headers, rows)}"


def by_scene(report: Report) -> str:
    """Total error of every setting in each scene: the means hide what a scene does to a setting."""
    scenes = [scene for scene in report["scenes"] if scene["runs"]]
    found: dict[tuple[Any, ...], dict[str, Report]] = {}
    for scene in scenes:
        for run in scene["runs"]:
            found.setdefault(tuple(run[key] for key in SETTING), {})[scene["name"]] = run
    rows = []
    for (name, *_), runs in found.items():
        largest = max(runs.values(), key=lambda run: int(run["max_primitives"]))
        totals = [percent(runs[scene["name"]]["total"]) if scene["name"] in runs else "-" for scene in scenes]
        rows.append([title_of(report, largest), name, *totals])
    headers = ["setting", *(escape(scene["name"]) for scene in scenes)]
    return f"<h2>Total error in each scene</h2>{table(headers, rows)}"


def passes(report: Report, scene: Report) -> str:
    """Which part of the frame takes which time, in the presets and in light without GI; then every pass."""
    runs = [run for run in scene["runs"] if qualities_of(report, run) or run["method"] == "none"]
    if not runs or any(run["frame_ms"] is None for run in runs):
        return ""
    series = {
        "bring the probes up to date": [run["update_ms"] for run in runs],
        "look them up": [run["lookup_ms"] for run in runs],
        "the rest of the frame": [run["frame_ms"] - run["gi_ms"] for run in runs],
    }
    labels = [", ".join(qualities_of(report, run)) or run["method"] for run in runs]
    names = list(dict.fromkeys(name for run in runs for name in run["passes_ms"]))
    rows = [[name, "", *(short_number(run["passes_ms"].get(name)) for run in runs)] for name in names]
    return (
        f"<h3>Which pass takes which time</h3>{stacked_bars(series, labels, 'ms')}<p></p>"
        f"{table(['pass, GPU ms', *labels], rows)}"
    )


def sets(scene: Report) -> str:
    """The sets, and what each costs before anything is lit through it."""
    headers = ["set", "primitives", "bytes", "fit", "geometry", "material", "relMSE", "+-", "bias", "FLIP"]
    rows = []
    for row in scene["sets"]:
        for view, found in row["views"].items():
            fit = found["fit"]
            parts = (fit["irradiance"], found["geometry"]["irradiance"], found["material"])
            figures = [
                *(percent(part["ratio"]) for part in parts),
                *(short_number(fit["irradiance"][key]) for key in ("rel_mse", "standard_error")),
                _signed(fit["bias"]),
                short_number(fit["flip"]),
                percent(found["unplaced"]),
            ]
            rows.append([row["name"], view, str(row["primitives"]), f"{row['bytes']:,}", *figures])
    return (
        f"<h3>The sets, path traced</h3>{table([*headers, 'no free start'], rows)}<p>Fit error, with albedo "
        "0.5 everywhere (geometry), and what the colours add at each point (material).</p>"
    )


def errors_in_full(scene: Report) -> str:
    """Every error of every run in every view, and where the light is too bright or too dark."""
    headers = ["setting", "error", "relMSE", "+-", "of 99 %", "ratio", "numerator", "denominator", "bias"]
    headers += ["FLIP", "floor", "PSNR, dB", "floor"]
    rows, places = [], []
    names = list(scene["runs"][0]["views"][scene["views"][0]["name"]]["total"]["regions"])
    for run in scene["runs"]:
        for view, found in run["views"].items():
            for kind in ("solver", "total"):
                error = found[kind]
                keys = ("rel_mse", "standard_error", "trimmed", "ratio", "numerator", "denominator")
                sums = [short_number(error["irradiance"][key]) for key in keys]
                rest = [short_number(error[key]) for key in ("flip", "flip_floor", "psnr", "psnr_floor")]
                rows.append([describe(run), view, kind, *sums, _signed(error["bias"]), *rest])
            regions = found["total"]["regions"]
            biases = [_signed(regions[name]["bias"]) if name in regions else "-" for name in names]
            places.append([describe(run), view, *biases])
    return (
        f"<details><summary>All errors of every view</summary>{table(headers, rows)}</details>"
        "<details><summary>Where it is too bright or too dark: mean bias of the total error</summary>"
        f"{table(['setting', *(escape(name) for name in names)], places)}</details>"
    )


def _signed(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:+.1f} %"
