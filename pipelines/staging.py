"""From where, and in which light, a scene is looked at: by options, or by a file of views of many scenes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pipelines.errors import UsageError
from pipelines.studio import LightingOptions
from pipelines.views import named_views


@dataclass(frozen=True)
class StagedShot:
    """A name for reports; a camera as `--camera` takes it, None for the file's first; exposure in stops."""

    name: str
    camera: str | None
    exposure: float


@dataclass(frozen=True)
class Stage:
    """The shots of one scene, all in one light."""

    lighting: LightingOptions
    shots: tuple[StagedShot, ...]

    @staticmethod
    def of_options(cameras: tuple[str, ...], lighting: LightingOptions, exposure: float) -> Stage:
        """As options have it, the same for every scene."""
        shots = [
            StagedShot(camera if "," not in camera else f"view {number}", camera, exposure)
            for number, camera in enumerate(cameras, 1)
        ]
        return Stage(lighting, tuple(shots) or (StagedShot("view", None, exposure),))


def stage(scene: Path, views: Path | None, otherwise: Stage) -> Stage:
    """The scene's views in the file `views`, or what options say where there is no such file.

    Raises:
        UsageError: the file has no view of the scene, or views under different light.
    """
    if views is None:
        return otherwise
    found = named_views(scene, views)
    if not found:
        raise UsageError(f"--views {views}: it has no table [{scene.stem}.NAME] with a camera for {scene}")
    lights = {LightingOptions(view.sun, view.sky) for view in found.values()}
    if len(lights) > 1:
        raise UsageError(f"--views {views}: give all views of {scene.stem} the same sun and sky")
    (light,) = lights
    light.check()
    return Stage(light, tuple(StagedShot(name, view.camera, view.exposure) for name, view in found.items()))
