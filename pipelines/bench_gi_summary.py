"""What the runs of `bench gi` say: which are Pareto-best, and which setting to take for which purpose."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from pipelines.bench_fit_summary import pareto_best
from pipelines.gi_presets import GiPreset
from pipelines.methods import Quality

Row = Mapping[str, Any]

COST = "gi_ms"
ERRORS = ("total", "total_rel_mse", "flip")
"""What a setting costs, and what is held against it; `total`, which decides, is a ratio of means."""

FIGURES = (
    "gi_ms", "update_ms", "lookup_ms", "frame_ms", "fit", "solver", "total", "total_rel_mse",
    "total_trimmed", "flip",
)  # fmt: skip
"""Of a run, means over its views; of a setting, geometric means over scenes."""

SETTING = ("set", "method", "max_probes", "rays_per_probe")
"""What makes runs of several scenes one setting."""

LEAST_ERROR = 1e-4
"""Smaller errors count as this much: noise can make them 0 or less."""

AT_MOST: Mapping[Quality, float] = {"fast": 3.0, "balanced": 1.5, "best": 1.05}
"""Each preset is the cheapest setting with at most so many times the least error of all."""


def is_setting(run: Row, setting: Row) -> bool:
    """Whether a run, or another setting, is this one. Sets of one name differ in size from scene to scene."""
    return all(run[key] == setting[key] for key in SETTING)


def settings_of(scenes: Sequence[Row]) -> list[dict[str, Any]]:
    """The settings that were run on every scene, each with its figures, marked where it is Pareto-best."""
    found: dict[tuple[Any, ...], list[Row]] = {}
    for scene in scenes:
        for run in scene["runs"]:
            found.setdefault(tuple(run[key] for key in SETTING), []).append(run)
    rows = [_merged(runs) for runs in found.values() if len(runs) == len(scenes)]
    mark_pareto(rows)
    return rows


def mark_pareto(rows: Sequence[dict[str, Any]]) -> None:
    """Writes into each row the errors in which no row is better in less time; light without GI is none."""
    for row in rows:
        row["pareto"] = []
    lit = [row for row in rows if row["method"] != "none"]
    for error in ERRORS:
        for row in pareto_best(lit, COST, error):
            row["pareto"].append(error)


def choose(settings: Sequence[Row]) -> dict[str, Row]:
    """The settings called fast, balanced and best: see `AT_MOST`; none where no time is known."""
    front = sorted((row for row in settings if "total" in row["pareto"]), key=lambda row: float(row[COST]))
    if not front:
        return {}
    least = min(map(_error, front))
    return {
        name: next(row for row in front if _error(row) <= factor * least) for name, factor in AT_MOST.items()
    }


def preset_of(setting: Row) -> GiPreset:
    """A setting as `render` takes it."""
    return GiPreset(
        setting["method"], setting["max_primitives"], setting["max_probes"], setting["rays_per_probe"]
    )


def _error(row: Row) -> float:
    return max(float(row["total"]), LEAST_ERROR)


def _merged(runs: Sequence[Row]) -> dict[str, Any]:
    largest = max(run["max_primitives"] for run in runs)
    shared = {key: runs[0][key] for key in SETTING} | {"max_primitives": largest}
    return shared | {key: _mean([run[key] for run in runs], key) for key in FIGURES}


def _mean(values: Sequence[float | None], key: str) -> float | None:
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return None
    if len(known) == 1:
        return known[0]
    least = 1e-6 if key.endswith("_ms") else LEAST_ERROR
    return math.exp(sum(math.log(max(value, least)) for value in known) / len(known))
