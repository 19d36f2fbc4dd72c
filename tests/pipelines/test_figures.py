"""`sdfprim bench gi --figures`: every figure has its pictures and its words, or the reason why not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pipelines.figures.catalogue import Subject, catalogue
from pipelines.studio import LightingOptions

NUMBERS = (1, 4, 7, 9, 11, 12, 13, 14)


def test_every_figure_has_words_and_pictures_or_a_reason(wall: Path) -> None:
    figures = catalogue(None, None)
    assert tuple(figure.number for figure in figures) == NUMBERS
    for figure in figures:
        assert all(figure.words()[key] for key in ("title", "caption", "wrong")), figure.number
        assert bool(figure.panels) != bool(figure.missing)
        for panel in figure.panels:
            assert panel.subject.scene.is_file()
            assert panel.subject.primitives is not None and panel.subject.primitives.is_file()
    body = catalogue(None, Subject(wall, None, LightingOptions()))[-1]
    assert [panel.subject.budget for panel in body.panels] == [12, 12, 96, 96]


def test_a_given_scene_stands_for_the_papers_sponza(wall: Path) -> None:
    given = Subject(wall, None, LightingOptions(), "west")
    one = catalogue(given, None)[0]
    assert {panel.subject for panel in one.panels} == {given}


def test_pictures_and_a_page_are_written(sdfprim: Callable[..., Any], tmp_path: Path, gpu: Any) -> None:
    outcome = sdfprim(
        "bench", "gi", "--figures", "--figure", 4, "--figure", 14, "-o", tmp_path, "--size", "48x27", "--json"
    )
    assert outcome.code == 0, outcome.err
    four, fourteen = outcome.report["figures"]
    assert [panel["tag"] for panel in four["panels"]] == ["mesh", "primitives"]
    pictures = [
        np.asarray(Image.open(tmp_path / panel["picture"]).convert("RGB"), float) for panel in four["panels"]
    ]
    assert pictures[0].shape == (27, 48, 3)
    assert 0 < np.abs(pictures[0] - pictures[1]).mean() < 60  # the same scene, seen as mesh and as set
    assert "--model" in fourteen["missing"]
    page = (tmp_path / "figures.html").read_text(encoding="utf-8")
    assert page.count("data:image/jpeg") == 2
    assert "Not made: needs a body" in page and "What is wrong:" in page
    assert "http" not in page.replace("http://www.w3.org", "")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--figures", "--figure", "2"), "counterparts of 1, 4, 7"),
        (("--figure", "4"), "belong to --figures"),
        (("--figures", "--model", "nowhere.glb"), "no such file"),
    ],
)
def test_mistakes_are_named(
    sdfprim: Callable[..., Any], tmp_path: Path, options: tuple[str, ...], message: str
) -> None:
    outcome = sdfprim("bench", "gi", *options, "-o", tmp_path)
    assert outcome.code == 2
    assert message in outcome.err
