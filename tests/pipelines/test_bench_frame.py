"""`sdfprim bench frame`: stages, totals, percentiles, and tables beside the paper's."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pipelines.bench_frame import BESIDE, STAGES, FrameBenchSettings, part_of, run, summarise
from pipelines.errors import UsageError
from pipelines.report.frame_markdown import build_markdown
from pipelines.studio import LightingOptions
from runtime.presets import BALANCED
from runtime.timing import Interval

SHADERS = Path(__file__).resolve().parents[2] / "runtime" / "shaders"

ALONE = ("view", "paths", "triangles", "none", "lib", "ddgi", "probes")
"""Folders of what no frame of the preset runs."""


def frame(*passes: tuple[str, float, float]) -> list[Interval]:
    return [Interval(label, begin, end) for label, begin, end in passes]


def test_stages_and_the_span_between_first_and_last() -> None:
    found = summarise(
        [
            frame(
                ("world/build_candidates", 0.0, 0.1),
                ("direct/draw_light_view", 0.2, 1.2),
                ("sdfddgi/update_probes", 1.3, 1.5),
                ("sdfddgi/publish_probes", 1.5, 1.6),
                ("primary/draw_gbuffer", 1.7, 2.7),
                ("composite/gather_irradiance", 3.0, 3.5),
                ("composite/tone_map", 3.5, 3.6),
            )
        ]
        * 3
    )
    medians = {name: spread["median"] for name, spread in found["stages"].items()}
    assert medians == pytest.approx({"culling": 0.1, "probe update": 0.3, "contact GI": 0.0, "shading": 0.5})
    assert found["total"]["median"] == pytest.approx(3.5 - 1.0 - 1.0)
    assert found["beside"]["picture"]["median"] == pytest.approx(0.1)


def test_medians_and_95th_percentiles() -> None:
    found = summarise([frame(("sdfddgi/update_probes", 0.0, 0.01 * k)) for k in range(101)])
    assert found["total"] == pytest.approx({"median": 0.5, "p95": 0.95})


def test_an_adapter_without_a_clock_gives_no_time() -> None:
    assert summarise([[Interval("sdfddgi/update_probes", None, None)]])["total"] is None


def test_every_kernel_of_a_frame_belongs_to_a_stage() -> None:
    folders = {path.parent.name for path in SHADERS.rglob("*.wgsl")} - {"shaders", *ALONE}
    assert {part_of(f"{folder}/any") for folder in folders if folder != "direct"} <= {*STAGES, *BESIDE}
    with pytest.raises(KeyError, match="belongs to no stage"):
        part_of("unheard/of")


def test_the_preset_is_the_papers_configuration() -> None:
    assert (BALANCED.size, BALANCED.gi) == ((1920, 1080), "sdfddgi")
    assert (BALANCED.technique.max_probes, BALANCED.technique.rays_per_probe) == (22 * 14 * 32, 64)
    assert BALANCED.technique.bounce == 1.0 and BALANCED.contact is not None
    assert BALANCED.technique.probes_per_frame == 22 * 14 * 32 // BALANCED.technique.longest_wait_seen


def test_two_sets_are_timed_and_told_beside_the_papers_rows(
    bundled_assets: Path, tmp_path: Path, gpu: Any
) -> None:
    scene, set_ = (bundled_assets / f"cornell.{suffix}" for suffix in ("glb", "npz"))
    settings = FrameBenchSettings(
        scene,
        tmp_path,
        (set_, set_),
        size=(32, 24),
        frames=3,
        warm_up=1,
        max_probes=27,
        lighting=LightingOptions(sun="0.2,1,0.3,4"),
    )
    report = run(settings, lambda stage, share: None)
    assert [one["primitives"] for one in report["sets"]] == [report["sets"][0]["primitives"]] * 2
    passes = report["sets"][0]["passes"]
    assert {"sdfddgi/update_probes", "direct/draw_light_view"} <= passes.keys()
    assert report["sets"][0]["total"]["p95"] >= report["sets"][0]["total"]["median"] > 0
    text = (tmp_path / "frame.md").read_text(encoding="utf-8")
    assert text == build_markdown(report)
    assert "| 130, the paper | 1.92 | on the CPU | 0.43 | 0.57 | 0.92 |" in text
    assert ("these times mean nothing" in text) == report["software_adapter"]


def test_mistakes_are_named(sdfprim: Callable[..., Any], wall: Path, tmp_path: Path) -> None:
    outcome = sdfprim("bench", "frame", wall, "--set", wall, "--preset", "best", "-o", tmp_path)
    assert outcome.code == 2 and "there are balanced" in outcome.err
    with pytest.raises(UsageError, match="--set"):
        run(FrameBenchSettings(wall, tmp_path, ()), lambda stage, share: None)
