"""What `bench gi` advises: Pareto-best settings, the three presets, and the file that `render` reads."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from pipelines.bench_gi import GiBenchSettings, check
from pipelines.bench_gi_scene import SceneBench, pass_costs
from pipelines.bench_gi_summary import choose, preset_of, settings_of
from pipelines.errors import UsageError
from pipelines.gi_errors import TruthSettings
from pipelines.gi_presets import QUALITIES, GiPreset, find_preset, write_presets
from pipelines.methods import METHODS, SOFTWARE_PROBES, technique_settings
from pipelines.report.gi_advice import through_primitives
from pipelines.report.gi_tables import by_scene


def run(budget: int, milliseconds: float | None, total: float, **changes: Any) -> dict[str, Any]:
    """A run of which only cost and error matter."""
    found = {
        "set": f"at most {budget}", "max_primitives": budget, "method": "sdfddgi", "max_probes": 1000,
        "rays_per_probe": 64, "gi_ms": milliseconds, "update_ms": 1.0, "lookup_ms": 1.0, "frame_ms": 9.0,
        "fit": 0.01, "solver": 0.01, "total": total, "total_rel_mse": total, "total_trimmed": total,
        "flip": total,
    }  # fmt: skip
    return found | changes


def scene(*runs: dict[str, Any]) -> dict[str, Any]:
    return {"runs": list(runs)}


def test_only_what_nothing_beats_is_pareto_best() -> None:
    dark = run(64, 0.01, 1.0, method="none", max_probes=None, rays_per_probe=None)
    tried = settings_of([scene(run(8, 1, 0.5), run(32, 2, 0.1), run(64, 3, 0.2), run(128, 4, 0.05), dark)])
    marked = {row["max_primitives"]: "total" in row["pareto"] for row in tried if row["method"] != "none"}
    assert marked == {8: True, 32: True, 64: False, 128: True}
    assert tried[-1]["pareto"] == [], "no light is fast, and no answer"


def test_presets_are_the_cheapest_that_lose_no_more() -> None:
    def chosen(*errors: float) -> list[int]:
        runs = [run(4 ** (k + 1), 1.0 + k, error) for k, error in enumerate(errors)]
        found = choose(settings_of([scene(*runs)]))
        assert list(found) == list(QUALITIES) == ["fast", "balanced", "best"]
        return [found[name]["max_primitives"] for name in QUALITIES]

    assert chosen(0.9, 0.29, 0.14, 0.104, 0.1) == [16, 64, 256]
    assert chosen(0.9, 0.31, 0.16, 0.106, 0.1) == [64, 256, 1024]
    assert chosen(0.1, 0.2) == [4, 4, 4], "more time for more error is no choice"
    assert chosen(0.0, 0.0) == [4, 4, 4], "noise can make an error 0 or less"


def test_without_times_nothing_is_advised() -> None:
    assert choose(settings_of([scene(run(8, None, 0.5))])) == {}
    assert choose(settings_of([])) == {}


def test_several_scenes_share_settings_and_geometric_means() -> None:
    first = scene(run(8, 1, 0.1), run(32, 2, 0.2))
    second = scene(run(8, 4, 0.4, max_primitives=7))
    (row,) = settings_of([first, second])
    assert (row["gi_ms"], row["total"]) == pytest.approx((2, 0.2))
    assert row["max_primitives"] == 8


def test_gi_is_what_a_picture_without_it_does_not_need() -> None:
    passes: dict[str, float | None] = {
        "sdfddgi/update_probes": 2.0, "direct/draw_light_view": 9.0, "primary/draw_gbuffer": 4.0,
        "composite/gather_irradiance": 3.0, "composite/combine_light": 0.5,
    }  # fmt: skip
    found = pass_costs(passes, None)
    assert found == {"gi_ms": 5.0, "update_ms": 2.0, "lookup_ms": 3.0, "frame_ms": 18.5}
    by_the_clock = pass_costs(passes, 30.0)
    assert by_the_clock == {"gi_ms": 16.5, "update_ms": 13.5, "lookup_ms": 3.0, "frame_ms": 30.0}
    assert set(pass_costs(passes | {"direct/light_pixels": None}, None).values()) == {None}


def test_presets_come_back_from_their_file(tmp_path: Path) -> None:
    file = tmp_path / "presets.json"
    preset = preset_of(run(43, 1, 0.1))
    write_presets(file, {"fast": preset}, {"adapter": "abacus"})
    assert find_preset("fast", file) == preset == GiPreset("sdfddgi", 43, 1000, 64)
    assert json.loads(file.read_text())["source"] == {"adapter": "abacus"}
    with pytest.raises(UsageError, match=r"--quality best: .* has fast"):
        find_preset("best", file)
    file.write_text("[1]")
    with pytest.raises(UsageError, match=r"no presets\.json"):
        find_preset("fast", file)
    with pytest.raises(UsageError, match="no such file"):
        find_preset("fast", tmp_path / "nothing.json")


@pytest.mark.parametrize("name", QUALITIES)
def test_the_program_brings_presets_that_its_techniques_take(name: str) -> None:
    from fit.primitives import make_box

    preset = find_preset(name)
    assert preset.gi in METHODS
    options = preset.technique_options(software=False)
    settings = technique_settings(preset.gi, make_box((0, 0, 0), (1, 1, 1)), None, software=False, **options)
    assert settings.max_probes == preset.max_probes
    assert settings.rays_per_probe == preset.rays_per_probe
    assert preset.technique_options(software=True)["max_probes"] <= SOFTWARE_PROBES


def test_a_method_that_sees_the_mesh_is_not_the_only_advice() -> None:
    mesh = run(100, 1.0, 0.1, fit=None, method="ddgi-triangles")
    tried = [mesh, run(48, 2.0, 0.3), run(192, 3.0, 0.2), run(192, 0.1, 0.01, method="none")]
    (line,) = through_primitives(mesh, {"tried": tried})
    assert line.startswith("Through primitives alone, with no mesh to trace, take sdfddgi, 192 primitives")
    assert "for 3 ms" in line
    assert through_primitives(tried[1], {"tried": tried}) == []


def test_each_scene_shows_what_the_means_hide() -> None:
    hall, attic = run(48, 1.0, 0.1, set="coarse"), run(31, 1.0, 0.4, set="coarse")
    scenes = [
        scene(hall, run(192, 2.0, 0.05, set="fine")) | {"name": "hall"},
        scene(attic) | {"name": "attic"},
    ]
    presets = {"best": settings_of(scenes)[0]}
    table = by_scene({"scenes": scenes, "presets": presets})
    coarse, fine = table.split("<tr>")[2:]
    assert "48 primitives" in coarse
    assert "(best)" in coarse, "sets of one name are one setting, whatever their sizes"
    assert coarse.index("10 %") < coarse.index("40 %")
    assert "5 %" in fine
    assert ">-<" in fine, "the attic has no fine set"


def test_sets_that_were_made_before_go_by_the_scenes_names(tmp_path: Path) -> None:
    for name in ("coarse", "fine"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "hall.prims.npz").touch()
    folders = (tmp_path / "coarse", tmp_path / "fine")
    settings = GiBenchSettings(
        (), tmp_path, TruthSettings(), set_folders=folders, presets=("coarse",), budgets=(8,)
    )
    found = settings.wishes(Path("scenes/hall.gltf"))
    assert [wish.name for wish in found] == ["coarse", "fine", "coarse", "at most 8"]
    assert [wish.limit for wish in found] == [None, None, 48, 8]
    assert found[1].file == tmp_path / "fine" / "hall.prims.npz"
    with pytest.raises(UsageError, match=r"sdfprim convert scenes/attic\.gltf -o"):
        settings.wishes(Path("scenes/attic.gltf"))
    (tmp_path / "hall.gltf").touch()
    with pytest.raises(UsageError, match="several sets are called 'coarse'"):
        check(replace(settings, files=(tmp_path / "hall.gltf",)))


@pytest.mark.parametrize(("noise", "notes"), [(0.05, 1), (0.3, 2)])
def test_a_noisy_truth_is_told(noise: float, notes: int) -> None:
    judge = SimpleNamespace(
        mesh=SimpleNamespace(noise=noise, samples=64), truth=SimpleNamespace(notes=lambda: ("slow",))
    )
    bench = SimpleNamespace(shots=[SimpleNamespace(name="hall", judge=judge)])
    found = SceneBench.notes(bench)  # type: ignore[arg-type]
    assert len(found) == notes
    assert all("30% of noise" in note for note in found[1:])
