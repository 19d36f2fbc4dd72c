"""The tables of `bench frame`: our rows beside those of Tables 1 to 3 of the SDFDDGI paper (section 4.4)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

PAPER_HARDWARE = (
    ("GeForce RTX 2080 Ti", 1.30, 0.18, 0.57, 0.54),
    ("GeForce GTX 1070", 3.52, 0.48, 1.24, 1.80),
    ("GeForce GTX 970M", 9.05, 1.45, 3.46, 4.14),
)
"""Table 2: card, milliseconds in total, of probe update, of contact GI, of shading."""

PAPER_PRIMITIVES = (
    (43, 1.30, 0.18, 0.57, 0.54),
    (92, 1.61, 0.30, 0.57, 0.74),
    (130, 1.92, 0.43, 0.57, 0.92),
)
"""Table 3: primitives, and milliseconds as in Table 2, on the RTX 2080 Ti."""

PAPER_METHODS = (("SSGI", 1.17), ("RTXGI", 3.98), ("Ray Tracing GI", 4.13), ("VXGI", 5.24))
"""Table 1: the other methods, milliseconds in total, on the RTX 2080 Ti."""

COLUMNS = ("probe update", "contact GI", "shading")

HEAD = "| total | culling | probe update | contact GI | shading |"
RULE = "|---|---|---|---|---|"


def build_markdown(report: Mapping[str, Any]) -> str:
    """The whole document; `report` is what `bench_frame.run` returns."""
    parts = [_header(report), _first(report), _second(report), _third(report), _passes(report)]
    return "\n\n".join(parts) + "\n"


def _header(report: Mapping[str, Any]) -> str:
    width, height = report["size"]
    frames = report["settings"]["frames"]
    lines = [
        "# SDFDDGI by stage",
        "",
        f"{report['adapter']}, {width} x {height}, preset `{report['preset']}`, {report['probes']} probes, "
        f"{frames} frames with camera and sun moving; GPU milliseconds, median / 95th percentile. The total "
        "runs from the technique's first timestamp to its last. The paper's rows are Full HD Sponza.",
    ]
    if report["software_adapter"]:
        lines += ["", "**A software adapter: these times mean nothing.** They show that the command runs."]
    return "\n".join(lines)


def _first(report: Mapping[str, Any]) -> str:
    rows = [f"| SDFDDGI, ours, {one['primitives']} primitives {_row(one)}" for one in report["sets"][:1]]
    rows += [_paper("SDFDDGI, the paper, RTX 2080 Ti", PAPER_HARDWARE[0][1:])]
    rows += [f"| {name}, the paper | {total:.2f} | | | | |" for name, total in PAPER_METHODS]
    return "\n".join(["## Table 1: methods", "", f"| method {HEAD}", f"|---{RULE}", *rows])


def _second(report: Mapping[str, Any]) -> str:
    rows = [f"| {report['adapter']} {_row(one)}" for one in report["sets"][:1]]
    rows += [_paper(f"{card}, the paper", values) for card, *values in PAPER_HARDWARE]
    return "\n".join(["## Table 2: graphics cards", "", f"| card {HEAD}", f"|---{RULE}", *rows])


def _third(report: Mapping[str, Any]) -> str:
    rows = [f"| {one['primitives']}, ours {_row(one)}" for one in report["sets"]]
    rows += [_paper(f"{count}, the paper", values) for count, *values in PAPER_PRIMITIVES]
    lines = ["## Table 3: numbers of primitives", "", f"| primitives {HEAD}", f"|---{RULE}", *rows]
    timed = [one for one in report["sets"] if one["total"]]
    if len(timed) > 1:
        first, last = timed[0], timed[-1]
        growth = last["total"]["median"] / first["total"]["median"]
        lines += [
            "",
            f"From {first['primitives']} to {last['primitives']} primitives the total grows {growth:.2f} "
            f"times (the paper, from 43 to 130: {PAPER_PRIMITIVES[-1][1] / PAPER_PRIMITIVES[0][1]:.2f}).",
        ]
    return "\n".join(lines)


def _passes(report: Mapping[str, Any]) -> str:
    labels = list(dict.fromkeys(label for one in report["sets"] for label in one["passes"]))
    counts = [str(one["primitives"]) for one in report["sets"]]
    rows = [
        " | ".join([f"| `{label}`", *(_cell(one["passes"].get(label)) for one in report["sets"])]) + " |"
        for label in labels
    ]
    head = [" | ".join(["| pass", *counts]) + " |", "|---" * (len(counts) + 1) + "|"]
    return "\n".join(["## Every pass, by number of primitives", "", *head, *rows])


def _row(one: Mapping[str, Any]) -> str:
    stages = one["stages"]
    cells = [one["total"], *(stages.get(name) for name in ("culling", *COLUMNS))]
    return "| " + " | ".join(_cell(cell) for cell in cells) + " |"


def _cell(spread: Mapping[str, float] | None) -> str:
    return "" if spread is None else f"{spread['median']:.3f} / {spread['p95']:.3f}"


def _paper(label: str, values: Any) -> str:
    total, *stages = values
    return f"| {label} | {total:.2f} | on the CPU | " + " | ".join(f"{value:.2f}" for value in stages) + " |"
