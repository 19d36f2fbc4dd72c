"""What the rows of `bench fit` say: which are Pareto-best, is more ever worse, which budget to take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

Row = Mapping[str, Any]

ENOUGH_FOR_LIGHT = {
    "leaks": 0.02,
    "blocked": 0.06,
    "false_solid": 0.005,
    "air_distance_error_pct": 0.6,
}
"""Metrics at which a set serves global illumination: shares; the air's error in percent of the diagonal."""

NEAR_BEST = 1.1
"""Where no budget is enough, the smallest one with at most this multiple of the least error is advised."""

RISE = 0.02
"""A larger budget may have an error larger by this share: the points of judgement are not the fit's own."""

COSTS = {"primitives": "primitives", "seconds": "total_cpu_seconds"}
"""What a set costs: where it is used, and where it is made; names and the rows' keys."""

ERRORS = ("error", "air_distance_error_pct", "leaks", "blocked", "false_solid", "surface_to_set_mean_m")
"""What is held against each cost."""


def value_of(row: Row, key: str) -> float | None:
    """A row's figure, its own or one of its metrics."""
    value = row[key] if key in row else (row["metrics"] or {}).get(key)
    return None if value is None else float(value)


def mark_pareto(rows: Sequence[dict[str, Any]]) -> None:
    """Writes into each row, for every cost, the errors in which no row is better at no more cost."""
    for row in rows:
        row["pareto"] = {cost: [] for cost in COSTS}
    for cost, cost_key in COSTS.items():
        for error in ERRORS:
            for row in pareto_best(rows, cost_key, error):
                row["pareto"][cost].append(error)


def pareto_best(rows: Sequence[dict[str, Any]], cost: str, error: str) -> list[dict[str, Any]]:
    """The rows that no other beats in one of the two figures without losing in the other, by rising cost."""
    known = [row for row in rows if value_of(row, cost) is not None and value_of(row, error) is not None]
    known.sort(key=lambda row: (value_of(row, cost), value_of(row, error)))
    best: list[dict[str, Any]] = []
    for row in known:
        if not best or value_of(row, error) < value_of(best[-1], error):  # type: ignore[operator]
            best.append(row)
    return best


def monotony(rows: Sequence[Row]) -> dict[str, Any]:
    """Whether a larger budget is ever worse: the rises of `error` over the least of all smaller budgets."""
    rises = []
    least: Row | None = None
    for row in sorted(rows, key=lambda row: row["budget"]):
        if least is not None and row["error"] > least["error"]:
            rise = row["error"] / least["error"] - 1 if least["error"] > 0 else float("inf")
            rises.append({"from": least["budget"], "to": row["budget"], "rise": rise})
        else:
            least = row
    return {"holds": all(rise["rise"] <= RISE for rise in rises), "tolerance": RISE, "rises": rises}


def advise(rows: Sequence[Row]) -> dict[str, Any] | None:
    """The smallest budget that is enough for light, or nearly the best there is; None without rows.

    budget, primitives, enough; missed: the metrics that are not enough; best_budget: of the least error.
    """
    if not rows:
        return None
    rising = sorted(rows, key=lambda row: row["budget"])
    best = min(rising, key=lambda row: (row["error"], row["budget"]))
    enough = [row for row in rising if not _missed(row)]
    near = [row for row in rising if row["error"] <= NEAR_BEST * best["error"]]
    chosen = enough[0] if enough else near[0]
    return {
        "budget": chosen["budget"],
        "primitives": chosen["primitives"],
        "enough": bool(enough),
        "missed": _missed(chosen),
        "best_budget": best["budget"],
    }


def _missed(row: Row) -> list[str]:
    return [key for key, most in ENOUGH_FOR_LIGHT.items() if (value_of(row, key) or 0.0) > most]


def summarize(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """A scene's summary; marks its Pareto-best runs on the way."""
    done = [run for run in runs if run["status"] == "ok"]
    for run in runs:
        run["pareto"] = {}
    mark_pareto([run for run in done if run["series"] in ("budget", "peer")])
    budgets = [run for run in done if run["series"] == "budget"]
    return {"advice": advise(budgets), "monotony": monotony(budgets)}
