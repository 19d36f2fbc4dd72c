"""`report.html` of a comparison, from the same report that `report.json` holds."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.quantities import METRICS, quantity
from pipelines.report.elements import (
    facts,
    machine_fact,
    page,
    spaces,
    table,
    tiles,
    version_fact,
)
from pipelines.report.pictures import data_uri, pair
from pipelines.report.plots import bars, short_number

UInt8 = NDArray[np.uint8]

SETS = ("coarse", "fine")


def build_page(report: Mapping[str, Any], pictures: Mapping[str, UInt8]) -> str:
    """The whole page; `report` holds JSON values only, `pictures` are sRGB pixels (h, w, 3) by name."""
    sources = {name: data_uri(pixels) for name, pixels in pictures.items()}
    sections = (
        _header(report),
        _figures(report),
        _gi_section(report, sources),
        _set_section(report, sources),
        _metrics_section(report),
        _times_section(report),
        _left_out_section(report),
    )
    return page(f"{_scene_name(report)}: coarse and fine", sections)


def _scene_name(report: Mapping[str, Any]) -> str:
    return str(report["settings"]["scene"]).rsplit("/", 1)[-1]


def _header(report: Mapping[str, Any]) -> str:
    width, height = report["size"]
    shown = facts(
        (
            ("Adapter", report["adapter"]),
            machine_fact(report),
            ("Picture", f"{width} x {height}, {report['frames']} frames, {report['exposure']:+g} EV"),
            ("Camera", report["camera"]),
            ("Light", "; ".join(report["lights"])),
            version_fact(report),
        )
    )
    software = (
        '<p class="note">The adapter is a software renderer: the times compare passes with each other '
        "and say nothing about a graphics card.</p>"
        if report["software_adapter"]
        else ""
    )
    return (
        f"<h1>{escape(_scene_name(report))}, lit through its primitives</h1>"
        "<p>The same scene, light and camera through a coarse and a fine set of primitives.</p>"
        f"{shown}{software}"
    )


def _figures(report: Mapping[str, Any]) -> str:
    coarse, fine = (report["sets"][name] for name in SETS)
    difference = report["differences"]["coarse"]
    return tiles(
        (
            (f"{coarse['primitives']} / {fine['primitives']}", "primitives, coarse / fine"),
            (f"{coarse['bytes'] / 1024:.1f} / {fine['bytes'] / 1024:.1f} KiB", "on the GPU, coarse / fine"),
            (
                f"{short_number(coarse['frame_ms'])} / {short_number(fine['frame_ms'])} ms",
                "GPU time of a frame, coarse / fine",
            ),
            (f"{difference['flip']:.3f}", "FLIP, coarse against fine (0 is equal)"),
            (short_number(difference["rel_mse"]), "relMSE, coarse against fine"),
        )
    )


def _gi_section(report: Mapping[str, Any], sources: Mapping[str, str]) -> str:
    difference = report["differences"]["without-gi"]
    caption = f"Fine set. FLIP between the two {difference['flip']:.3f}. Drag to compare."
    lit = pair(sources, ("without-gi", "fine"), ("direct light alone", "with global illumination"), caption)
    return f"<h2>What the indirect light adds</h2>{lit}"


def _set_section(report: Mapping[str, Any], sources: Mapping[str, str]) -> str:
    counts = {name: report["sets"][name]["primitives"] for name in SETS}
    tags = tuple(f"{name}, {counts[name]} primitives" for name in SETS)
    shown = pair(
        sources, ("coarse-primitives", "fine-primitives"), tags, "What the light sees: the sets themselves."
    )
    final = pair(sources, SETS, tags, "The scene lit through each.")
    singles = "".join(
        f'<figure><img src="{sources[name]}" alt="{caption}"><figcaption>{caption}</figcaption></figure>'
        for name, caption in (
            ("coarse-flip", "FLIP map of coarse against fine; bright is different."),
            ("coarse-indirect", "Indirect radiance, coarse."),
            ("fine-indirect", "Indirect radiance, fine."),
        )
    )
    return f'<h2>Coarse and fine</h2>{final}<p></p>{shown}<p></p><div class="row">{singles}</div>'


def _metrics_section(report: Mapping[str, Any]) -> str:
    values = [report["sets"][name]["metrics"] for name in SETS]
    rows = [
        [metric.label, metric.remark, *(quantity(value[metric.key], metric.unit) for value in values)]
        for metric in METRICS
    ]
    shares = [metric for metric in METRICS if metric.unit == "%"]
    plot = bars(
        {name: [_percent(v[metric.key]) for metric in shares] for name, v in zip(SETS, values, strict=True)},
        [metric.label for metric in shares],
        "%",
    )
    return f"<h2>How well the sets stand in for the mesh</h2>{table(['', *SETS], rows)}<p></p>{plot}"


def _times_section(report: Mapping[str, Any]) -> str:
    passes = {name: report["sets"][name]["passes_ms"] for name in SETS}
    passes["without"] = report["without_gi"]["passes_ms"]
    labels = list(dict.fromkeys(label for times in passes.values() for label in times))
    frames = report["sets"]["fine"]["timed_frames"]
    plot = bars(
        {name: [times.get(label) for label in labels] for name, times in passes.items()}, labels, "ms"
    )
    fits = ", ".join(f"{name} {report['sets'][name]['fit_seconds']:.1f} s" for name in SETS)
    return (
        f"<h2>Time of each pass</h2><p>GPU milliseconds, median of {frames} frames; <em>without</em> is the "
        f"fine set without global illumination. The fits took {fits}.</p>{plot}"
    )


def _left_out_section(report: Mapping[str, Any]) -> str:
    fine = report["sets"]["fine"]
    rows = [
        [
            "skipped parts",
            "too small to matter",
            *(str(len(report["sets"][n]["skipped_parts"])) for n in SETS),
        ]
    ]
    for kind in fine["kinds"]:
        rows.append([kind, "", *(str(report["sets"][name]["kinds"][kind]) for name in SETS)])
    notes = "".join(f"<li>{escape(note)}</li>" for note in [*fine["notes"], *report["notes"]])
    return (
        f"<h2>What the sets are made of</h2>{table(['', *SETS], rows)}"
        f"<h2>What was taken as air</h2>{spaces(fine['air'])}"
        + (f"<h2>Notes</h2><ul>{notes}</ul>" if notes else "")
    )


def _percent(value: float | None) -> float | None:
    return None if value is None else 100 * value
