"""What the page of `bench fit` says in words: which budget to take, what it costs, and what is lost."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipelines.bench_fit_summary import ENOUGH_FOR_LIGHT, NEAR_BEST, value_of
from pipelines.quantities import METRICS, Metric, quantity
from pipelines.report.plots import short_number

Report = Mapping[str, Any]

ERROR = Metric("error", "error E", "%", "of the empty set's, at fresh points")

BY_KEY = {metric.key: metric for metric in (ERROR, *METRICS)}

HEADERS = {
    "error": "error E",
    "air_distance_error_pct": "air error",
    "surface_to_set_mean_m": "surface",
    "leaks": "leaks",
    "blocked": "blocked",
    "false_solid": "false solid",
    "iou": "IoU",
}

IN_SHORT = ("leaks", "blocked", "air_distance_error_pct", "false_solid")
"""What the advice speaks of."""


def advice_in_words(scene: Report) -> str:
    """The advice as one paragraph."""
    return " ".join(advice_lines(scene))


def advice_lines(scene: Report) -> list[str]:
    """Which budget to take; why, its cost and how good it is; what is lost; whether more is ever worse."""
    advice, name = scene["summary"]["advice"], scene["name"]
    if advice is None:
        return [f"{name}: no fit succeeded."]
    runs = {run["budget"]: run for run in budget_runs(scene)}
    chosen, best = runs[advice["budget"]], runs[advice["best_budget"]]
    lines = [f"{name}: take {advice['budget']}.", _reason(advice, chosen)]
    if len(runs) > 1:
        lines += [_loss(chosen, best), _monotony(scene["summary"]["monotony"])]
    else:
        lines.append("No other budget was tried.")
    return lines + _failed(scene)


def _reason(advice: Report, chosen: Report) -> str:
    limits = _limits(ENOUGH_FOR_LIGHT)
    if advice["enough"]:
        why = f"The smallest budget tried that is enough for light ({limits})"
    else:
        missed = _limits({key: ENOUGH_FOR_LIGHT[key] for key in advice["missed"]})
        why = (
            f"No budget tried is enough for light; this is the smallest within {NEAR_BEST - 1:.0%} of the "
            f"least error E, and misses {missed}"
        )
    cost = f"{chosen['primitives']} primitives, {short_number(chosen['total_cpu_seconds'])} s of CPU"
    return f"{why}: {in_short(chosen)}; {cost}."


def _loss(chosen: Report, best: Report) -> str:
    if best["budget"] == chosen["budget"]:
        return "No other budget tried has less error."
    more = best["total_cpu_seconds"] - chosen["total_cpu_seconds"]
    seconds = f"{short_number(abs(more))} s of CPU {'more' if more >= 0 else 'less'}"
    return (
        f"Lost against {best['budget']} ({best['primitives']} primitives, {seconds}), the least error: "
        f"{in_short(best)} there."
    )


def _monotony(monotony: Report) -> str:
    if not monotony["rises"]:
        return "A larger budget was never worse."
    worst = max(monotony["rises"], key=lambda rise: rise["rise"] or 0.0)
    grew = f"{worst['rise']:.1%}" if worst["rise"] is not None else "from zero"
    verdict = "within" if monotony["holds"] else "MORE than"
    return (
        f"A larger budget raised the error by {grew} at most ({worst['from']} to {worst['to']}), "
        f"{verdict} the {monotony['tolerance']:.0%} that new points may."
    )


def _failed(scene: Report) -> list[str]:
    count = sum(run["failure"] is not None for run in scene["runs"])
    return [f"{count} of {len(scene['runs'])} runs failed; they are listed below."] if count else []


def in_short(run: Report) -> str:
    """The figures of a run that the advice speaks of."""
    return ", ".join(f"{HEADERS[key]} {quantity(value_of(run, key), BY_KEY[key].unit)}" for key in IN_SHORT)


def _limits(limits: Mapping[str, float]) -> str:
    return ", ".join(
        f"{HEADERS[key]} at most {quantity(most, BY_KEY[key].unit)}" for key, most in limits.items()
    )


def budget_runs(scene: Report) -> list[Report]:
    """The runs over budgets that succeeded."""
    return [run for run in scene["runs"] if run["series"] == "budget" and run["status"] == "ok"]
