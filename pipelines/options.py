"""Reads the values of options that are more than one word: sizes, vectors, cameras, lights."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

from pipelines.errors import UsageError

LARGEST_SIZE = 8192
"""Largest texture side that the renderer asks the GPU for."""


@dataclass(frozen=True)
class SunOption:
    """`direction` towards the sun, any length; `strength` is the irradiance on a surface facing it, W/m2."""

    direction: tuple[float, float, float]
    strength: float


@dataclass(frozen=True)
class CameraOption:
    """A camera given by numbers: metres, and the vertical field of view in degrees."""

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    fov: float


@dataclass(frozen=True)
class ProbesOption:
    """How fine probes stand: `counts` along x, y and z, or `spacing` in metres; `text` as it was typed."""

    text: str
    counts: tuple[int, int, int] | None = None
    spacing: float | None = None


def parse_size(text: str) -> tuple[int, int]:
    """`640x360` as (width, height)."""
    match = re.fullmatch(r"(\d+)[xX](\d+)", text.strip())
    if not match:
        raise UsageError(f"--size {text}: give width x height in pixels, like 640x360")
    width, height = int(match[1]), int(match[2])
    if not (1 <= width <= LARGEST_SIZE and 1 <= height <= LARGEST_SIZE):
        raise UsageError(f"--size {text}: each side is 1 to {LARGEST_SIZE} pixels")
    return width, height


def parse_numbers(option: str, text: str, names: str) -> tuple[float, ...]:
    """As many finite numbers as `names` has comma-separated words."""
    wanted = len(names.split(","))
    try:
        numbers = tuple(float(word) for word in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != wanted or not all(map(math.isfinite, numbers)):
        raise UsageError(f"{option} {text}: give {wanted} numbers with commas between them: {names}")
    return numbers


def parse_sun(text: str) -> SunOption:
    """`x,y,z,strength`."""
    x, y, z, strength = parse_numbers("--sun", text, "x,y,z,strength")
    if x == y == z == 0:
        raise UsageError(f"--sun {text}: x,y,z points towards the sun and can't be zero")
    if strength < 0:
        raise UsageError(f"--sun {text}: the strength can't be negative")
    return SunOption((x, y, z), strength)


def parse_color(option: str, text: str) -> tuple[float, float, float]:
    """`r,g,b`, linear and not negative."""
    r, g, b = parse_numbers(option, text, "r,g,b")
    if min(r, g, b) < 0:
        raise UsageError(f"{option} {text}: radiance can't be negative")
    return r, g, b


def parse_budgets(option: str, text: str) -> tuple[int, ...]:
    """`64,4,16` as rising numbers of primitives, each once."""
    words = text.split(",")
    if not all(re.fullmatch(r"\s*\d{1,6}\s*", word) and int(word) > 0 for word in words):
        raise UsageError(
            f"{option} {text}: give whole numbers above zero with commas between them: 16,64,256"
        )
    return tuple(sorted({int(word) for word in words}))


def parse_names(option: str, text: str, known: Iterable[str]) -> tuple[str, ...]:
    """`a,b` as names out of `known`, each once."""
    names = tuple(dict.fromkeys(word.strip() for word in text.split(",")))
    for name in names:
        if name not in known:
            raise UsageError(f"{option} {name}: there is no such thing; there are {', '.join(known)}")
    return names


def parse_probes(text: str) -> tuple[ProbesOption | None, ...]:
    """`default,22x14x32,0.5`: the technique's own choice, counts along x, y and z, or a spacing in metres."""
    return tuple(dict.fromkeys(_probes(word.strip()) for word in text.split(",")))


def _probes(word: str) -> ProbesOption | None:
    if word == "default":
        return None
    if match := re.fullmatch(r"(\d{1,4})x(\d{1,4})x(\d{1,4})", word, re.IGNORECASE):
        x, y, z = (int(number) for number in match.groups())
        if min(x, y, z) >= 2:
            return ProbesOption(word, counts=(x, y, z))
    elif re.fullmatch(r"\d*\.?\d+", word) and float(word) > 0:
        return ProbesOption(word, spacing=float(word))
    raise UsageError(
        f"--probes {word}: give default, counts of at least 2 like 22x14x32, or a spacing in metres like 0.5"
    )


def looks_like_numbers(text: str) -> bool:
    """Whether an option's value is a list of numbers and not a name or a path."""
    return "," in text and re.fullmatch(r"[-+0-9.,eE\s]*|.*\b(nan|inf)\b.*", text) is not None


def parse_camera(text: str) -> CameraOption:
    """`x,y,z,tx,ty,tz,fov`."""
    x, y, z, tx, ty, tz, fov = parse_numbers("--camera", text, "x,y,z,tx,ty,tz,fov")
    if (x, y, z) == (tx, ty, tz):
        raise UsageError(f"--camera {text}: position and target are the same point")
    if not 0 < fov < 180:
        raise UsageError(f"--camera {text}: the field of view is vertical, in degrees, between 0 and 180")
    return CameraOption((x, y, z), (tx, ty, tz), fov)
