"""What a fit says in words."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fit.measure import Metrics
from fit.notes import notes_on_result
from fit.primitives import PrimitiveSet, make_box
from fit.settings import DEFAULT, FitSettings

BOX = make_box((0, 0, 0), (2, 2, 2))


@pytest.fixture
def good() -> Metrics:
    names = Metrics.__dataclass_fields__
    return Metrics(**dict.fromkeys(names, 0.0) | {"iou": None, "volume_error": None})


def test_a_good_set_needs_no_word(good: Metrics) -> None:
    assert notes_on_result(BOX, good, FitSettings(max_error=0.1, air=("outside", "3,0,0")), 0.05) == ()


def test_what_was_not_reached_is_told(good: Metrics) -> None:
    (error,) = notes_on_result(BOX, good, FitSettings(max_error=0.1), 0.2)
    assert "max_error 0.1 m not reached: 0.2 m" in error
    (leaks,) = notes_on_result(BOX, replace(good, leaks=0.137), DEFAULT, 0.0)
    assert leaks.startswith("14% of the rays pass")


def test_a_point_given_as_air_that_the_set_fills_is_told(good: Metrics) -> None:
    notes = notes_on_result(BOX, good, FitSettings(air=("0.5,0,0", (0.0, 9.0, 0.0))), 0.0)
    assert notes == ("air 0.5,0,0: the point lies inside primitive 0: the space around it is filled",)


def test_an_empty_set_says_so(good: Metrics) -> None:
    assert "no primitive stands" in notes_on_result(PrimitiveSet.empty(), good, DEFAULT, 0.0)[0]
