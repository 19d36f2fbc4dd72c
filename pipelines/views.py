"""Chooses the camera: by name, by number, by numbers, or one that shows something."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fit.scene import Camera, Scene
from pipelines.bundled import bundled_file
from pipelines.errors import UsageError
from pipelines.options import CameraOption, looks_like_numbers, parse_camera
from runtime.camera import look_at, overview

if TYPE_CHECKING:
    from fit.spaces import Air

INDOOR_FOV = 75.0
"""Degrees: wide enough to show a room from inside."""

STEPS = 64
"""Samples along each direction in which the automatic camera looks for the longest view."""


@dataclass(frozen=True)
class View:
    """A camera, and where it came from; `made_up` where neither an option nor the file gave one."""

    camera: Camera
    origin: str
    made_up: bool = False


@dataclass(frozen=True)
class NamedView:
    """One table of a file of views such as `assets/views.toml`: values of the options of a picture. Without
    `sun` and `sky` the scene's own lights are on."""

    camera: str
    sun: str | None = None
    sky: str | None = None
    exposure: float = 0.0


def named_views(scene_file: Path, file: Path | None = None) -> dict[str, NamedView]:
    """The views of a file, of `assets/views.toml` by default, for scene files with this stem.

    Raises:
        UsageError: the file cannot be read, or a table of the scene is no view.
    """
    path = file or bundled_file("views.toml")
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8")).get(scene_file.stem, {})
    except (OSError, ValueError) as error:
        raise UsageError(f"--views {path}: this is no file of views: {error}") from None
    try:
        return {name: NamedView(**values) for name, values in tables.items()}
    except (TypeError, AttributeError):
        keys = ", ".join(field.name for field in fields(NamedView))
        raise UsageError(
            f"--views {path}: a table [{scene_file.stem}.NAME] needs camera, and may have no keys but {keys}"
        ) from None


def choose_view(option: str | None, scene: Scene, aspect: float, air: Air | None = None) -> View:
    """The camera that `--camera` names; without it the file's first one, else one made up for the scene.

    Raises:
        UsageError: no camera has that name or number; the message lists those that there are.
    """
    if option is None:
        if scene.cameras:
            return View(scene.cameras[0], f"the file's first camera, {scene.cameras[0].name!r}")
        return _made_up(scene, aspect, air)
    if looks_like_numbers(option):
        return View(_placed(parse_camera(option), scene), f"given as {option}")
    for camera in scene.cameras:
        if camera.name == option:
            return View(camera, f"the file's camera {option!r}")
    if option.isdecimal() and int(option) < len(scene.cameras):
        return View(scene.cameras[int(option)], f"the file's camera {option}")
    views = named_views(scene.source)
    if option in views:
        return View(_placed(parse_camera(views[option].camera), scene), f"the named view {option!r}")
    raise UsageError(f"--camera {option}: {_known(scene, views)}; you may give x,y,z,tx,ty,tz,fov")


def _known(scene: Scene, views: dict[str, NamedView]) -> str:
    there = [f"{index} or {camera.name!r}" for index, camera in enumerate(scene.cameras)]
    there += [repr(name) for name in views]
    return f"the scene has {', '.join(there)}" if there else "the scene has no camera"


def _placed(option: CameraOption, scene: Scene) -> Camera:
    return look_at(np.array(option.position), np.array(option.target), option.fov, near=_near(scene))


def _near(scene: Scene) -> float:
    """A near plane that suits the scene's size: 1 cm for a room, less for a model of a few centimetres."""
    lower, upper = scene.bounds()
    return float(np.clip(np.linalg.norm(upper - lower) * 1e-3, 1e-5, 0.05))


def _made_up(scene: Scene, aspect: float, air: Air | None) -> View:
    if air is not None and air.spaces and not any("outside" in space.evidence for space in air.spaces):
        room = max(air.spaces, key=lambda space: space.volume)
        camera = _inside(np.asarray(room.point), scene, air)
        return View(camera, "made up: inside the largest space of air", True)
    return View(overview(scene, aspect), "made up: the whole scene from outside", True)


def _inside(point: Any, scene: Scene, air: Air) -> Camera:
    """At a point of a room, looking along the level direction in which the air reaches farthest."""
    lower, upper = scene.bounds()
    reach = float(np.linalg.norm(upper - lower))
    angles = np.arange(16) * (np.pi / 8)
    directions = np.stack([np.cos(angles), 0 * angles, np.sin(angles)], axis=1)
    steps = np.arange(1, STEPS + 1) * (reach / STEPS)
    samples = point + directions[:, None] * steps[None, :, None]
    free = np.asarray(air.is_air(samples.reshape(-1, 3))).reshape(len(angles), STEPS)
    lengths = np.cumprod(free, axis=1).sum(axis=1)
    best = directions[int(np.argmax(lengths))]
    return look_at(point, point + best, INDOOR_FOV, near=_near(scene))
