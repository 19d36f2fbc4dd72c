"""The sets of primitives that a comparison is of: given ones, and fits by preset and by budget."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from pipelines.console import Update
from pipelines.convert import (
    RESULT_SUFFIXES,
    ConvertSettings,
    Preset,
    describe_fit,
    describe_primitives,
    fit_scene,
)

if TYPE_CHECKING:
    from fit.primitives import PrimitiveSet
    from fit.scene import Scene
    from fit.spaces import Air


@dataclass(frozen=True)
class Wish:
    """One set that is asked for: a file, or a fit by preset or by budget."""

    name: str
    file: Path | None = None
    preset: str | None = None
    budget: int | None = None

    @property
    def limit(self) -> int | None:
        """Primitives at most; None for a file."""
        from fit.settings import PRESETS

        return PRESETS[self.preset][0] if self.preset else self.budget


@dataclass(frozen=True)
class NamedSet:
    """A set with a report's keys about it; `air` where it was fitted here."""

    name: str
    primitives: PrimitiveSet
    about: dict[str, Any]
    air: Air | None = None


def wishes(files: Sequence[Path], presets: Sequence[str], budgets: Sequence[int]) -> list[Wish]:
    """A wish for each; files with the same stem get a number."""
    named: list[Wish] = []
    for file in files:
        stem = file.name.split(".")[0]
        number = sum(wish.name.split(" ")[0] == stem for wish in named)
        named.append(Wish(f"{stem} {number + 1}" if number else stem, file=file))
    named += [Wish(preset, preset=preset) for preset in presets]
    return named + [Wish(f"at most {budget}", budget=budget) for budget in budgets]


def obtain(
    wish: Wish, scene: Scene, output: Path, air: tuple[str, ...], seed: int, update: Update
) -> NamedSet:
    """Reads the file, or fits the scene and writes the set beside the report.

    Raises:
        ValueError: the file is no set, or the scene cannot be fitted.
    """
    from fit import export

    if wish.file is not None:
        primitives = export.read(wish.file)
        return NamedSet(wish.name, primitives, describe_primitives(primitives) | {"file": wish.file})
    settings = ConvertSettings(
        (scene.source,),
        output,
        max_primitives=wish.budget,
        preset=cast(Preset | None, wish.preset),
        air=air,
        seed=seed,
    )
    result = fit_scene(scene, settings, lambda stage, share: update(f"fit {wish.name}: {stage}", share))
    for suffix in RESULT_SUFFIXES:
        export.write(result.primitives, output / f"{file_stem(wish.name)}{suffix}")
    return NamedSet(wish.name, result.primitives, describe_fit(result) | {"file": None}, result.air)


def file_stem(name: str) -> str:
    """A name of a set or a column in the names of files."""
    return name.replace(", ", "-").replace(" ", "-")
