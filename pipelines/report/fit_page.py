"""`report.html` of `bench fit`: which budget to take and what is lost, then the figures behind it."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from pipelines.bench_fit_summary import value_of
from pipelines.quantities import quantity
from pipelines.report.curves import Point, curves
from pipelines.report.elements import (
    facts,
    machine_fact,
    page,
    spaces,
    table,
    version_fact,
)
from pipelines.report.fit_advice import (
    BY_KEY,
    HEADERS,
    IN_SHORT,
    Report,
    advice_lines,
    budget_runs,
    in_short,
)
from pipelines.report.plots import short_number, stacked_bars

OVER_PRIMITIVES = (
    "error",
    "air_distance_error_pct",
    "leaks",
    "blocked",
    "false_solid",
    "surface_to_set_mean_m",
)
OVER_SECONDS = ("error", "leaks")
"""What is plotted over each cost."""

IN_TABLES = (
    "error",
    "air_distance_error_pct",
    "surface_to_set_mean_m",
    "leaks",
    "blocked",
    "false_solid",
    "iou",
)


def build_page(report: Report) -> str:
    """The whole page; `report` holds JSON values only."""
    names = ", ".join(scene["name"] for scene in report["scenes"])
    sections = [_header(report), _overview(report), *map(_scene, report["scenes"]), _definitions()]
    return page(f"Fit: {names}", sections)


def _header(report: Report) -> str:
    settings = report["settings"]
    budgets = ", ".join(str(budget) for budget in settings["budgets"])
    shown = facts(
        (
            ("Budgets", budgets),
            machine_fact(report),
            ("Time limit", f"{settings['timeout']:g} s a run"),
            version_fact(report),
        )
    )
    return f"<h1>How many primitives, how well, how fast</h1>{shown}"


def _overview(report: Report) -> str:
    """Which budget to take for each scene, in a line each; one scene's advice stands at its own head."""
    if len(report["scenes"]) < 2:
        return ""
    rows = []
    for scene in report["scenes"]:
        advice = scene["summary"]["advice"]
        if advice is None:
            rows.append([scene["name"], scene["failure"] or "no fit succeeded", *"-" * (3 + len(IN_SHORT))])
            continue
        run = next(run for run in budget_runs(scene) if run["budget"] == advice["budget"])
        remark = (
            ""
            if advice["enough"]
            else "not enough for light: " + ", ".join(map(HEADERS.__getitem__, advice["missed"]))
        )
        figures = [quantity(value_of(run, key), BY_KEY[key].unit) for key in IN_SHORT]
        seconds = short_number(run["total_cpu_seconds"])
        rows.append([scene["name"], remark, str(run["budget"]), str(run["primitives"]), seconds, *figures])
    headers = ["scene", "take", "set", "CPU s", *map(HEADERS.__getitem__, IN_SHORT)]
    return f"<h2>Which budget to take</h2>{table(headers, rows)}"


def _advice(scene: Report) -> str:
    if scene["failure"]:
        return f'<div class="advice"><p>{escape(scene["name"])} failed: {escape(scene["failure"])}</p></div>'
    first, *others = advice_lines(scene)
    lines = "".join(f"<p>{escape(line)}</p>" for line in others)
    return f'<div class="advice"><p><strong>{escape(first)}</strong></p>{lines}</div>'


# ------------------------------------------------------------------------------------------------- scene


def _scene(scene: Report) -> str:
    if scene["failure"]:
        return _advice(scene)
    parts = [
        f"<h2>{escape(scene['name'])}</h2>",
        _advice(scene),
        _scene_facts(scene),
        *([_over_primitives(scene), _over_seconds(scene)] if len(_plotted(scene)) > 1 else []),
        _budgets(scene),
        _stages(scene),
        _steps(scene),
        _kinds(scene),
        _peers(scene),
        _failures(scene),
        f"<h3>What was taken as air</h3>{spaces(scene['air'])}",
    ]
    return "".join(parts)


def _scene_facts(scene: Report) -> str:
    return facts(
        (
            ("Triangles", f"{scene['triangles']:,}"),
            ("Diagonal", f"{short_number(scene['diagonal_m'])} m"),
            ("Load and air", f"{scene['cpu_seconds']:.1f} s of CPU, once for all runs, in every total below"),
            ("File", scene["source"]),
        )
    )


def _over_primitives(scene: Report) -> str:
    budgets = sorted({float(run["primitives"]) for run in _plotted(scene) if run["primitives"]})
    plots = "".join(
        curves(
            _points(scene, "primitives", "primitives", key), "primitives", _axis_title(key), x_ticks=budgets
        )
        for key in OVER_PRIMITIVES
    )
    return (
        "<h3>Error over primitives</h3><p>Filled: Pareto-best, no other set here is better with as few. "
        f'Point at a dot for its figures.</p><div class="plots">{plots}</div>'
    )


def _over_seconds(scene: Report) -> str:
    plots = "".join(
        curves(
            _points(scene, "seconds", "total_cpu_seconds", key), "seconds of CPU, loading and air included",
            _axis_title(key),
        )
        for key in OVER_SECONDS
    )  # fmt: skip
    return f'<h3>Error over seconds</h3><div class="plots">{plots}</div>'


def _axis_title(key: str) -> str:
    metric = BY_KEY[key]
    unit = {"%": ", %", "pct": ", %", "": ""}.get(metric.unit, f", {metric.unit}")
    return {"air_distance_error_pct": "distance error in free air, % of the diagonal"}.get(
        key, metric.label + unit
    )


def _points(scene: Report, cost: str, cost_key: str, key: str) -> dict[str, list[Point]]:
    """The plotted runs as points, by method."""
    found: dict[str, list[Point]] = {}
    factor = 100 if BY_KEY[key].unit == "%" else 1
    for run in _plotted(scene):
        x, y = value_of(run, cost_key), value_of(run, key)
        if x is None or y is None or x <= 0:
            continue
        words = (
            f"{run['method']}, budget {run['budget']}: {run['primitives']} primitives, "
            f"{short_number(run['total_cpu_seconds'])} s; {in_short(run)}"
        )
        best = key in run["pareto"].get(cost, ())
        label = str(run["budget"]) if cost == "seconds" else ""
        found.setdefault(run["method"], []).append(Point(x, factor * y, label, words, best))
    return found


def _plotted(scene: Report) -> list[Report]:
    return [run for run in scene["runs"] if run["series"] in ("budget", "peer") and run["status"] == "ok"]


def _budgets(scene: Report) -> str:
    return _runs_table("budget", [(str(run["budget"]), "", run) for run in budget_runs(scene)])


def _runs_table(title: str, rows: Sequence[tuple[str, str, Report]]) -> str:
    headers = [title, "set", "bytes", "CPU s", "wall s", *(HEADERS[key] for key in IN_TABLES)]
    lines = [
        [
            label, remark, str(run["primitives"]), f"{run['bytes']:,}",
            short_number(run["total_cpu_seconds"]), short_number(run["wall_seconds"]),
            *(quantity(value_of(run, key), BY_KEY[key].unit) for key in IN_TABLES),
        ]
        for label, remark, run in rows
    ]  # fmt: skip
    return table(headers, lines) if lines else "<p>No run.</p>"


def _stages(scene: Report) -> str:
    runs = budget_runs(scene)
    names = [*scene["stages"], *dict.fromkeys(stage for run in runs for stage in run["stages"])]
    series = {
        name: [scene["stages"].get(name, 0.0) + run["stages"].get(name, 0.0) for run in runs]
        for name in names
    }
    if not runs:
        return ""
    plot = stacked_bars(series, [f"budget {run['budget']}" for run in runs], "s")
    return f"<h3>Which step takes which time</h3><p>Seconds of CPU.</p>{plot}"


def _steps(scene: Report) -> str:
    runs = [run for run in scene["runs"] if run["series"] == "step" and run["status"] == "ok"]
    whole = _whole(scene, runs)
    if not whole:
        return ""
    rows = [(run["label"], "alone" if n == 0 else "", run) for n, run in enumerate(runs)]
    rows.append(("all steps", "", whole))
    return (
        f"<h3>What each step brings, at {whole['budget']}</h3><p>Steps of the method that join one after "
        f"the other; each row is a fit of its own.</p>{_runs_table('steps', rows)}"
    )


def _kinds(scene: Report) -> str:
    runs = [run for run in scene["runs"] if run["series"] == "kind" and run["status"] == "ok"]
    whole = _whole(scene, runs)
    if not whole:
        return ""
    rows = [("all kinds", "", whole), *((run["label"], "", run) for run in runs)]
    shares = [
        [kind, "", str(whole["kinds"].get(kind, 0)), quantity(own["surface_share"], "%"),
         quantity(own["surface_to_set_mean_m"], "m")]
        for kind, own in whole["by_kind"].items()
    ]  # fmt: skip
    return (
        f"<h3>What each kind brings, at {whole['budget']}</h3>{_runs_table('kinds', rows)}"
        "<p>In the set of all kinds: of the seen surface, what is nearest to each kind, and how near.</p>"
        + table(["kind", "in the set", "of the surface", "mean distance"], shares)
    )


def _whole(scene: Report, runs: Sequence[Report]) -> Report | None:
    """The run over budgets that left nothing out, of the same budget as `runs`."""
    budgets = {run["budget"] for run in runs}
    return next((run for run in budget_runs(scene) if run["budget"] in budgets), None)


def _peers(scene: Report) -> str:
    runs = [run for run in scene["runs"] if run["series"] == "peer" and run["status"] == "ok"]
    if not runs:
        return ""
    own = {run["budget"]: run for run in budget_runs(scene)}
    rows = [("sdfprim", f"budget {b}", own[b]) for b in sorted({run["budget"] for run in runs} & set(own))]
    rows += [(run["method"], f"budget {run['budget']}", run) for run in runs]
    return f"<h3>Beside convex decompositions</h3>{_runs_table('method', rows)}"


def _failures(scene: Report) -> str:
    items = "".join(
        f"<li>{escape(run['method'])} {escape(run['label'])}: {escape(run['failure'])}</li>"
        for run in scene["runs"]
        if run["failure"]
    )
    return f"<h3>What failed</h3><ul>{items}</ul>" if items else ""


def _definitions() -> str:
    return (
        "<h2>How to read this</h2><p>Every set of a scene is judged at the same points, new to every fit."
        " Error E is the method's own error at such points, of surface and air together, as a share of the"
        " empty set's. Air error: mean difference, in free air, of the set's distance and the surface's, of"
        " the diagonal. Surface: mean distance of the seen surface to the set. Leaks: first hits of random"
        " rays that the set lets pass; blocked: rays that it stops too early; both by over 1 % of the"
        " diagonal. False solid: free air that the set fills. Each run had a process of its own; the seconds"
        " of CPU hardly depend on what else the machine did, those of the wall do.</p>"
    )
