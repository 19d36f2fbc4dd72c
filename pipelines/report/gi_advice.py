"""What the page of `bench gi` says in words: which setting to take, what it costs, and what is lost."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipelines.bench_gi_summary import AT_MOST, LEAST_ERROR, is_setting
from pipelines.report.plots import short_number

Report = Mapping[str, Any]

MEANINGS = {
    name: f"the cheapest with at most {factor:g} times the least error" for name, factor in AT_MOST.items()
}


def advice_lines(report: Report) -> list[str]:
    """What to take, what it costs and gives, and what is lost against the best and saved by the fast one."""
    presets = report["presets"]
    if not presets:
        return ["No setting can be advised: no run tells both its time and its error."]
    chosen, best, fast = (presets[name] for name in ("balanced", "best", "fast"))
    lines = [f"Take balanced: {describe(chosen)}.", f"{costs(chosen, report)}; {errors(chosen)}."]
    if is_setting(best, chosen):
        lines.append("Nothing is lost: no setting tried has less error.")
    else:
        lines.append(f"Lost against best ({describe(best)}): {lost(chosen, best)}.")
    if not is_setting(fast, chosen):
        lines.append(f"Fast ({describe(fast)}) loses more: {lost(fast, chosen)}.")
    return lines + through_primitives(chosen, report)


def through_primitives(chosen: Report, report: Report) -> list[str]:
    """What is best without tracing the mesh, where the advice is a method that does."""
    rows = [row for row in report["tried"] if row["fit"] is not None and row["method"] != "none"]
    rows = [row for row in rows if row["total"] is not None]
    if chosen["fit"] is not None or not rows:
        return []
    least = min(rows, key=lambda row: float(row["total"]))
    return [
        f"Through primitives alone, with no mesh to trace, take {describe(least)}: {errors(least)}, for "
        f"{short_number(least['gi_ms'])} ms."
    ]


def describe(row: Report) -> str:
    """A setting in words: its limits, of primitives and of probes."""
    count = row["max_primitives"]
    name = f"{row['method']}, {count:,} primitive{'s' if count > 1 else ''}"
    if row["max_probes"] is None:
        return name
    return f"{name}, {row['max_probes']:,} probes, {row['rays_per_probe']} rays"


def costs(row: Report, report: Report) -> str:
    """Milliseconds in words."""
    width, height = report["timed_size"]
    where = "on the processor" if report["software_adapter"] else "of GPU"
    return (
        f"{short_number(row['gi_ms'])} ms {where} for indirect light ({short_number(row['update_ms'])} for "
        f"the probes, {short_number(row['lookup_ms'])} to look them up) in a frame of "
        f"{short_number(row['frame_ms'])} ms at {width} x {height}"
    )


def errors(row: Report) -> str:
    """The three errors in words."""
    parts = f"the fit alone has {percent(row['fit'])} and the solver alone {percent(row['solver'])}"
    if row["fit"] is None:
        parts = "no fit is between, as it sees the mesh"
    return f"total error {percent(row['total'])} of the squared light, where {parts}; FLIP {row['flip']:.3f}"


def lost(less: Report, more: Report) -> str:
    """What a cheaper setting gives up for its time."""
    times = max(less["total"], LEAST_ERROR) / max(more["total"], LEAST_ERROR)
    return (
        f"total error {percent(less['total'])} instead of {percent(more['total'])} ({times:.2g} times), FLIP "
        f"{less['flip']:.3f} instead of {more['flip']:.3f}, for {short_number(less['gi_ms'])} ms instead of "
        f"{short_number(more['gi_ms'])}"
    )


def percent(share: float | None) -> str:
    """A share as percent, three digits."""
    return "-" if share is None else f"{short_number(100 * share)} %"
