"""The three errors: what they are of, by scenes whose errors are known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fit.primitives import PrimitiveSet, make_box, make_cylinder, make_half_space, make_sphere
from fit.scene import AlphaMode, Image, Instance, Material, Mesh, Scene, Texture, TextureUse
from pipelines.difference import psnr, relative_error, twice
from pipelines.gi_errors import Judge, TruthSettings
from pipelines.gi_errors.regions import by_region
from pipelines.reference.gray import gray_scene, gray_set
from pipelines.reference.store import FOLDER
from pipelines.reference.triangulate import triangulate
from pipelines.studio import Studio
from pipelines.views import View
from runtime.camera import look_at
from runtime.lights import Illumination
from runtime.path_tracer import PathTracer
from runtime.sky import Sky

SKY = Illumination((), Sky.gradient((1, 1, 1), (0.8, 0.6, 0.4), (0.3, 0.9, 0.1)))


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER, str(tmp_path_factory.mktemp("cache")))
        yield


def stand(albedo: float = 0.5) -> PrimitiveSet:
    """A floor and two blocks."""
    blocks = [
        make_box((0, -0.1, 0), (6, 0.2, 6), albedo=[albedo] * 3),
        make_box((0.8, 0.5, 0), (0.8, 1, 0.8), albedo=[albedo] * 3),
        make_box((-0.8, 0.5, 0.3), (0.6, 1, 0.6), albedo=[albedo] * 3),
    ]
    return PrimitiveSet.concatenate(blocks)


def studio(gpu: Any, scene: Scene) -> Studio:
    camera = look_at(np.array([0.0, 2.5, 4.0]), np.array([0.0, 0.3, 0.0]))
    return Studio(gpu, scene, View(camera, "given"), SKY, (24, 18), 0.0)


@pytest.fixture(scope="module")
def judge(gpu: Any, mesh_of_boxes: Any) -> Judge:
    return Judge.of(studio(gpu, mesh_of_boxes(stand())), TruthSettings("reference-gpu", samples=64))


def test_a_set_that_is_the_mesh_has_no_fit_error(judge: Judge) -> None:
    errors = judge.errors(judge.truth_of(stand()), judge.pixels.image(judge.mesh.value))
    assert errors.unplaced == 0
    for error in (errors.fit, errors.geometry):
        assert abs(error.irradiance.rel_mse) < 4 * error.irradiance.standard_error + 1e-3
        assert error.bias == pytest.approx(0, abs=0.02)
    assert errors.solver.bias == pytest.approx(errors.total.bias, abs=0.02)
    assert errors.noise["mesh"] < 0.1
    assert errors.points == len(judge.pixels.points) > 200


def test_colours_are_the_materials_error_and_shapes_the_geometrys(judge: Judge) -> None:
    white = judge.errors(judge.truth_of(stand(0.95)), judge.pixels.image(judge.mesh.value))
    assert white.fit.bias > 0.05
    assert white.geometry.bias == pytest.approx(0, abs=0.02)
    assert white.material.rel_mse > 3 * white.geometry.irradiance.rel_mse
    floor_alone = judge.errors(judge.truth_of(stand().select([0])), judge.pixels.image(judge.mesh.value))
    for error in (floor_alone.geometry, floor_alone.fit):
        assert error.irradiance.rel_mse > 3 * error.irradiance.standard_error
        assert error.bias > 0.02


def test_solver_and_total_error_are_of_the_picture(judge: Judge) -> None:
    truth = judge.truth_of(stand())
    dark = judge.errors(truth, judge.pixels.image(0.5 * judge.mesh.value), floor=truth.lit.value)
    assert dark.solver.bias == pytest.approx(-0.5, abs=0.02)
    assert dark.total.irradiance.rel_mse == pytest.approx(0.25, abs=0.02)
    assert dark.total.flip > 2 * dark.total.flip_floor
    assert dark.total.psnr < dark.total.psnr_floor
    assert dark.total.regions["facing up"].bias == pytest.approx(-0.5, abs=0.01)
    assert dark.floor is not None
    assert dark.floor.bias == pytest.approx(0, abs=1e-9)
    assert set(judge.pictures(truth, judge.pixels.image(judge.mesh.value))) >= {"ours", "total-flip"}


def test_points_without_a_free_start_count_as_black(judge: Judge) -> None:
    thick = PrimitiveSet.concatenate([stand(), make_box((0, -0.1, 0), (6, 2.0, 6))])
    truth = judge.truth_of(thick)
    assert not truth.is_free.all()
    assert np.all(truth.lit.value[~truth.is_free] == 0)
    assert judge.errors(truth, judge.pixels.image(judge.mesh.value)).fit.bias < -0.3


def test_what_was_traced_is_kept(judge: Judge, monkeypatch: pytest.MonkeyPatch) -> None:
    judge.truth_of(stand())
    monkeypatch.setattr(PathTracer, "irradiance", None)
    again = Judge.of(judge.studio, judge.truth.settings)
    np.testing.assert_array_equal(again.mesh.value, judge.mesh.value)
    again.truth_of(stand())
    with pytest.raises(TypeError):
        Judge.of(judge.studio, replace(judge.truth.settings, seed=1))


def test_a_camera_that_sees_nothing_is_refused(gpu: Any, mesh_of_boxes: Any) -> None:
    away = look_at(np.array([0.0, 2.5, 4.0]), np.array([0.0, 3.0, 8.0]))
    blind = replace(studio(gpu, mesh_of_boxes(stand())), view=View(away, "given"))
    with pytest.raises(ValueError, match="sees nothing"):
        Judge.of(blind)


# ---------------------------------------------------------------------------------------------- figures


def test_noise_adds_nothing_to_the_relative_error() -> None:
    rng = np.random.default_rng(0)
    truth = rng.uniform(1, 2, (20_000, 3))

    def noisy() -> np.ndarray:
        return truth * rng.uniform(0.85, 1.15, truth.shape)

    a, b, x, y = (noisy() for _ in range(4))
    assert abs(relative_error((x, y), (a, b)).rel_mse) < 0.002
    assert relative_error((x, x), (a, a)).rel_mse > 0.01
    off = relative_error((1.1 * x, 1.1 * y), (a, b))
    assert off.rel_mse == pytest.approx(0.01, abs=0.003)
    assert off.ratio == off.numerator / off.denominator == pytest.approx(0.01, abs=0.002)


def test_a_few_black_points_do_not_hold_the_trimmed_error() -> None:
    truth = np.full((1000, 3), 1.0)
    truth[:5] = 0
    off = relative_error(twice(np.full((1000, 3), 1.1)), twice(truth))
    assert off.rel_mse > 10
    assert off.trimmed == pytest.approx(0.01, rel=0.02)
    noise = np.random.default_rng(0).normal(size=(1000, 3))
    assert relative_error((truth + noise, truth - noise), twice(truth)).trimmed < 0


def test_psnr_of_known_pictures() -> None:
    picture = np.full((4, 4, 3), 100, np.uint8)
    shown = np.ones((4, 4), bool)
    assert psnr(picture, picture + 10, shown) == pytest.approx(20 * np.log10(25.5))
    assert psnr(picture, picture, shown) == float("inf")
    shown[0] = False
    other = picture.copy()
    other[0] = 0
    assert psnr(picture, other, shown) == float("inf")


def test_noise_is_no_bias_of_dark_and_bright_parts(judge: Judge) -> None:
    rng = np.random.default_rng(3)
    count = len(judge.pixels.points)
    truth = np.full((count, 3), 2.0)
    halves = tuple(truth * rng.uniform(0.5, 1.5, (count, 1)) for _ in range(2))
    regions = by_region(judge.pixels, twice(truth), halves)  # type: ignore[arg-type]
    for name in ("dark", "mid", "bright"):
        assert regions[name].bias == pytest.approx(0, abs=0.1)
    assert regions["facing up"].share > 0.5


# -------------------------------------------------------------------------------------- scenes and sets


def test_gray_scenes_keep_their_holes_and_lamps() -> None:
    pixels = np.full((2, 2, 4), 90, np.uint8)
    pixels[0, :, 3] = 0
    leaf = Material(
        base_color_texture=TextureUse(0), alpha_mode=AlphaMode.MASK, emission=(1, 2, 3),
        emission_texture=TextureUse(0),
    )  # fmt: skip
    mesh = Mesh("m", np.eye(3), np.eye(3), np.array([[0, 1, 2]], np.uint32), 0, colors=np.full((3, 4), 0.3))
    scene = Scene(
        source=__file__,
        meshes=(mesh, replace(mesh, material=-1)),
        materials=(leaf, Material(base_color=(1, 0, 0, 1), base_color_texture=TextureUse(0))),
        textures=(Texture(0),),
        images=(Image("leaf", pixels),),
        instances=(Instance(0, -1, np.eye(4)),),
    )
    gray = gray_scene(scene)
    holes = gray.images[gray.textures[gray.materials[0].base_color_texture.texture].image].pixels
    assert np.all(holes[..., :3] == 255)
    np.testing.assert_array_equal(holes[..., 3], pixels[..., 3])
    assert gray.images[gray.textures[gray.materials[0].emission_texture.texture].image].pixels[0, 0, 0] == 90
    assert gray.materials[1].base_color_texture is None
    assert {material.base_color[:3] for material in gray.materials} == {(0.5, 0.5, 0.5)}
    assert gray.materials[gray.meshes[1].material].emission == (0, 0, 0)
    np.testing.assert_array_equal(gray.meshes[0].colors[:, :3], 1)
    np.testing.assert_array_equal(gray.meshes[0].colors[:, 3], 0.3)


def test_gray_sets_keep_their_lamps() -> None:
    lamp = make_box((0, 0, 0), (1, 1, 1), albedo=(0.1, 0.2, 0.3), emission=(1, 2, 3))
    gray = gray_set(lamp)
    assert np.all(gray.albedo == 0.5)
    np.testing.assert_array_equal(gray.emission, lamp.emission)


def test_triangulated_sets_lie_where_the_primitives_do() -> None:
    turn = (0.2, 0.3, 0.1, 0.927)
    colors = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (0, 1, 1), (1, 0, 1)]
    solids = PrimitiveSet.concatenate(
        [
            make_box((1, 2, 3), (1, 2, 0.5), rotation=np.array(turn) / np.linalg.norm(turn), albedo=colors),
            make_sphere((5, 0, 0), 0.5, albedo=(0.2, 0.4, 0.6)),
            make_cylinder((9, 0, 0), 0.5, 2, albedo=(0.3, 0.3, 0.3), emission=(1, 0, 0)),
        ]
    )
    scene = triangulate(solids)
    lower, upper = scene.bounds()
    expected = solids.bounds()
    np.testing.assert_allclose((lower, upper), expected, atol=1e-3)
    assert len(scene.instances) == 6 + 1 + 3
    for instance in scene.instances[:6]:
        mesh = scene.meshes[instance.mesh]
        color = scene.materials[mesh.material].base_color[:3]
        direction = mesh.normals[mesh.triangles[0, 0]]
        face = 2 * int(np.abs(direction).argmax()) + int(direction.sum() < 0)
        assert color == colors[face]
    endless = triangulate(PrimitiveSet.concatenate([solids, make_half_space((0, -1, 0))]))
    assert endless.bounds()[1][0] > 50
