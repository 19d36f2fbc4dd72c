"""Pictures of the page of `bench gi`: each setting beside the truth, and where the two differ."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from pipelines.bench_gi_results import picture_name, shown_runs
from pipelines.bench_gi_summary import is_setting
from pipelines.report.gi_advice import describe, percent
from pipelines.report.gi_tables import title_of
from pipelines.report.pictures import pair, single

Report = Mapping[str, Any]
Sources = Mapping[str, str]

TRUTH = "the truth: the mesh, path traced"


def best_beside_truth(report: Report, sources: Sources) -> str:
    """The first scene's first view by the balanced setting."""
    scene = next((scene for scene in report["scenes"] if scene["runs"]), None)
    if scene is None or not report["presets"]:
        return ""
    run = next(run for run in scene["runs"] if is_setting(run, report["presets"]["balanced"]))
    return f"<p></p>{_beside_truth(scene, run, scene['views'][0]['name'], sources, 'balanced')}"


def pictures(report: Report, scene: Report, sources: Sources) -> str:
    """Of the presets and of the best of each method."""
    parts = ["<h3>Pictures of the presets, and of the best of each method</h3>"]
    for run in shown_runs(scene, report["presets"]):
        parts.append(f"<h4>{escape(title_of(report, run))}</h4>")
        for view in scene["views"]:
            name = view["name"]
            parts.append(_beside_truth(scene, run, name, sources, run["method"]))
            parts.append(_maps(scene, run, name, sources))
    return "".join(parts)


def sets_beside_truth(report: Report, scene: Report, sources: Sources) -> str:
    """What the fit alone costs, in each view."""
    runs = {run["set"]: run for run in shown_runs(scene, report["presets"])}
    parts = []
    for run in runs.values():
        for view in scene["views"]:
            name = view["name"]
            names = tuple(picture_name(scene, run, name, kind) for kind in ("mesh", "primitives"))
            count = run["primitives"]
            fit = next(row for row in scene["sets"] if row["name"] == run["set"])["views"][name]["fit"]
            caption = f"{name}: the mesh and {count} primitives, both path traced. Drag to compare, or blink."
            flip = f"FLIP of the fit error {fit['flip']:.3f}. Bright is different."
            parts.append(pair(sources, names, ("mesh", f"{count} primitives"), caption))
            parts.append(single(sources[picture_name(scene, run, name, "fit-flip")], flip))
    return f'<div class="row">{"".join(parts)}</div>'


def _beside_truth(scene: Report, run: Report, view: str, sources: Sources, tag: str) -> str:
    names = tuple(picture_name(scene, run, view, kind) for kind in ("mesh", "ours"))
    total = run["views"][view]["total"]
    caption = (
        f"{scene['name']}, {view}: {describe(run)}. Total error {percent(total['irradiance']['ratio'])}, "
        f"relMSE {total['irradiance']['rel_mse']:.3g}, FLIP {total['flip']:.3f}. Drag to compare, or blink."
    )
    return pair(sources, names, (TRUTH, tag), caption)


def _maps(scene: Report, run: Report, view: str, sources: Sources) -> str:
    found = run["views"][view]
    shown = []
    for kind, words in (("solver", "the path-traced set"), ("total", "the path-traced mesh")):
        if kind == "total" or found["fit"] is not None:
            caption = (
                f"FLIP of the {kind} error {found[kind]['flip']:.3f}: against {words}. Bright is different."
            )
            shown.append(single(sources[picture_name(scene, run, view, f"{kind}-flip")], caption))
    return f'<p></p><div class="row">{"".join(shown)}</div><p></p>'
