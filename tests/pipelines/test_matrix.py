"""`sdfprim compare` as a matrix: rows, columns, knees, and a page that opens without a network."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fit import export
from fit.primitives import PrimitiveSet, make_box
from pipelines import matrix
from pipelines.errors import UsageError
from pipelines.gi_errors import TruthSettings
from pipelines.matrix_sets import wishes
from pipelines.methods import lay_grid, technique_settings
from pipelines.options import ProbesOption, parse_names, parse_probes
from pipelines.reference.store import FOLDER
from pipelines.studio import LightingOptions


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER, str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def compared(gpu: Any, wall: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """A floor with its wall and the floor alone, without GI and with it from few probes."""
    folder = tmp_path_factory.mktemp("matrix")
    floor = make_box((0, -0.1, 0), (6, 0.2, 4), albedo=(0.5, 0.5, 0.5))
    both = PrimitiveSet.concatenate([floor, make_box((0, 1, 0), (0.06, 2, 3), albedo=(0.7, 0.4, 0.4))])
    files = (folder / "both.prims.npz", folder / "floor.prims.npz")
    for file, primitives in zip(files, (both, floor), strict=True):
        export.write(primitives, file)
    settings = matrix.MatrixSettings(
        wall,
        folder,
        TruthSettings("reference-gpu", samples=32),
        sets=files,
        methods=("sdfddgi", "none"),
        probes=parse_probes("3x2x3"),
        size=(32, 20),
        frames=6,
        floor=True,
        lighting=LightingOptions(sky="0.5,0.6,0.7", keep_file_lights=True),
    )
    return matrix.run(settings, lambda text, share: None), folder


def test_every_set_by_every_way_to_light_it(compared: tuple[dict[str, Any], Path]) -> None:
    _, folder = compared
    report = json.loads((folder / "report.json").read_text())
    columns = ["sdfddgi, 3x2x3", "none"]
    assert report["columns"] == columns
    assert [(row["name"], row["primitives"]) for row in report["sets"]] == [("both", 2), ("floor", 1)]
    for row in report["sets"]:
        assert set(row["cells"]) == set(columns)
        for name, cell in row["cells"].items():
            assert set(cell["errors"]) == {"solver", "total"} | ({"floor"} if name != "none" else set())
            assert cell["errors"]["total"]["flip"] > 0
        dark = row["cells"]["none"]["errors"]
        assert dark["solver"]["bias"] == dark["total"]["bias"] == -1
        assert dark["total"]["irradiance"]["rel_mse"] == pytest.approx(1, abs=0.02)
        lit = row["cells"][columns[0]]["errors"]
        assert lit["total"]["irradiance"]["rel_mse"] < 0.5
        assert -0.05 < lit["floor"]["irradiance"]["rel_mse"] < 0.5
    both, floor = (row["errors"]["fit"]["irradiance"] for row in report["sets"])
    assert both["rel_mse"] < floor["rel_mse"]
    assert report["truth"]["engine"] == "reference-gpu"


def test_pictures_and_page(compared: tuple[dict[str, Any], Path]) -> None:
    _, folder = compared
    assert (folder / "mesh.png").is_file()
    assert (folder / "both-sdfddgi-3x2x3.png").is_file()
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert not re.findall(r"""(?:src|href)=["'](?!data:)|url\(|@import|https?://""", page)
    assert page.count('type="range"') == 1 + 2 * (1 + 2)
    body = page[page.index("<body>") :]
    assert body.index("primitives are enough for sdfddgi, 3x2x3") < body.index('type="range"')
    assert body.index('type="range"') < body.index("Every set by every way"), (
        "the answer's picture comes first"
    )
    assert "(knee)" in page
    assert "$" not in page


def test_words_for_people(
    compared: tuple[dict[str, Any], Path],
    sdfprim: Callable[..., Any],
    wall: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    report, folder = compared
    seen: list[matrix.MatrixSettings] = []

    def run(settings: matrix.MatrixSettings, _: Any) -> dict[str, Any]:
        seen.append(settings)
        return report

    monkeypatch.setattr(matrix, "run", run)
    options = "--presets coarse --budgets 8,16 --gi ddgi-triangles,none --probes 6x5x3 --truth reference-gpu"
    ran = sdfprim("compare", wall, *options.split(), "--samples", 8, "--noise", 0.1, "-o", folder)
    assert ran.code == 0, ran.err
    assert "knee     none: " in ran.out
    assert "noise    both: mesh" in ran.out
    settings = seen[0]
    assert settings.truth == TruthSettings("reference-gpu", 8, 0.1)
    assert [wish.name for wish in settings.wishes()] == ["coarse", "at most 8", "at most 16"]
    assert [column.name for column in settings.columns()] == ["ddgi-triangles, 6x5x3", "none"]


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--gi", "magic"), "--gi magic"),
        (("--probes", "1x2x3"), "--probes 1x2x3"),
        (("--presets", "huge"), "--presets huge"),
        (("--truth", "reference-gpu", "--samples", 1), "--samples 1"),
        (("--set", "nothing.npz"), "nothing.npz"),
        (("--air", "outside"), "--air"),
    ],
)
def test_wrong_usage(
    sdfprim: Callable[..., Any], wall: Path, tmp_path: Path, options: tuple[Any, ...], word: str
) -> None:
    ran = sdfprim("compare", wall, *options, "-o", tmp_path / "out")
    assert ran.code == 2
    assert word in ran.err


def row(name: str, primitives: int, error: float) -> dict[str, Any]:
    cell = {"errors": {"total": {"irradiance": {"ratio": error}}}}
    return {"name": name, "primitives": primitives, "cells": {"a": cell}}


def test_the_knee_is_the_smallest_set_that_is_about_as_good() -> None:
    rows = [row("s", 8, 0.3), row("m", 32, 0.105), row("l", 64, 0.1), row("xl", 512, 0.12)]
    assert matrix.knee(rows, "a") == "m"
    assert matrix.knee([row("s", 8, float("inf"))], "a") is None


def test_sets_of_one_name_are_told_apart() -> None:
    files = (Path("a/x.prims.npz"), Path("b/x.prims.npz"), Path("y.npz"))
    assert [wish.name for wish in wishes(files, ("fine",), (8,))] == ["x", "x 2", "y", "fine", "at most 8"]


def test_probes_and_names() -> None:
    assert parse_probes("default, 22x14x32,0.5") == (
        None,
        ProbesOption("22x14x32", counts=(22, 14, 32)),
        ProbesOption("0.5", spacing=0.5),
    )
    assert parse_names("--gi", "b,a,b", ("a", "b")) == ("b", "a")
    with pytest.raises(UsageError, match="there are a, b"):
        parse_names("--gi", "c", ("a", "b"))


def test_a_grid_of_given_counts_covers_the_set() -> None:
    box = make_box((1, 2, 3), (5, 4, 1))
    grid = lay_grid(box, (6, 5, 3))
    assert (grid.counts, grid.spacing) == ((6, 5, 3), 1.0)
    np.testing.assert_allclose(grid.positions().mean(axis=0), (1, 2, 3))
    assert technique_settings("ddgi-triangles", box, None, software=True).tracer == "triangles"
    assert technique_settings("sdfddgi", box, None, software=True).max_probes == 1024
    assert (
        technique_settings("ddgi", box, ProbesOption("0.5", spacing=0.5), software=True).probe_spacing == 0.5
    )
    assert technique_settings("none", box, None, software=False) is None
