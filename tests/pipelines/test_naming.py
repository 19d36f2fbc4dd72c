"""Result names: short where they can be, unique always."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipelines.naming import result_names


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (["/a/chair.glb", "/b/lamp.gltf"], ["chair", "lamp"]),
        (["/a/scene.gltf", "/b/scene.gltf"], ["a_scene", "b_scene"]),
        (["/x/a/scene.gltf", "/y/a/scene.gltf", "/z/lamp.glb"], ["x_a_scene", "y_a_scene", "lamp"]),
        (["/a/box.gltf", "/a/box.glb"], ["box_gltf", "box_glb"]),
        (["/a/Scene.glb", "/b/scene.glb"], ["a_Scene", "b_scene"]),
        (["/a/b.glb", "/c/b.glb", "/a_b.glb"], ["a_b", "c_b", "a_b_2"]),
        (["/a/v1.2.glb", "/a/v1.3.glb"], ["v1.2", "v1.3"]),
    ],
)
def test_names(files: list[str], names: list[str]) -> None:
    assert result_names([Path(file) for file in files]) == names


def test_the_same_file_twice_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.glb"
    with pytest.raises(ValueError, match="given twice"):
        result_names([file, tmp_path / "sub" / ".." / "a.glb"])
