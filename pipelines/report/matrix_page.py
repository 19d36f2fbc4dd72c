"""`report.html` of a comparison of sets, methods and grids of probes, from its `report.json`."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.report.curves import Point, curves
from pipelines.report.elements import facts, machine_fact, page, table, tiles, version_fact
from pipelines.report.gi_advice import percent
from pipelines.report.pictures import data_uri, pair, single
from pipelines.report.plots import short_number

UInt8 = NDArray[np.uint8]


def build_page(report: Mapping[str, Any], pictures: Mapping[str, UInt8]) -> str:
    """The whole page; `report` holds JSON values only, `pictures` are sRGB pixels (h, w, 3) by name."""
    sources = {name: data_uri(pixels) for name, pixels in pictures.items()}
    sections = (
        _header(report),
        _knee_beside_truth(report, sources),
        _matrix(report),
        _curves(report),
        _errors(report),
        _regions(report),
        _pictures(report, sources),
        _notes(report),
    )
    return page(f"{_scene_name(report)}: sets and ways to light them", sections)


def _scene_name(report: Mapping[str, Any]) -> str:
    return str(report["settings"]["scene"]).rsplit("/", 1)[-1]


def _header(report: Mapping[str, Any]) -> str:
    width, height = report["size"]
    truth = report["truth"]
    shown = facts(
        (
            ("Adapter", report["adapter"]),
            machine_fact(report),
            ("Picture", f"{width} x {height}, {report['frames']} frames, {report['exposure']:+g} EV"),
            ("Camera", report["camera"]),
            ("Light", "; ".join(report["lights"])),
            ("Truth", f"{truth['engine']}, {truth['samples']} paths a point at most, seed {truth['seed']}"),
            version_fact(report),
        )
    )
    software = (
        '<p class="note">The adapter is a software renderer: the times say nothing about a graphics card.</p>'
        if report["software_adapter"]
        else ""
    )
    return (
        f"<h1>{escape(_scene_name(report))}: which set, lit in which way</h1>"
        f"{_advice(report)}"
        "<p>All errors are of indirect irradiance at the mesh's points, against path tracing: the mean "
        "square over the mean squared truth. <em>Fit</em>: path-traced primitives against the path-traced "
        "mesh. <em>Solver</em>: the picture against the path-traced primitives. <em>Total</em>: the picture "
        "against the path-traced mesh. relMSE, where each point counts by its own truth, is in the table of "
        "all errors; black corners can hold nearly all of it, so <em>of 99 %</em> leaves out the worst "
        "hundredth.</p>"
        f"{shown}{software}"
    )


def _advice(report: Mapping[str, Any]) -> str:
    """For each way to light, the smallest set that is about as good as any."""
    figures = []
    for column, name in report["knee"].items():
        if name is None:
            continue
        row = next(row for row in report["sets"] if row["name"] == name)
        total = _percent(row["cells"][column]["errors"]["total"])
        fit = _percent(row["errors"]["fit"])
        words = (
            f"primitives are enough for {column} ({name}): total error {total} of the squared light, {fit} "
            "by the fit alone"
        )
        figures.append((str(row["primitives"]), words))
    factor = report["knee_factor"]
    return (
        f"<h2>How many primitives are enough</h2>{tiles(figures)}"
        f"<p>The smallest set whose total error is at most {factor:g} times the least of its column.</p>"
    )


def _knee_beside_truth(report: Mapping[str, Any], sources: Mapping[str, str]) -> str:
    """The first way to light, through the set that is enough for it."""
    column, name = next(((c, n) for c, n in report["knee"].items() if n is not None), (None, None))
    if column is None:
        return ""
    tags = ("the truth: the mesh, path traced", f"{name}, {column}")
    return pair(sources, ("mesh", f"{name}, {column}"), tags, "Drag to compare, or blink.")


def _matrix(report: Mapping[str, Any]) -> str:
    headers = ["set", "fit", "solver", "probes' floor", "total", "relMSE of 99 %", "bias", "FLIP", "GPU ms"]
    rows = []
    for row in report["sets"]:
        fit = row["errors"]["fit"]
        words = f"{row['primitives']} primitives, path traced"
        shown = [
            _percent(fit),
            "-",
            "-",
            _percent(fit),
            _trimmed(fit),
            _bias(fit["bias"]),
            f"{fit['flip']:.3f}",
            "-",
        ]
        rows.append([row["name"], words, *shown])
        for column, cell in row["cells"].items():
            solver, total = cell["errors"]["solver"], cell["errors"]["total"]
            floor = _percent(cell["errors"]["floor"]) if "floor" in cell["errors"] else "-"
            shown = [
                _percent(solver),
                floor,
                _percent(total),
                _trimmed(total),
                _bias(total["bias"]),
                f"{total['flip']:.3f}",
            ]
            label = f"{row['name']}, {column}" + (" (knee)" if report["knee"][column] == row["name"] else "")
            rows.append([label, "", _percent(fit), *shown, short_number(cell["frame_ms"])])
    return f"<h2>Every set by every way to light it</h2>{table(headers, rows)}"


def _curves(report: Mapping[str, Any]) -> str:
    """Over primitives: the errors, and the time of a frame where the adapter tells it."""
    if len(report["sets"]) < 2:
        return ""
    errors = {"fit": [_point(row, _value(row["errors"]["fit"]), True) for row in report["sets"]]}
    times = {}
    for column in report["columns"]:
        cells = [(row, row["cells"][column]) for row in report["sets"]]
        errors[column] = [
            _point(row, _value(cell["errors"]["total"]), report["knee"][column] == row["name"])
            for row, cell in cells
        ]
        times[column] = [_point(row, cell["frame_ms"], True) for row, cell in cells]
    plots = curves(_known(errors), "primitives", "error, %: fit, and total of each way to light")
    plots += curves(_known(times), "primitives", "GPU ms of a frame")
    return f'<h2>Error and time over primitives</h2><div class="plots">{plots}</div>'


def _value(error: Mapping[str, Any]) -> float | None:
    value = error["irradiance"]["ratio"]
    return None if value is None else 100 * max(value, 0.0)


def _point(row: Mapping[str, Any], value: float | None, best: bool) -> Point | None:
    if value is None:
        return None
    words = f"{row['name']}: {row['primitives']} primitives, {short_number(value)}"
    return Point(row["primitives"], value, str(row["primitives"]), words, best)


def _known(series: Mapping[str, list[Point | None]]) -> dict[str, list[Point]]:
    return {name: [point for point in points if point is not None] for name, points in series.items()}


def _errors(report: Mapping[str, Any]) -> str:
    """Every error in full, with its floors."""
    headers = [
        "error",
        "relMSE",
        "+-",
        "of 99 %",
        "ratio",
        "numerator",
        "denominator",
        "bias",
        "FLIP",
        "floor",
        "PSNR, dB",
        "floor",
    ]
    rows = []
    for row in report["sets"]:
        for key in ("fit", "geometry"):
            rows.append([f"{row['name']}: {key}", _REMARKS[key], *_full(row["errors"][key])])
        material = row["errors"]["material"]
        rows.append([f"{row['name']}: material", _REMARKS["material"], *_sums(material), *["-"] * 5])
        for column in report["columns"]:
            for key, error in row["cells"][column]["errors"].items():
                rows.append([f"{row['name']}, {column}: {key}", "", *_full(error)])
    noise = "".join(
        f"<li>{escape(row['name'])}: "
        + ", ".join(f"{escape(name)} {100 * share:.2f} %" for name, share in row["noise"].items())
        + f"; {100 * row['unplaced']:.2f} % of the points find no free start and count as black</li>"
        for row in report["sets"]
    )
    return (
        f"<h2>All errors</h2>{table(headers, rows)}<p>FLIP and PSNR are of tone-mapped pictures; their "
        "floors are what the two halves of the reference differ by. Mean absolute noise of the references, "
        f"as a share of their mean:</p><ul>{noise}</ul>"
    )


_REMARKS = {
    "fit": "primitives against mesh, both path traced",
    "geometry": "the same with albedo 0.5 everywhere",
    "material": "what the colours add at each point",
}


def _regions(report: Mapping[str, Any]) -> str:
    names = list(report["sets"][0]["errors"]["fit"]["regions"])
    headers = ["mean bias", *(escape(name) for name in names)]
    rows = []
    for row in report["sets"]:
        rows.append([f"{row['name']}: fit", "", *_biases(row["errors"]["fit"], names)])
        for column in report["columns"]:
            total = row["cells"][column]["errors"]["total"]
            rows.append([f"{row['name']}, {column}: total", "", *_biases(total, names)])
    return f"<h2>Where it is too bright or too dark</h2>{table(headers, rows)}"


def _pictures(report: Mapping[str, Any], sources: Mapping[str, str]) -> str:
    parts = ["<h2>Pictures</h2>"]
    for row in report["sets"]:
        through = f"{row['name']}, set"
        tags = ("the mesh, path traced", f"{row['name']}, {row['primitives']} primitives, path traced")
        parts.append(f"<h3>{escape(row['name'])}</h3>")
        parts.append(pair(sources, ("mesh", through), tags, "What the fit costs. Drag to compare."))
        for column in report["columns"]:
            name = f"{row['name']}, {column}"
            parts.append(pair(sources, ("mesh", name), (tags[0], column), f"{name}, against the truth."))
        maps = "".join(
            single(
                sources[f"{row['name']}, {column}, total flip"], f"FLIP map of {column}; bright is different."
            )
            for column in report["columns"]
        )
        parts.append(f'<p></p><div class="row">{maps}</div>')
    return "".join(parts)


def _notes(report: Mapping[str, Any]) -> str:
    notes = "".join(f"<li>{escape(note)}</li>" for note in report["notes"])
    return f"<h2>Notes</h2><ul>{notes}</ul>" if notes else ""


def _full(error: Mapping[str, Any]) -> list[str]:
    rest = (error["flip"], error["flip_floor"], error["psnr"], error["psnr_floor"])
    return [*_sums(error["irradiance"]), _bias(error["bias"]), *(short_number(value) for value in rest)]


def _sums(error: Mapping[str, Any]) -> list[str]:
    keys = ("rel_mse", "standard_error", "trimmed", "ratio", "numerator", "denominator")
    return [short_number(error[key]) for key in keys]


def _biases(error: Mapping[str, Any], names: list[str]) -> list[str]:
    regions = error["regions"]
    return [_bias(regions[name]["bias"]) if name in regions else "-" for name in names]


def _bias(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:+.1f} %"


def _percent(error: Mapping[str, Any]) -> str:
    return percent(error["irradiance"]["ratio"])


def _trimmed(error: Mapping[str, Any]) -> str:
    return short_number(error["irradiance"]["trimmed"])
