"""`sdfprim slices`: cuts through a scene: which spaces are air, where the mesh is, where the set is."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipelines.console import Terminal, Update
from pipelines.convert import (
    ConvertSettings,
    check_air,
    describe_primitives,
    fit_scene,
    make_folder,
    require_file,
)
from pipelines.cuts import AXES, GAP, MOST_REJECTED, Cut, cut_scene, draw_cuts, pixel_size
from pipelines.documents import report_header
from pipelines.errors import UsageError
from pipelines.options import parse_numbers

if TYPE_CHECKING:
    from fit.primitives import PrimitiveSet
    from fit.spaces import Air

CONVERT_SHARE = 0.8
"""Share of the progress bar that a conversion takes when it comes first."""


@dataclass(frozen=True)
class SlicesSettings:
    """What `slices` was asked for; `at`: the point x,y,z, metres, that all three cuts go through; `air`: as
    for `convert`; `width`: of the picture, pixels."""

    scene: Path
    output: Path
    primitives: Path | None = None
    at: str | None = None
    air: tuple[str, ...] = ()
    scale: float = 1.0
    width: int = 1500


def run(settings: SlicesSettings, progress: Update) -> dict[str, Any]:
    """Draws the three cuts, writes the picture, and returns the report.

    Raises:
        UsageError: a file is missing, or an option can't be read.
        ValueError: the scene can't be read, or nothing in it stops light.
    """
    from fit import export, gltf
    from fit.air import find_air
    from fit.surface import from_scene
    from runtime.images import write_png

    check(settings)
    progress("load", 0.0)
    scene = gltf.load(settings.scene, scale=settings.scale)
    if settings.primitives is not None:
        primitives = export.read(settings.primitives)
    else:
        primitives = _converted(settings, scene, progress)
    progress("find the air", CONVERT_SHARE / 2 if settings.primitives else CONVERT_SHARE)
    air = find_air(from_scene(scene), scene, seeds=settings.air)
    point = np.array(parse_numbers("--at", settings.at, "x,y,z")) if settings.at else middle_of_air(air)
    metres = pixel_size(air, settings.width // 3 - 2 * GAP)
    cuts = []
    for axis in range(3):
        progress(f"cut across {AXES[axis]}", CONVERT_SHARE + 0.2 * axis / 3)
        cuts.append(cut_scene(primitives, air, axis, point, metres))
    write_png(settings.output, draw_cuts(cuts, air, settings.width))
    return (
        report_header("slices", settings)
        | {"set": describe_primitives(primitives) | {"file": settings.primitives}}
        | {"at": point.tolist(), "cuts": [_describe(cut) for cut in cuts]}
        | {"air": [asdict(space) for space in air.spaces]}
        | {"rejected": [asdict(space) for space in air.rejected], "picture": settings.output}
    )


def check(settings: SlicesSettings) -> None:
    """Raises UsageError for what can be seen to be wrong before any work is done."""
    require_file(settings.scene)
    if settings.primitives is not None:
        require_file(settings.primitives)
    check_air(settings.air)
    if settings.at is not None:
        parse_numbers("--at", settings.at, "x,y,z")
    if settings.output.suffix.lower() != ".png":
        raise UsageError(f"-o {settings.output}: end the name in .png")
    make_folder(settings.output.parent)
    if not 0 < settings.scale < float("inf"):
        raise UsageError(f"--scale {settings.scale}: give a number above zero")
    if not 300 <= settings.width <= 8192:
        raise UsageError(f"--width {settings.width}: give 300 to 8192 pixels")


def middle_of_air(air: Air) -> Any:
    """The median (3,) of the air within the surface's bounds: cuts through it show rooms, not their walls."""
    cells = np.argwhere(air.free)
    centers = air.grid.centers(cells)
    lower, upper = air.walls.bounds
    within = np.all((centers >= lower) & (centers <= upper), axis=1)
    chosen = centers[within] if within.any() else centers
    return np.median(chosen, axis=0) if len(chosen) else air.walls.center


def _converted(settings: SlicesSettings, scene: Any, progress: Update) -> PrimitiveSet:
    def converting(stage: str, fraction: float) -> None:
        progress(f"no --set given, converting: {stage}", CONVERT_SHARE * fraction)

    asked = ConvertSettings((settings.scene,), settings.output.parent, air=settings.air)
    primitives: PrimitiveSet = fit_scene(scene, asked, converting).primitives
    return primitives


def _describe(cut: Cut) -> dict[str, Any]:
    """Shares of the picture's air that the set fills, and how long the cut through the mesh is."""
    lengths = np.linalg.norm(cut.segments[:, 1] - cut.segments[:, 0], axis=1)
    filled = cut.is_air & (cut.owner >= 0)
    return {
        "axis": AXES[cut.axis],
        "place": cut.place,
        "mesh_m": float(lengths.sum()),
        "air_filled": float(filled.sum() / max(cut.is_air.sum(), 1)),
    }


def show(report: dict[str, Any], terminal: Terminal) -> None:
    """Prints where the cuts are, what counts as air there and why."""
    for cut in report["cuts"]:
        terminal.line(
            f"cut      {cut['axis']} = {cut['place']:.4g} m, {cut['air_filled']:.2%} of its air filled"
        )
    for space in report["air"]:
        terminal.line(f"air      {space['volume']:.4g} m3: {space['evidence']}")
    for space in report["rejected"][:MOST_REJECTED]:
        terminal.line(f"rejected {space['volume']:.4g} m3: {space['evidence']}")
    if len(report["rejected"]) > MOST_REJECTED:
        terminal.line(f"rejected {len(report['rejected']) - MOST_REJECTED} smaller spaces; --json lists them")
    origin = report["set"]["file"] or "converted just now, because no --set was given"
    terminal.line(f"set      {report['set']['primitives']} primitives, {origin}")
    terminal.line(f"wrote    {report['picture']}")
