"""The bundled scenes: what is committed is what the scripts write, and each holds what its name says."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fit import gltf
from pipelines.bundled import bundled_file
from pipelines.describe import describe_scene
from pipelines.options import parse_camera, parse_color, parse_sun
from pipelines.views import named_views

NAMES = (
    "atrium", "colonnade", "cornell", "sealed_room", "six_solids", "table", "two_colour_wall", "two_rooms",
)  # fmt: skip


def test_scenes_are_not_stale(bundled_assets: Path, tmp_path: Path) -> None:
    subprocess.run(
        [sys.executable, bundled_assets / "generate.py", tmp_path], check=True, stdout=subprocess.DEVNULL
    )
    assert sorted(file.stem for file in tmp_path.iterdir()) == sorted(NAMES)
    stale = [
        file.name
        for file in tmp_path.iterdir()
        if file.read_bytes() != (bundled_assets / file.name).read_bytes()
    ]
    assert not stale, f"run `make assets`: {stale}"


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
