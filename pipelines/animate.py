"""Which time of a scene's animation `render` shows: one, or a row of them as numbered pictures."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fit import motion
from fit.scene import Camera, Scene
from pipelines.errors import UsageError

if TYPE_CHECKING:
    from runtime.renderer import Renderer, Result

NUMBER = re.compile(r"%0?\d*d")
"""Where a picture's number goes in the name of the output: frames/%04d.png."""


@dataclass(frozen=True)
class TimeOptions:
    """`--time`, `--animate` and `--animation` as they were typed; no times: the scene at rest.

    seconds: one time. span: first and last time of a row of pictures, frames_per_second apart.
    animation: the name of the one that plays, all by default.
    """

    seconds: float | None = None
    span: tuple[float, float] | None = None
    frames_per_second: float = 24.0
    animation: str | None = None

    def check(self, output: Path) -> None:
        """Raises UsageError for what makes no sense."""
        if self.seconds is not None and self.span is not None:
            raise UsageError("--time and --animate: give one picture's time or a row's, not both")
        if not 0 < self.frames_per_second < float("inf"):
            raise UsageError(f"--frames-per-second {self.frames_per_second}: give a number above zero")
        if self.seconds is not None and not np.isfinite(self.seconds):
            raise UsageError(f"--time {self.seconds}: give seconds")
        numbered = len(NUMBER.findall(output.name)) == 1
        if self.span is not None and not numbered:
            name = output.with_name(f"%04d{output.suffix or '.png'}")
            raise UsageError(f"-o {output}: --animate writes many pictures; number them, as in {name}")
        if self.span is None and numbered:
            raise UsageError(f"-o {output}: there is one picture to write; name it without %d")

    def choose(self, scene: Scene) -> Scene:
        """The scene with the animation that plays.

        Raises:
            UsageError: there is none of that name, or none at all where a time was asked for.
        """
        names = [animation.name for animation in scene.animations]
        if self.animation is not None and self.animation not in names:
            raise UsageError(f"--animation {self.animation}: {_there_are(names)}")
        if not names and (self.seconds is not None or self.span is not None):
            raise UsageError(f"--time, --animate: {_there_are(names)}")
        if self.animation is None:
            return scene
        chosen = tuple(one for one in scene.animations if one.name == self.animation)
        return replace(scene, animations=chosen)

    def times(self) -> tuple[float, ...]:
        """Seconds of each picture; none for the scene at rest."""
        if self.span is None:
            return () if self.seconds is None else (self.seconds,)
        first, last = self.span
        count = int(np.floor((last - first) * self.frames_per_second + 1e-6)) + 1
        return tuple(first + k / self.frames_per_second for k in range(count))


AT_REST = TimeOptions()


def parse_span(text: str | None) -> tuple[float, float] | None:
    """Seconds from first:last.

    Raises:
        UsageError: the text is no such span.
    """
    if text is None:
        return None
    try:
        first, last = (float(part) for part in text.split(":"))
    except ValueError:
        raise UsageError(f"--animate {text}: give first:last in seconds, such as 0:2") from None
    if not -1e6 < first <= last < 1e6:
        raise UsageError(f"--animate {text}: the last time must be finite and not before the first")
    return first, last


def numbered(output: Path, number: int) -> Path:
    """The output with a picture's number in its name."""
    return output.with_name(NUMBER.sub(lambda place: place.group() % number, output.name))


def camera_at(camera: Camera, scene: Scene, seconds: float) -> Camera:
    """The camera at a time: one of the file moves with its node."""
    index = next((i for i, one in enumerate(scene.cameras) if one is camera), None)
    return camera if index is None else motion.posed(scene, seconds).cameras[index]


def play(
    renderer: Renderer,
    camera: Camera,
    times: tuple[float, ...],
    frames: int,
    views: tuple[str, ...],
    write: Callable[[int, Result], None],
    done: Callable[[int, int], None],
) -> Result:
    """Draws a picture for each time, as a game would: the light has settled on the first one, and follows
    frame by frame after it. Each is handed to `write` with its number; the last is returned."""
    for number, seconds in enumerate(times):
        renderer.set_time(seconds)
        here = camera_at(camera, renderer.scene, seconds)
        settle = frames - 1 if number == 0 else 0
        result = renderer.render(here, settle=settle, only=views)
        write(number, result)
        done(number + 1, len(times))
    return result


def _there_are(names: list[str]) -> str:
    return f"the scene has {', '.join(map(repr, names))}" if names else "the scene has no animation"
