"""`report.html` of `bench gi`: which setting to take and what is lost, then the figures behind it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.report.curves import Point, curves
from pipelines.report.elements import facts, machine_fact, page, table, version_fact
from pipelines.report.gi_advice import MEANINGS, advice_lines, describe, percent
from pipelines.report.gi_pictures import best_beside_truth, pictures, sets_beside_truth
from pipelines.report.gi_tables import all_runs, by_scene, errors_in_full, passes, sets
from pipelines.report.pictures import data_uri
from pipelines.report.plots import short_number

UInt8 = NDArray[np.uint8]
Report = Mapping[str, Any]

JPEG_QUALITY = 95
"""Of embedded pictures; there are many, and the PNG files beside the page are exact."""


def build_page(report: Report, shown: Mapping[str, UInt8]) -> str:
    """The whole page; `report` holds JSON values only, `shown` are sRGB pixels (h, w, 3) by name."""
    sources = {name: data_uri(pixels, JPEG_QUALITY) for name, pixels in shown.items()}
    names = ", ".join(scene["name"] for scene in report["scenes"])
    sections = [
        f"<h1>{escape(names)}: which setting should I use, and what do I lose?</h1>",
        _advice(report),
        _presets(report),
        best_beside_truth(report, sources),
        by_scene(report) if len(report["scenes"]) > 1 else "",
        _tried(report),
        *(_scene(report, scene, sources) for scene in report["scenes"]),
        _definitions(report),
        _facts(report),
    ]
    return page(f"Light: {names}", sections)


def _advice(report: Report) -> str:
    first, *others = advice_lines(report)
    lines = "".join(f"<p>{escape(line)}</p>" for line in others)
    software = (
        '<p class="note">The adapter is a software renderer: its times, by the clock on the wall, say '
        "nothing about a graphics card, and so neither do these settings.</p>"
        if report.get("software_adapter")
        else ""
    )
    return f'<div class="advice"><p><strong>{escape(first)}</strong></p>{lines}</div>{software}'


def _presets(report: Report) -> str:
    """The three settings side by side."""
    presets = report["presets"]
    if not presets:
        return ""
    headers = [
        "--quality",
        "GI, ms",
        "frame, ms",
        "total error",
        "of the fit",
        "of the solver",
        "relMSE",
        "FLIP",
    ]
    rows = [[name, f"{describe(row)}: {MEANINGS[name]}", *_figures(row)] for name, row in presets.items()]
    return table(headers, rows)


def _figures(row: Report) -> list[str]:
    return [
        *(short_number(row[key]) for key in ("gi_ms", "frame_ms")),
        *(percent(row[key]) for key in ("total", "fit", "solver")),
        short_number(row["total_rel_mse"]),
        short_number(row["flip"]),
    ]


def _tried(report: Report) -> str:
    """Over time, of everything that was tried on all scenes."""
    rows = [row for row in report["tried"] if row["gi_ms"] is not None and row["method"] != "none"]
    if not rows:
        return ""
    plots = "".join(
        curves(_over(rows, "gi_ms", key, factor), "GPU ms of indirect light", title)
        for key, factor, title in (
            ("total", 100, "total error, %"),
            ("total_rel_mse", 1, "relMSE of the total error"),
            ("solver", 100, "solver error, %"),
            ("flip", 1, "mean FLIP of the pictures"),
        )
    )
    return (
        "<h2>Speed against error</h2><p>Filled: Pareto-best, nothing tried is better in less time; its "
        "label is the set's number of primitives. Lines join what one method gives from its cheapest to its "
        f'dearest setting. Point at a dot for its setting.</p><div class="plots">{plots}</div>'
    )


def _over(rows: Sequence[Report], cost: str, key: str, factor: float = 1.0) -> dict[str, list[Point]]:
    """Points by method."""
    found: dict[str, list[Point]] = {}
    for row in rows:
        value = row[key]
        if value is None:
            continue
        words = (
            f"{describe(row)}: {short_number(row['gi_ms'])} ms, total {percent(row['total'])}, "
            f"solver {percent(row['solver'])}, FLIP {row['flip']:.3f}"
        )
        best = ("total" if key == "solver" else key) in row["pareto"]
        point = Point(row[cost], factor * max(value, 0.0), str(row["max_primitives"]), words, best)
        found.setdefault(row["method"], []).append(point)
    return found


def _scene(report: Report, scene: Report, sources: Mapping[str, str]) -> str:
    name = escape(scene["name"])
    if scene["failure"]:
        return f'<div class="advice"><p>{name} failed: {escape(scene["failure"])}</p></div>'
    return "".join(
        (
            f"<h2>{name}</h2>",
            _scene_facts(scene),
            _over_setting(scene),
            all_runs(report, scene),
            passes(report, scene),
            sets(scene),
            sets_beside_truth(report, scene, sources),
            pictures(report, scene, sources),
            errors_in_full(scene),
            _notes(scene),
        )
    )


def _scene_facts(scene: Report) -> str:
    first = scene["views"][0]
    width, height = first["size"]
    shown = [
        ("File", scene["source"]),
        ("Judged", f"{width} x {height}, {first['exposure']:+g} EV"),
        ("Light", "; ".join(first["lights"])),
    ]
    for view in scene["views"]:
        noise = f"{view['samples']} paths a point, noise {percent(view['noise']['mesh'])} of the mean"
        shown.append((view["name"], f"{view['camera']}; {view['points']:,} points, {noise}"))
    return facts(shown)


def _over_setting(scene: Report) -> str:
    """Over primitives, probes and rays, one at a time: of runs that differ in one of them, the best."""
    plots = ""
    for cost, title in (("primitives", "primitives"), ("max_probes", "probes"), ("rays_per_probe", "rays")):
        runs = [run for run in scene["runs"] if run["method"] != "none" and run["total"] is not None]
        if len({run[cost] for run in runs}) < 2:
            continue
        for key, what in (("total", "total error, %"), ("gi_ms", "GPU ms of indirect light")):
            points = _least_over(runs, cost, key, 100 if key == "total" else 1)
            ticks = sorted({float(run[cost]) for run in runs})
            plots += curves(points, title, f"least {what}", x_ticks=ticks) if points else ""
    return f'<h3>What each of them buys</h3><div class="plots">{plots}</div>' if plots else ""


def _least_over(runs: Sequence[Report], cost: str, key: str, factor: float) -> dict[str, list[Point]]:
    found: dict[str, dict[float, Report]] = {}
    for run in runs:
        if run[key] is None:
            continue
        own = found.setdefault(run["method"], {})
        if run[cost] not in own or run[key] < own[run[cost]][key]:
            own[run[cost]] = run
    return {
        method: [
            Point(
                x,
                factor * max(run[key], 0.0),
                "",
                f"{describe(run)}: {short_number(factor * run[key])}",
                True,
            )
            for x, run in own.items()
        ]
        for method, own in found.items()
    }


def _notes(scene: Report) -> str:
    notes = "".join(f"<li>{escape(note)}</li>" for note in scene["notes"])
    return f"<h3>Notes</h3><ul>{notes}</ul>" if notes else ""


def _definitions(report: Report) -> str:
    return (
        "<h2>How to read this</h2><p>All errors are of indirect irradiance at the mesh's points, against "
        f"path tracing by {escape(report['settings']['truth']['engine'])}. <em>Fit</em>: the path-traced set "
        "against the path-traced mesh. <em>Solver</em>: the picture against the path-traced set. "
        "<em>Total</em>: the picture against the path-traced mesh. In percent they are the mean square over "
        "the mean squared truth, averaged over the views and, by geometric means, over scenes. Beside them "
        "stands relMSE, the mean of each point's own ratio: a point that is black in truth and lit in the "
        "picture counts up to ten thousand times there, so a few corners can hold nearly all of it; the "
        "column <em>of 99 %</em> leaves the worst hundredth of the points out. A method that sees the mesh "
        "has no fit between. FLIP and PSNR are of tone-mapped pictures. GI is every pass that a picture "
        "without indirect light does not need; shadow maps, drawn when a light or an object moves, are in "
        "no figure. Numbers of primitives and probes are limits; a set may need fewer, and a grid has what "
        "fits.</p>"
    )


def _facts(report: Report) -> str:
    settings = report["settings"]
    width, height = report.get("timed_size") or settings["size"]
    timed = f"medians of {settings['timed_frames']} frames at {width} x {height}, after they settled"
    return "<h2>Made with</h2>" + facts(
        (
            ("Adapter", report.get("adapter", "none")),
            machine_fact(report),
            ("Frames until judged", settings["frames"]),
            ("Times", timed),
            (
                "Path tracing",
                f"{settings['truth']['samples']} paths at most, seed {settings['truth']['seed']}",
            ),
            version_fact(report),
        )
    )
