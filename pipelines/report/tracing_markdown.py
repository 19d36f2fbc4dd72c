"""The tables of `bench tracing`, for the terminal and as `report.md`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pipelines.report.plots import short_number

Report = Mapping[str, Any]

LEGEND = (
    "A *query* is one question for the nearest primitive, a *distance* the signed distance to one primitive. "
    "Rays start evenly in the air and go every way, as those of probes do."
)


@dataclass(frozen=True)
class Table:
    """title: above it. columns: each header with what it shows of a set's row."""

    title: str
    columns: Mapping[str, Callable[[Report], Any]]

    @property
    def headers(self) -> list[str]:
        """Of its columns."""
        return list(self.columns)

    def rows(self, sets: Sequence[Report]) -> list[list[str]]:
        """One for each set."""
        return [[_text(show(row)) for show in self.columns.values()] for row in sets]

    def markdown(self, sets: Sequence[Report]) -> list[str]:
        """The table's lines."""
        return [
            f"### {self.title}",
            "",
            f"| {' | '.join(self.headers)} |",
            "|---" * len(self.columns) + "|",
            *(f"| {' | '.join(row)} |" for row in self.rows(sets)),
        ]


def _of(group: str, name: str, key: str) -> Callable[[Report], Any]:
    return lambda row: row[group].get(name, {}).get(key)


SET: dict[str, Callable[[Report], Any]] = {
    "set": lambda row: row["name"],
    "primitives": lambda row: row["primitives"],
}

WAYS = {"none": "none", "clusters, unbounded": "clusters", "clusters": "clusters + 2x", "grid": "grid"}
"""Of culling, from slow to fast, and their names in a table."""

CULLINGS_TABLE = Table(
    "Distances to primitives a query, and milliseconds of all rays",
    SET
    | {name: _of("cullings", way, "distances_per_query") for way, name in WAYS.items()}
    | {f"{name}, ms": _of("cullings", way, "trace_ms") for way, name in WAYS.items()},
)

STRIDES = ("plain", "relaxed", "enhanced", "auto")

STRIDES_TABLE = Table(
    "Queries a ray by strides (grid), hits unlike those of plain strides, and milliseconds of all rays",
    SET
    | {name: _of("strides", name, "queries_per_ray") for name in STRIDES}
    | {f"{name}, other hits": _of("strides", name, "other_hits") for name in STRIDES[1:]}
    | {f"{name}, ms": _of("strides", name, "trace_ms") for name in STRIDES},
)

LISTS_TABLE = Table(
    "Candidate lists and clusters",
    SET
    | {
        "cells": lambda row: row["lists"]["cells"],
        "mean list": lambda row: row["lists"]["mean"],
        "longest": lambda row: row["lists"]["longest"],
        "without room": lambda row: row["lists"]["overflowing"],
        "mean of a block": lambda row: row["lists"]["block_entries"] / row["lists"]["blocks"],
        "looks to build, 1000": lambda row: looks_to_build(row) / 1000,
        "if flat, 1000": lambda row: 2 * row["lists"]["cells"] * row["primitives"] / 1000,
        "KB": lambda row: row["lists"]["bytes"] / 1024,
        "build, ms": lambda row: row["build_ms"],
        "clusters": lambda row: row["clusters"],
    },
)

TABLES = (CULLINGS_TABLE, STRIDES_TABLE, LISTS_TABLE)

THREADS, PASSES = 64, 3
"""Of `world/build_candidates`: cells of a block, and passes over what a list is chosen from."""


def looks_to_build(row: Report) -> float:
    """Primitives whose ball is looked at while all lists are built."""
    lists = row["lists"]
    return PASSES * (lists["blocks"] * row["primitives"] + THREADS * lists["block_entries"])


def build_markdown(report: Report) -> str:
    """What was measured where, and the three tables."""
    settings = report["settings"]
    kind = "software, which is not timed" if report["software_adapter"] else "GPU timestamps, medians"
    made = f"{report['adapter']} ({kind}); {settings['rays']:,} rays, seed {report['seed']}."
    lines = [made, "", LEGEND]
    for table in TABLES:
        lines += ["", *table.markdown(report["sets"])]
    return "\n".join(lines) + "\n"


def _text(value: Any) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, int):
        return f"{value:,}"
    return short_number(value)
