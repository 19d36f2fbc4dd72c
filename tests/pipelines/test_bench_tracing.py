"""`bench tracing`: what it counts, and that its command writes it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from fit import export, sdf
from pipelines.bench_tracing import TracingBenchSettings, run
from pipelines.bench_tracing_scenes import SCENES, rays_in_air
from pipelines.cli import execute
from pipelines.errors import UsageError


@pytest.mark.parametrize("name", SCENES)
def test_generated_sets_have_their_number_and_air(name: str) -> None:
    for count in (43, 200):
        primitives = SCENES[name](count, 0)
        assert len(primitives) == count
        origins, directions = rays_in_air(primitives, 64, 1)
        assert origins.shape == directions.shape == (64, 3)
        assert sdf.union_distance(primitives, origins)[0].min() > 0
        np.testing.assert_array_equal(primitives.positions, SCENES[name](count, 0).positions)
        assert not np.array_equal(primitives.positions, SCENES[name](count, 1).positions)


def test_counts_are_exact_and_fall_from_way_to_way(gpu: object, tmp_path: Path) -> None:
    code = execute(["bench", "tracing", "-o", str(tmp_path / "out"), "--primitives", "60", "--rays", "256"])
    assert code == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert [row["name"] for row in report["sets"]] == list(SCENES)
    hall = report["sets"][0]
    asked = {name: row["distances_per_query"] for name, row in hall["cullings"].items()}
    assert asked["none"] == 60
    assert asked["grid"] < asked["clusters"] < asked["clusters, unbounded"] < asked["none"]
    strides = hall["strides"]
    assert strides["auto"]["queries_per_ray"] < strides["plain"]["queries_per_ray"]
    assert strides["plain"]["other_hits"] == 0 and strides["auto"]["other_hits"] <= 1
    assert hall["lists"]["overflowing"] == 0 and hall["lists"]["mean"] < 30
    text = (tmp_path / "out" / "report.md").read_text()
    assert "| hall | 60 | 60 |" in text and "seed 0" in text


def test_a_set_of_ones_own_is_measured(gpu: object, tmp_path: Path) -> None:
    file = tmp_path / "mine.prims.npz"
    export.write(SCENES["hall"](30, 3), file)
    report = run(TracingBenchSettings(tmp_path / "out", (file,), (), rays=64), lambda text, share: None)
    assert [(row["name"], row["primitives"]) for row in report["sets"]] == [("mine", 30)]


@pytest.mark.parametrize(
    "wrong", [{"counts": (3,)}, {"counts": ()}, {"rays": 0}, {"sets": (Path("no.npz"),)}]
)
def test_wrong_usage_is_told_before_any_work(tmp_path: Path, wrong: dict) -> None:
    with pytest.raises(UsageError):
        run(TracingBenchSettings(tmp_path, **wrong), lambda text, share: None)
