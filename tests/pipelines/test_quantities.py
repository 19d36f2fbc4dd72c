"""The fit's figures in words."""

from __future__ import annotations

from dataclasses import fields

import pytest

from fit.measure import Metrics
from pipelines.console import Terminal
from pipelines.quantities import METRICS, quantity


def test_every_metric_has_words() -> None:
    named = {metric.key for metric in METRICS}
    assert named == {field.name for field in fields(Metrics)} - {"diag_m"}


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.98264, "%", "98.26 %"),
        (0.0977, "pct", "0.098 %"),
        (10240, "bytes", "10240 bytes"),
        (0.0074281, "m", "0.007428 m"),
        (0.5, "", "0.5"),
        (None, "m", "-"),
    ],
)
def test_a_figure_is_written_with_its_unit(value: float | None, unit: str, text: str) -> None:
    assert quantity(value, unit) == text


def test_figures_stand_to_the_right_and_words_to_the_left(capsys: pytest.CaptureFixture[str]) -> None:
    Terminal().table(["what", "share"], [["one", "5.00 %"], ["another", "-"], ["third", "12.50 %"]])
    lines = [line for line in capsys.readouterr().out.splitlines() if "%" in line or "-" in line]
    assert "│ one     │  5.00 % │" in lines
    assert "│ another │       - │" in lines
