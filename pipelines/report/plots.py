"""Plots as SVG text: no script, no library, no network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

WIDTH, LABELS, VALUES = 1000, 270, 90
"""Widths in SVG units: the plot, its column of labels, and what is kept free for the values."""

BAR, GAP, GROUP_GAP, TOP = 13, 3, 12, 40


def bars(series: Mapping[str, Sequence[float | None]], labels: Sequence[str], unit: str) -> str:
    """Horizontal bars in groups: one group for each label, one bar for each series; None is no bar.

    A series' name is its class in the page's style sheet and its word in the legend.
    """
    largest = max((value for row in series.values() for value in row if value is not None), default=0.0)
    scale = (WIDTH - LABELS - VALUES) / largest if largest > 0 else 0.0
    group = len(series) * (BAR + GAP) + GROUP_GAP
    parts = [_legend(series)]
    for row, label in enumerate(labels):
        top = TOP + row * group
        middle = top + (group - GROUP_GAP) / 2 + 4
        parts.append(f'<text x="{LABELS - 12}" y="{middle:.0f}" text-anchor="end">{escape(label)}</text>')
        for number, (name, values) in enumerate(series.items()):
            parts.append(_bar(top + number * (BAR + GAP), values[row], scale, name, unit))
    height = TOP + len(labels) * group
    rule = f'<line class="rule" x1="{LABELS}" x2="{LABELS}" y1="{TOP - 6}" y2="{height - 8}"/>'
    return f'<svg viewBox="0 0 {WIDTH} {height}" role="img">{rule}{"".join(parts)}</svg>'


def stacked_bars(series: Mapping[str, Sequence[float | None]], labels: Sequence[str], unit: str) -> str:
    """One horizontal bar for each label, made of a piece for each series, and its whole length in figures."""
    totals = [sum(values[row] or 0.0 for values in series.values()) for row in range(len(labels))]
    scale = (WIDTH - LABELS - VALUES) / max([*totals, 1e-300])
    legend, top = _stacked_legend(list(series))
    parts = [legend]
    for row, label in enumerate(labels):
        y, x = top + row * (BAR + GROUP_GAP), float(LABELS)
        parts.append(f'<text x="{LABELS - 12}" y="{y + BAR - 2}" text-anchor="end">{escape(label)}</text>')
        for number, (name, values) in enumerate(series.items()):
            width = (values[row] or 0.0) * scale
            words = escape(f"{name}: {short_number(values[row])} {unit}")
            parts.append(
                f'<rect class="c{number}" x="{x:.1f}" y="{y}" width="{width:.1f}" height="{BAR}">'
                f"<title>{words}</title></rect>"
            )
            x += width
        total = escape(f"{short_number(totals[row])} {unit}")
        parts.append(f'<text class="quiet" x="{x + 6:.1f}" y="{y + BAR - 2}">{total}</text>')
    height = top + len(labels) * (BAR + GROUP_GAP)
    return f'<svg viewBox="0 0 {WIDTH} {height}" role="img">{"".join(parts)}</svg>'


def _stacked_legend(names: Sequence[str]) -> tuple[str, int]:
    """The legend in as many lines as it needs, and where the bars may start."""
    parts, x, y = [], 16.0, 12
    for number, name in enumerate(names):
        needed = 34 + 6.6 * len(name)
        if x + needed > WIDTH:
            x, y = 16.0, y + 20
        parts.append(f'<rect class="c{number}" x="{x:.0f}" y="{y}" width="12" height="12" rx="2"/>')
        parts.append(f'<text x="{x + 18:.0f}" y="{y + 10}">{escape(name)}</text>')
        x += needed
    return "".join(parts), y + 30


def short_number(value: float | None) -> str:
    """Three digits, and no exponent where there is room for the number; a dash for None."""
    if value is None:
        return "-"
    return f"{value:,.0f}" if 1000 <= abs(value) < 1e7 else f"{value:.3g}"


def _bar(y: float, value: float | None, scale: float, name: str, unit: str) -> str:
    if value is None:
        return f'<text class="quiet" x="{LABELS + 6}" y="{y + BAR - 2}">-</text>'
    width = max(value * scale, 1.0)
    end, text = LABELS + width + 6, escape(f"{short_number(value)} {unit}")
    return (
        f'<rect class="{name}" x="{LABELS}" y="{y}" width="{width:.1f}" height="{BAR}" rx="2"/>'
        f'<text class="quiet" x="{end:.1f}" y="{y + BAR - 2}">{text}</text>'
    )


def _legend(series: Mapping[str, Sequence[float | None]]) -> str:
    parts = []
    for number, name in enumerate(series):
        x = LABELS + number * 130
        parts.append(f'<rect class="{name}" x="{x}" y="12" width="12" height="12" rx="2"/>')
        parts.append(f'<text x="{x + 18}" y="22">{escape(name)}</text>')
    return "".join(parts)
