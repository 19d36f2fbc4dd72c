"""The command line: how options parse, which exit code follows, and what goes to which stream."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fit import export
from fit.primitives import make_box
from pipelines import convert
from pipelines.convert import ConvertSettings
from pipelines.machine import package_version


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[ConvertSettings]:
    """The settings that `convert` would have run with; nothing is converted."""
    calls: list[ConvertSettings] = []

    def run(settings: ConvertSettings, **_: Any) -> dict[str, Any]:
        calls.append(settings)
        return {"assets": []}

    monkeypatch.setattr(convert, "run", run)
    return calls


@pytest.mark.parametrize(
    ("arguments", "air"),
    [
        (["--air", "-1,0,2"], ("-1,0,2",)),
        (["--air=-1,0,2"], ("-1,0,2",)),
        (["--air", "outside", "--air=-1,0,2", "--air", "-3,0,0"], ("outside", "-1,0,2", "-3,0,0")),
        ([], ()),
    ],
)
def test_air(
    arguments: list[str], air: tuple[str, ...], sdfprim: Callable[..., Any], seen: list[ConvertSettings]
) -> None:
    assert sdfprim("convert", "a.glb", *arguments, "b.glb", "-o", "out").code == 0
    assert seen[0].air == air
    assert seen[0].files == (Path("a.glb"), Path("b.glb"))


def test_every_option_of_convert_arrives(sdfprim: Callable[..., Any], seen: list[ConvertSettings]) -> None:
    options = (
        "--max-primitives 43 --max-bytes 4096 --max-error 0.05 --preset coarse --air outside --scale 0.01 "
        "--seed 7 --timeout 60 --json"
    )
    sdfprim("convert", "a.glb", *options.split(), "--output", "there")
    assert seen == [
        ConvertSettings(
            (Path("a.glb"),), Path("there"), 43, 4096, 0.05, "coarse", ("outside",), 0.01, seed=7, timeout=60
        )
    ]


@pytest.mark.parametrize(
    ("command", "remedy"),
    [
        ("convert {wall} -o {out} --preset medium", 'Choose from: "coarse", "fine"'),
        ("convert {wall}", "--output and its value are needed"),
        ("convert {wall} -o", "--output and its value are needed"),
        ("render -o {out}/a.png", "render: SCENE is needed"),
        ("convert -o {out}", "name at least one"),
        ("convert missing.glb -o {out}", "no such file"),
        ("convert {folder} -o {out}", "is a folder"),
        ("convert {wall} {wall} -o {out}", "given twice"),
        ("convert {wall} -o {out} --air inside", "--air inside"),
        ("convert {wall} -o {out} --scale 0", "above zero"),
        ("convert {wall} -o {out} --max-bytes 63", "takes 64"),
        ("convert {wall} -o {wall}", "-o {wall}"),
        ("convert {wall} -o {out} --fast", "sdfprim convert --help"),
        ("inspect missing.glb", "no such file"),
        ("render {wall} -o {out}/a.jpg", ".png or .exr"),
        ("render {wall} -o {out}/a.png --aov", "a.exr"),
        ("render {wall} -o {wall}/a.png", "name a folder that can be written"),
        ("render {wall} -o {out}", "end the name in .png"),
        ("render {wall} -o {out}/a.png --size 640", "640x360"),
        ("render {wall} -o {out}/a.png --gi path", 'Choose from: "sdfddgi", "ddgi", "ddgi-triangles"'),
        ("render {wall} -o {out}/a.png --view depht", "there are final"),
        ("render {wall} -o {out}/a.png --sun 1,2,3", "x,y,z,strength"),
        ("render {wall} -o {out}/a.png --sky dusk.hdr", "no such file"),
        ("render {wall} -o {out}/a.png --set missing.npz", "no such file"),
        ("render {wall} -o {out}/a.png --frames 0", "at least 1"),
        ("compare missing.glb -o {out}", "no such file"),
        ("bake {wall}", "Unknown command"),
    ],
)
def test_bad_usage_names_the_remedy(
    command: str, remedy: str, sdfprim: Callable[..., Any], wall: Path, tmp_path: Path
) -> None:
    places = {"wall": wall, "out": tmp_path, "folder": wall.parent}
    ran = sdfprim(*(word.format(**places) for word in command.split()))
    assert ran.code == 2, ran.err
    assert remedy.format(**places) in ran.err
    assert ran.out == ""
    assert "Traceback" not in ran.err


def test_inspect_as_json(sdfprim: Callable[..., Any], bundled_assets: Path) -> None:
    ran = sdfprim("inspect", bundled_assets / "atrium.glb", bundled_assets / "cornell.glb", "--json")
    assert ran.code == 0
    atrium, cornell = ran.report["assets"]
    assert atrium["triangles"] == 14352
    assert [camera["name"] for camera in atrium["cameras"]] == ["court", "arcade", "gallery"]
    assert [light["kind"] for light in atrium["lights"]] == ["directional"]
    assert atrium["extensions"] == ["KHR_lights_punctual", "KHR_materials_emissive_strength"]
    assert atrium["warnings"] == []
    assert (cornell["meshes"], cornell["closed_meshes"]) == (8, 2)
    assert cornell["closed_triangle_share"] == pytest.approx(24 / 36, abs=1e-4)


def test_inspect_warns_of_centimetres(sdfprim: Callable[..., Any], bundled_assets: Path) -> None:
    ran = sdfprim("inspect", bundled_assets / "atrium.glb", "--scale", "100.5", "--json")
    assert "--scale" in ran.report["assets"][0]["warnings"][0]


def test_inspect_reports_a_failure(sdfprim: Callable[..., Any], wall: Path, broken_file: Path) -> None:
    ran = sdfprim("inspect", wall, broken_file)
    assert ran.code == 1
    assert "broken.glb" in ran.out
    assert "triangles" in ran.out


def test_a_failed_conversion_is_exit_code_1_and_json_alone_is_on_stdout(
    sdfprim: Callable[..., Any], broken_file: Path, tmp_path: Path
) -> None:
    ran = sdfprim("convert", broken_file, "-o", tmp_path, "--json")
    assert ran.code == 1
    assert ran.report["assets"][0]["status"] == "failed"
    assert "broken: load" in ran.err


def test_no_gpu_is_exit_code_1_and_names_the_remedy(
    sdfprim: Callable[..., Any], wall: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SDFPRIM_ADAPTER", "no such card")
    export.write(make_box((0, 0, 0), (1, 1, 1)), tmp_path / "set.npz")
    ran = sdfprim("render", wall, "--set", tmp_path / "set.npz", "-o", tmp_path / "a.png")
    assert ran.code == 1
    assert "no such card" in ran.err or "apt-get install" in ran.err
    assert "Traceback" not in ran.err


def test_help_and_version(sdfprim: Callable[..., Any]) -> None:
    assert sdfprim("--version").out.strip() == package_version()
    words = sdfprim("--help").out
    for command in ("inspect", "convert", "render", "compare", "demo"):
        assert command in words
