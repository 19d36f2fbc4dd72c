"""Curves over a cost as SVG text: one figure against another, the Pareto-best points filled."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

from pipelines.report.plots import short_number

WIDTH, HEIGHT = 520, 330
LEFT, RIGHT, TOP, BOTTOM = 62, 18, 56, 46
"""Margins in SVG units: tick labels and title on the left and below, the legend on top."""

DECADES = 1.2
"""An axis is logarithmic where its values span more than this."""

LABEL_GAP = 20
"""Least distance in SVG units between the labels of two points."""


@dataclass(frozen=True)
class Point:
    """One run: its figures, a short label beside it, words for the pointer, whether it is Pareto-best."""

    x: float
    y: float
    label: str
    words: str
    best: bool


@dataclass(frozen=True)
class Axis:
    """Where values lie between two pixels; on a logarithmic axis zero lies at the lower end."""

    low: float
    high: float
    start: float
    end: float
    logarithmic: bool

    def place(self, value: float) -> float:
        """SVG units of a value."""
        if self.logarithmic:
            share = math.log(max(value, self.low) / self.low) / math.log(self.high / self.low)
        else:
            share = (value - self.low) / (self.high - self.low)
        return self.start + share * (self.end - self.start)

    def ticks(self) -> list[float]:
        """Round values, few enough to be read."""
        if not self.logarithmic:
            step = _round_step(self.high - self.low)
            return [k * step for k in range(math.ceil(self.low / step), math.floor(self.high / step) + 1)]
        exponents = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
        found = [m * 10.0**e for e in exponents for m in ((1, 2, 5) if len(exponents) <= 4 else (1,))]
        return [tick for tick in found if self.low <= tick <= self.high]


def curves(
    series: Mapping[str, Sequence[Point]], x_title: str, y_title: str, *, x_ticks: Sequence[float] = ()
) -> str:
    """One curve for each series, in the order of x; `x_ticks` replace the round values below."""
    points = [point for curve in series.values() for point in curve]
    if not points:
        return ""
    x = axis([point.x for point in points], LEFT, WIDTH - RIGHT)
    y = axis([point.y for point in points], HEIGHT - BOTTOM, TOP)
    parts = [_grid(x, y, x_ticks or x.ticks()), _titles(x_title, y_title), _legend(list(series))]
    for number, curve in enumerate(series.values()):
        parts.append(_curve(sorted(curve, key=lambda point: point.x), x, y, f"c{number}"))
    label = escape(f"{y_title} over {x_title}", quote=True)
    return f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}">{"".join(parts)}</svg>'


def axis(values: Sequence[float], start: float, end: float) -> Axis:
    """An axis that shows all the values, none of them negative."""
    positive = [value for value in values if value > 0]
    if positive and math.log10(max(positive) / min(positive)) > DECADES:
        has_zero = len(positive) < len(values)
        low = min(positive) / (3 if has_zero else 1.25)
        return Axis(low, 1.25 * max(positive), start, end, True)
    return Axis(0.0, 1.08 * max(values) or 1.0, start, end, False)


def _round_step(span: float) -> float:
    rough = span / 5
    power = 10.0 ** math.floor(math.log10(rough))
    return next(m * power for m in (1, 2, 5, 10) if m * power >= rough)


def _grid(x: Axis, y: Axis, x_ticks: Sequence[float]) -> str:
    parts = []
    for value in y.ticks():
        at = y.place(value)
        parts.append(f'<line class="rule" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{at:.1f}" y2="{at:.1f}"/>')
        parts.append(_text(LEFT - 8, at + 4, short_number(value), "end"))
    last = -math.inf
    for value in x_ticks:
        at = x.place(value)
        parts.append(f'<line class="rule" x1="{at:.1f}" x2="{at:.1f}" y1="{TOP}" y2="{HEIGHT - BOTTOM}"/>')
        if at - last > LABEL_GAP:
            parts.append(_text(at, HEIGHT - BOTTOM + 17, short_number(value), "middle"))
            last = at
    return "".join(parts)


def _titles(x_title: str, y_title: str) -> str:
    below = _text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 9, x_title, "middle")
    return f'<text class="title" x="12" y="20">{escape(y_title)}</text>{below}'


def _legend(names: Sequence[str]) -> str:
    parts, x = [], 12.0
    for number, name in enumerate(names if len(names) > 1 else []):
        parts.append(f'<circle class="c{number}" cx="{x + 4:.0f}" cy="38" r="4"/>')
        parts.append(_text(x + 13, 42, name, "start"))
        x += 28 + 6.3 * len(name)
    return "".join(parts)


def _curve(points: Sequence[Point], x: Axis, y: Axis, style: str) -> str:
    places = [(x.place(point.x), y.place(point.y)) for point in points]
    path = " ".join(f"{a:.1f},{b:.1f}" for a, b in places)
    parts = [f'<polyline class="{style} curve" points="{path}"/>']
    last = (-math.inf, -math.inf)
    for point, (a, b) in zip(points, places, strict=True):
        state = "best" if point.best else "beaten"
        parts.append(
            f'<circle class="{style} {state}" cx="{a:.1f}" cy="{b:.1f}" r="4.5">'
            f"<title>{escape(point.words)}</title></circle>"
        )
        if point.best and point.label and math.dist((a, b), last) > LABEL_GAP:
            parts.append(_text(a, b - 9, point.label, "middle"))
            last = (a, b)
    return "".join(parts)


def _text(x: float, y: float, words: str, anchor: str) -> str:
    return f'<text class="quiet" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(words)}</text>'
