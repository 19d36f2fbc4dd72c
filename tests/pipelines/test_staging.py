"""Views of many scenes in one file: each scene gets its own cameras and its own light."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipelines.errors import UsageError
from pipelines.staging import Stage, StagedShot, stage
from pipelines.studio import LightingOptions

OPTIONS = Stage.of_options(("west", "0,1,0,1,1,0,60"), LightingOptions(sky="1,1,1"), 0.5)

VIEWS = """
[hall.door]
camera = "0,1,0,1,1,0,60"
sun = "0,1,0,5"
exposure = 1.0

[hall.window]
camera = "west"
sun = "0,1,0,5"

[yard.gate]
camera = "0,1,0,1,1,0,60"
sky = "1,1,1"

[yard.well]
camera = "0,1,0,1,1,0,60"
sky = "2,2,2"

[attic.stairs]
sky = "1,1,1"
"""


@pytest.fixture
def views(tmp_path: Path) -> Path:
    file = tmp_path / "views.toml"
    file.write_text(VIEWS, encoding="utf-8")
    return file


def test_options_are_the_same_for_every_scene() -> None:
    assert stage(Path("hall.glb"), None, OPTIONS) is OPTIONS
    assert [shot.name for shot in OPTIONS.shots] == ["west", "view 2"]
    assert Stage.of_options((), LightingOptions(), 0.0).shots == (StagedShot("view", None, 0.0),)


def test_a_file_gives_each_scene_its_own(views: Path) -> None:
    hall = stage(Path("folder/hall.gltf"), views, OPTIONS)
    assert hall.lighting == LightingOptions(sun="0,1,0,5")
    assert hall.shots == (StagedShot("door", "0,1,0,1,1,0,60", 1.0), StagedShot("window", "west", 0.0))


@pytest.mark.parametrize(
    ("scene", "words"), [("cellar", "no table"), ("yard", "same sun and sky"), ("attic", "needs camera")]
)
def test_what_is_missing_is_told(views: Path, scene: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        stage(Path(f"{scene}.glb"), views, OPTIONS)


def test_a_file_that_is_no_file_of_views_is_told(tmp_path: Path) -> None:
    broken = tmp_path / "broken.toml"
    broken.write_text("[hall", encoding="utf-8")
    for file in (broken, tmp_path / "nothing.toml"):
        with pytest.raises(UsageError, match="no file of views"):
            stage(Path("hall.glb"), file, OPTIONS)
