"""`sdfprim render`: which camera, which light, which file, and what is told of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from fit import export, gltf
from fit.primitives import PrimitiveSet, make_box
from fit.scene import Scene
from fit.spaces import AirSpace
from pipelines.errors import UsageError
from pipelines.render import PictureSettings, check
from pipelines.studio import LightingOptions, Studio
from pipelines.views import choose_view
from runtime.images import read_layers
from runtime.views import AOV_LAYERS


@pytest.fixture(scope="module")
def prims(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A floor and a wall for `two_colour_wall.glb`."""
    path = tmp_path_factory.mktemp("set") / "wall.prims.npz"
    floor = make_box((0, -0.1, 0), (6, 0.2, 4), albedo=(0.5, 0.5, 0.5))
    wall = make_box((0, 1, 0), (0.06, 2, 3), albedo=(0.7, 0.4, 0.4))
    export.write(PrimitiveSet.concatenate([floor, wall]), path)
    return path


@pytest.fixture(scope="module")
def scene(wall: Path) -> Scene:
    return gltf.load(wall)


@pytest.fixture
def render(sdfprim: Callable[..., Any], gpu: Any, wall: Path, prims: Path) -> Callable[..., Any]:
    """Renders a small picture; skipped where there is no adapter."""

    def run(*options: object) -> Any:
        return sdfprim("render", wall, "--set", prims, "--size", "64x40", "--frames", 2, *options)

    return run


def test_png_and_report(render: Callable[..., Any], tmp_path: Path) -> None:
    ran = render("-o", tmp_path / "a.png", "--gi", "none", "--camera", "west", "--json")
    assert ran.code == 0, ran.err
    pixels = np.asarray(Image.open(tmp_path / "a.png"))
    assert pixels.shape == (40, 64, 3)
    assert pixels.max() > 100
    report = ran.report
    assert report["camera"] == "the file's camera 'west'"
    assert report["set"]["primitives"] == 2
    assert any("sun" in line for line in report["lights"])
    assert {"primary/draw_gbuffer", "direct/light_pixels"} <= set(report["passes_ms"])
    assert isinstance(report["software_adapter"], bool)


def test_the_folder_of_a_picture_is_made(wall: Path, tmp_path: Path) -> None:
    picture = tmp_path / "frames" / "day" / "noon.png"
    check(PictureSettings(wall, picture))
    assert picture.parent.is_dir()
    with pytest.raises(UsageError, match="is a folder"):
        (tmp_path / "taken.png").mkdir()
        check(PictureSettings(wall, tmp_path / "taken.png"))


def test_exposure_scales_the_png_and_not_the_exr(render: Callable[..., Any], tmp_path: Path) -> None:
    for exposure in (0, -2):
        for suffix in ("png", "exr"):
            render("-o", tmp_path / f"{exposure}.{suffix}", "--gi", "none", f"--exposure={exposure}")
    bright, dark = (np.asarray(Image.open(tmp_path / f"{e}.png")).mean() for e in (0, -2))
    assert dark < 0.8 * bright
    np.testing.assert_array_equal(*(read_layers(tmp_path / f"{e}.exr")[0] for e in (0, -2)))


def test_exr_with_layers(render: Callable[..., Any], tmp_path: Path) -> None:
    render("-o", tmp_path / "a.exr", "--gi", "none", "--aov", "--view", "albedo")
    pixels, names = read_layers(tmp_path / "a.exr")
    channel = dict(zip(names, np.moveaxis(pixels, -1, 0), strict=True))
    for layer in AOV_LAYERS:
        assert any(name.startswith(f"{layer}.") for name in names), layer
    np.testing.assert_array_equal(channel["R"], channel["albedo.R"])


def test_a_techniques_own_view(render: Callable[..., Any], tmp_path: Path) -> None:
    assert render("-o", tmp_path / "a.png", "--view", "sdfddgi/probe-atlas").code == 0
    assert np.asarray(Image.open(tmp_path / "a.png")).shape[1] % 10 == 0
    ran = render("-o", tmp_path / "b.png", "--view", "sdfddgi/nothing")
    assert ran.code == 1
    assert "sdfddgi/probe-atlas" in ran.err


def test_reflections_are_asked_for(render: Callable[..., Any], tmp_path: Path) -> None:
    ran = render("-o", tmp_path / "a.png", "--gi", "none", "--glossy", "--view", "glossy/mirror", "--json")
    assert ran.code == 0, ran.err
    assert "glossy/trace_mirror" in ran.report["passes_ms"]


def test_no_reference_has_reflections(sdfprim: Callable[..., Any], wall: Path, tmp_path: Path) -> None:
    ran = sdfprim("render", wall, "-o", tmp_path / "a.png", "--gi", "reference-gpu", "--glossy")
    assert ran.code == 2
    assert "takes every surface for diffuse" in ran.err


@pytest.mark.parametrize(("contact", "walk"), [("on", "walk_horizons"), ("paper", "walk_as_printed")])
def test_contact_light_is_asked_for(
    render: Callable[..., Any], tmp_path: Path, contact: str, walk: str
) -> None:
    ran = render(
        "-o", tmp_path / "a.png", "--gi", "none", "--contact", contact, "--view", "contact/ao", "--json"
    )
    assert ran.code == 0, ran.err
    assert f"contact/{walk}" in ran.report["passes_ms"]


def test_no_reference_has_contact_light(sdfprim: Callable[..., Any], wall: Path, tmp_path: Path) -> None:
    ran = sdfprim("render", wall, "-o", tmp_path / "a.png", "--gi", "reference-gpu", "--contact", "on")
    assert ran.code == 2
    assert "traces what is near" in ran.err


def test_views_without_light_take_one_frame(render: Callable[..., Any], tmp_path: Path) -> None:
    ran = render("-o", tmp_path / "a.png", "--view", "side-by-side", "--json")
    assert ran.code == 0, ran.err
    assert (ran.report["gi"], ran.report["frames"]) == ("none", 1)
    assert np.asarray(Image.open(tmp_path / "a.png")).shape == (40, 3 * 64, 3)


def test_every_culling_gives_the_same_picture(render: Callable[..., Any], tmp_path: Path) -> None:
    """And asks for it: by lists, the floor's far end asks fewer primitives than there are."""
    pictures, counts = [], []
    for culling in ("grid", "clusters", "none"):
        for view, found in (("primitives", pictures), ("candidate-counts", counts)):
            path = tmp_path / f"{culling}-{view}.exr"
            assert render("-o", path, "--view", view, "--culling", culling).code == 0
            found.append(read_layers(path)[0])
    for other in pictures[1:]:
        assert np.mean(np.abs(other - pictures[0]).max(axis=-1) > 1e-3) < 0.01
    seen = counts[2][..., 0] > 0
    assert set(np.unique(counts[2][seen])) == {2.0}, "without culling both are asked"
    assert counts[0][seen].min() == 1
    assert render("-o", tmp_path / "x.png", "--culling", "octree").code == 2


def test_words_for_people(render: Callable[..., Any], tmp_path: Path) -> None:
    ran = render("-o", tmp_path / "a.png", "--gi", "none", "--sun", "-1,2,0,5")
    assert "sun from" in ran.out
    assert "1 lights of the file are off" in ran.out
    assert "GPU ms, median of 2 frames" in ran.out
    assert "2 primitives" in ran.out


def test_an_unknown_camera_lists_those_there_are(render: Callable[..., Any], tmp_path: Path) -> None:
    ran = render("-o", tmp_path / "a.png", "--camera", "north")
    assert ran.code == 2
    assert "0 or 'west', 1 or 'east'" in ran.err


@pytest.mark.parametrize("mistake", [("--camera", "north"), ("--camera", "1,2,3"), ("--sky", __file__)])
@pytest.mark.parametrize("command", ["render", "compare"])
def test_mistakes_are_told_before_anything_is_converted(
    command: str, mistake: tuple[str, str], sdfprim: Callable[..., Any], gpu: Any, wall: Path, tmp_path: Path
) -> None:
    ran = sdfprim(command, wall, *mistake, "-o", tmp_path / ("a.png" if command == "render" else "a"))
    assert ran.code in (1, 2)
    assert mistake[1] in ran.err
    assert "converting" not in ran.err
    assert "fit" not in ran.err


def test_a_room_without_a_camera_is_seen_from_inside_with_a_given_set_too(
    scene: Scene, render: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(gltf, "load", lambda *_, **__: replace(scene, cameras=()))
    monkeypatch.setattr("fit.air.find_air", lambda *_, **__: _Corridor())
    ran = render("-o", tmp_path / "a.png", "--gi", "none")
    assert ran.code == 0, ran.err
    assert "inside the largest space of air" in ran.out


def test_without_a_set_it_converts_and_says_so(
    sdfprim: Callable[..., Any], gpu: Any, wall: Path, tmp_path: Path
) -> None:
    ran = sdfprim("render", wall, "--size", "32x20", "--frames", 1, "--gi", "none", "-o", tmp_path / "a.png")
    assert ran.code == 0, ran.err
    assert "no --set given, converting" in ran.err
    assert "converted just now" in ran.out


def test_cameras_by_name_number_and_numbers(scene: Scene) -> None:
    assert choose_view(None, scene, 1.6).camera is scene.cameras[0]
    assert choose_view("east", scene, 1.6).camera is scene.cameras[1]
    assert choose_view("1", scene, 1.6).camera is scene.cameras[1]
    placed = choose_view("-1,2,3,0,0,0,60", scene, 1.6).camera
    np.testing.assert_allclose(placed.world_from_local[:3, 3], (-1, 2, 3))
    assert placed.yfov == pytest.approx(np.radians(60))
    with pytest.raises(UsageError, match="has 0 or 'west'"):
        choose_view("2", scene, 1.6)


def test_named_views_of_a_known_scene(scene: Scene) -> None:
    sponza = replace(scene, source=Path("Sponza.gltf"), cameras=())
    assert choose_view("atrium", sponza, 1.6).camera.yfov == pytest.approx(np.radians(60))
    with pytest.raises(UsageError, match="'atrium'"):
        choose_view("attic", sponza, 1.6)


class _Corridor:
    """Air along x only, closed towards the outside."""

    spaces = (AirSpace((0.0, 1.0, 0.0), 12.0, "closed, 99% of the surface around it faces it"),)

    def is_air(self, points: Any) -> Any:
        return (np.abs(points[:, 0] - 1) < 3) & (np.abs(points[:, 2]) < 0.4)


def test_a_made_up_camera_looks_down_the_longest_view(scene: Scene) -> None:
    view = choose_view(None, replace(scene, cameras=()), 1.6, _Corridor())  # type: ignore[arg-type]
    assert "inside the largest space" in view.origin
    np.testing.assert_allclose(view.camera.world_from_local[:3, 3], (0, 1, 0))
    np.testing.assert_allclose(-view.camera.world_from_local[:3, 2], (1, 0, 0), atol=1e-12)


def test_a_made_up_camera_frames_what_stands_outside(scene: Scene) -> None:
    view = choose_view(None, replace(scene, cameras=()), 1.6)
    lower, upper = scene.bounds()
    position = view.camera.world_from_local[:3, 3]
    assert np.any((position < lower) | (position > upper))
    backward = view.camera.world_from_local[:3, 2]
    centre = (lower + upper) / 2 - position
    np.testing.assert_allclose(centre / np.linalg.norm(centre), -backward, atol=1e-9)


def test_lighting(scene: Scene) -> None:
    assert [type(light).__name__ for light in LightingOptions().choose(scene).lights] == ["Sun"]
    only_sky = LightingOptions(sky="1,1,2").choose(scene)
    assert only_sky.lights == ()
    assert only_sky.sky.base == (1, 1, 2)
    both = LightingOptions(sun="0,1,0,3", keep_file_lights=True).choose(scene)
    assert len(both.lights) == 2


def test_emission_is_among_the_lights(bundled_assets: Path, gpu: Any) -> None:
    cornell = gltf.load(bundled_assets / "cornell.glb")
    studio = Studio.set_up(cornell, None, LightingOptions(), (8, 8), 0.0)
    assert studio.describe()["lights"] == ["no sky", "emission of 'lamp'"]


def test_near_plane_follows_the_scene_s_size(scene: Scene) -> None:
    near = choose_view("0,1,3,0,0,0,60", scene, 1.6).camera.znear
    half = choose_view("0,1,3,0,0,0,60", gltf.load(scene.source, scale=0.5), 1.6).camera.znear
    assert 0 < half == pytest.approx(near / 2)
