"""The bundled scenes: what is committed is what the scripts write, and each holds what its name says."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from fit import gltf
from fit.export import read
from fit.scene import transform_points
from fit.sdf import union_distance
from pipelines.bundled import bundled_file
from pipelines.describe import describe_scene
from pipelines.options import parse_camera, parse_color, parse_sun
from pipelines.views import named_views

STAGES = (
    "closed_box", "cornell", "courtyard", "curtains", "emissive_room", "furnace", "tunnel", "two_rooms",
)  # fmt: skip
DEMONSTRATIONS = ("ball_court", "dark_room", "two_probe_room")
NAMES = (
    "atrium",
    "colonnade",
    "sealed_room",
    "six_solids",
    "table",
    "two_colour_wall",
    *STAGES,
    *DEMONSTRATIONS,
)


def test_scenes_are_not_stale(bundled_assets: Path, tmp_path: Path) -> None:
    subprocess.run(
        [sys.executable, bundled_assets / "generate.py", tmp_path], check=True, stdout=subprocess.DEVNULL
    )
    expected = [f"{name}.glb" for name in NAMES] + [f"{name}.npz" for name in (*STAGES, *DEMONSTRATIONS)]
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(expected)
    stale = [file.name for file in tmp_path.iterdir() if not _hold_the_same(file, bundled_assets / file.name)]
    assert not stale, f"run `make assets`: {stale}"


def _hold_the_same(one: Path, other: Path) -> bool:
    """Archives are compressed otherwise by other versions of zlib, so their arrays are compared."""
    if one.suffix != ".npz":
        return one.read_bytes() == other.read_bytes()
    with np.load(one) as first, np.load(other) as second:
        return first.files == second.files and all(
            first[key].dtype == second[key].dtype and np.array_equal(first[key], second[key])
            for key in first.files
        )


@pytest.mark.parametrize("name", NAMES)
def test_scenes_load_whole(name: str) -> None:
    scene = gltf.load(bundled_file(f"{name}.glb"))
    assert scene.cameras
    assert (scene.repairs, scene.ignored) == ({}, ())
    for mesh in scene.meshes:
        corners = mesh.positions[mesh.triangles]
        faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert np.linalg.norm(faces, axis=1).min() > 0, f"{mesh.name} has a triangle without area"
        shading = mesh.normals[mesh.triangles].mean(axis=1)
        assert (np.einsum("ij,ij->i", faces, shading) > 0).all(), f"{mesh.name} faces away from its normals"


@pytest.mark.parametrize(
    ("name", "closed"), [("sealed_room", 6), ("two_rooms", 12), ("cornell", 2), ("colonnade", 1)]
)
def test_closed_meshes(name: str, closed: int) -> None:
    assert describe_scene(gltf.load(bundled_file(f"{name}.glb")))["closed_meshes"] == closed


@pytest.mark.parametrize("name", (*STAGES, *DEMONSTRATIONS))
def test_stages_are_the_same_as_meshes_and_as_primitives(name: str) -> None:
    """Every triangle's centre lies on a primitive, but for a ball's, whose facets cut its rim off."""
    scene, primitives = gltf.load(bundled_file(f"{name}.glb")), read(bundled_file(f"{name}.npz"))
    centres = np.concatenate(
        [
            transform_points(instance.world_from_local, mesh.positions[mesh.triangles].mean(axis=1))
            for instance in scene.instances
            for mesh in (scene.meshes[instance.mesh],)
        ]
    )
    distance = union_distance(primitives, centres)[0]
    assert np.abs(distance).max() <= 0.02 * 0.4  # metres: the largest ball's sagitta
    albedo = {tuple(np.round(m.base_color[:3], 4)) for m in scene.materials}
    found = {tuple(np.round(color, 4)) for color in primitives.albedo.reshape(-1, 3).astype(float)}
    assert found == albedo


def test_stages_have_a_sky_and_a_camera(bundled_assets: Path) -> None:
    stages = tomllib.loads((bundled_assets / "stages.toml").read_text(encoding="utf-8"))
    assert sorted(stages) == sorted(STAGES)
    for name, stage in stages.items():
        cameras = [camera.name for camera in gltf.load(bundled_file(f"{name}.glb")).cameras]
        assert stage["camera"] in cameras
        parse_color("--sky", stage["sky"])


def test_light_sources() -> None:
    cornell = gltf.load(bundled_file("cornell.glb"))
    assert [m.emission for m in cornell.materials if any(m.emission)] == [pytest.approx((17, 12, 4))]
    sun = gltf.load(bundled_file("sealed_room.glb")).lights[0]
    towards = np.array([0.3, 1.0, 0.2])
    np.testing.assert_allclose(sun.world_from_local[:3, 2], towards / np.linalg.norm(towards), atol=1e-6)
    assert sun.intensity == 10


def test_named_views_parse() -> None:
    views = named_views(Path("anywhere") / "Sponza.gltf")
    assert {"atrium", "arcade"} <= set(views)
    for view in views.values():
        assert parse_camera(view.camera).fov > 0
        if view.sun is not None:
            parse_sun(view.sun)
        if view.sky is not None:
            parse_color("--sky", view.sky)
    assert named_views(Path("unheard-of.glb")) == {}
