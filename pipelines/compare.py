"""`sdfprim compare`: a coarse set beside a fine one, in numbers and in pictures."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import NDArray

from pipelines.console import Terminal, Update
from pipelines.convert import (
    RESULT_SUFFIXES,
    ConvertSettings,
    Preset,
    describe_fit,
    fit_scene,
    make_folder,
    require_file,
)
from pipelines.difference import PIXELS_PER_DEGREE, flip, relative_error, twice
from pipelines.documents import report_header, to_json_value, write_json, write_text
from pipelines.errors import UsageError
from pipelines.quantities import METRICS, quantity
from pipelines.report.page import build_page
from pipelines.studio import AS_IN_THE_FILE, DEFAULT_FRAMES, LightingOptions, Studio

if TYPE_CHECKING:
    from fit.scene import Scene
    from runtime.renderer import Result

UInt8 = NDArray[np.uint8]

PRESETS: tuple[Preset, ...] = get_args(Preset)

VIEWS = ("indirect", "primitives", "normal")
"""Shown beside the final pictures; the normals also tell where there is geometry."""

GI, NO_GI = "sdfddgi", "without-gi"

FIT_SHARE = 0.5
"""Share of the progress bar that the fits take; the pictures take the rest."""


@dataclass(frozen=True)
class CompareSettings:
    """What `compare` was asked for; `size` in pixels, `exposure` in stops."""

    scene: Path
    output: Path
    camera: str | None = None
    lighting: LightingOptions = AS_IN_THE_FILE
    exposure: float = 0.0
    scale: float = 1.0
    size: tuple[int, int] = (640, 360)
    frames: int = DEFAULT_FRAMES
    seed: int = 0

    @property
    def page(self) -> Path:
        """The report for people."""
        return self.output / "report.html"


def run(settings: CompareSettings, progress: Update) -> dict[str, Any]:
    """Fits both presets, renders them, writes sets, pictures, `report.json` and `report.html`.

    Raises:
        UsageError: a file or camera is not there.
        NoAdapter: there is no GPU.
        ValueError: the scene can't be read; the message says why.
    """
    from fit import gltf

    check(settings)
    progress("load", 0.0)
    scene = gltf.load(settings.scene, scale=settings.scale)
    studio = Studio.set_up(scene, settings.camera, settings.lighting, settings.size, settings.exposure)
    fits = {preset: _fit(scene, settings, preset, progress) for preset in PRESETS}
    studio = studio.moved_inside(fits["fine"].air)
    shots = _shoot(studio, fits, settings.frames, progress)
    progress("write the report", 1.0)
    pictures, differences = _compare_pictures(shots)
    _write_pictures(settings.output, pictures)
    report = (
        report_header("compare", settings, settings.seed)
        | studio.describe()
        | {"frames": settings.frames, "notes": list(shots["fine"].notes)}
        | {"sets": {preset: _describe(fits[preset], shots[preset]) for preset in PRESETS}}
        | {"without_gi": {"passes_ms": dict(shots[NO_GI].timings)}}
        | {"differences": differences, "pictures": [f"{name}.png" for name in pictures]}
    )
    write_json(settings.output / "report.json", report)
    write_text(settings.page, build_page(to_json_value(report), pictures))
    return report


def check(settings: CompareSettings) -> None:
    """Raises UsageError for what can be seen to be wrong before any work is done, and makes the folder."""
    require_file(settings.scene)
    settings.lighting.check()
    if settings.frames < 1:
        raise UsageError(f"--frames {settings.frames}: give at least 1")
    if not 0 < settings.scale < float("inf"):
        raise UsageError(f"--scale {settings.scale}: give a number above zero")
    make_folder(settings.output)


def _fit(scene: Scene, settings: CompareSettings, preset: Preset, progress: Update) -> Any:
    """Fits one preset and writes its set beside the report."""
    from fit import export

    start = FIT_SHARE * PRESETS.index(preset) / len(PRESETS)
    fit_settings = ConvertSettings((settings.scene,), settings.output, preset=preset, seed=settings.seed)

    def at_stage(stage: str, fraction: float) -> None:
        progress(f"fit {preset}: {stage}", start + FIT_SHARE / len(PRESETS) * fraction)

    result = fit_scene(scene, fit_settings, at_stage)
    for suffix in RESULT_SUFFIXES:
        export.write(result.primitives, settings.output / f"{preset}{suffix}")
    return result


def _shoot(studio: Studio, fits: dict[Preset, Any], frames: int, progress: Update) -> dict[str, Result]:
    """Both sets with GI, and the fine one without."""
    jobs = [(preset, preset, GI) for preset in PRESETS] + [(NO_GI, PRESETS[-1], "none")]
    shots = {}
    for number, (name, preset, technique) in enumerate(jobs):

        def at_frame(done: int, count: int, name: str = name, number: int = number) -> None:
            share = (number + done / count) / len(jobs)
            progress(f"render {name}", FIT_SHARE + (1 - FIT_SHARE) * share)

        shots[name] = studio.render(fits[preset].primitives, technique, frames, VIEWS, at_frame)
    return shots


def _compare_pictures(shots: dict[str, Result]) -> tuple[dict[str, UInt8], dict[str, Any]]:
    """PNG pixels by name, and how far each picture lies from the fine set's with GI."""
    pictures = {name: shot.display() for name, shot in shots.items()}
    for preset in PRESETS:
        for view in VIEWS:
            pictures[f"{preset}-{view}"] = shots[preset].display(view)
    reference = shots["fine"]
    shown = np.any(reference.images["normal"] != 0, axis=-1)
    differences = {}
    for name in ("coarse", NO_GI):
        mean, pictures[f"{name}-flip"] = flip(reference.display(), shots[name].display())
        pixels = (shots[name].images["final"][shown], reference.images["final"][shown])
        error = relative_error(twice(pixels[0]), twice(pixels[1]))
        differences[name] = {"flip": mean, "flip_pixels_per_degree": PIXELS_PER_DEGREE} | asdict(error)
    return pictures, differences


def _describe(result: Any, shot: Result) -> dict[str, Any]:
    timed = [milliseconds for milliseconds in shot.timings.values() if milliseconds is not None]
    return describe_fit(result) | {
        "fit_seconds": round(sum(result.seconds.values()), 3),
        "passes_ms": dict(shot.timings),
        "frame_ms": sum(timed) if timed else None,
        "timed_frames": shot.frames,
    }


def _write_pictures(folder: Path, pictures: dict[str, UInt8]) -> None:
    from runtime.images import write_png

    for name, pixels in pictures.items():
        write_png(folder / f"{name}.png", pixels)


def show(report: dict[str, Any], settings: CompareSettings, terminal: Terminal) -> None:
    """Prints the two sets side by side, the differences, and where the report lies."""
    sets = [report["sets"][preset] for preset in PRESETS]
    rows = [
        [label, *(quantity(row[key], unit) for row in sets)]
        for label, key, unit in (
            ("primitives", "primitives", ""),
            ("on the GPU", "bytes", "bytes"),
            ("fit", "fit_seconds", "s"),
            ("frame on the GPU", "frame_ms", "ms"),
        )
    ]
    rows += [
        [metric.label, *(quantity(row["metrics"][metric.key], metric.unit) for row in sets)]
        for metric in METRICS
    ]
    terminal.table(["", *PRESETS], rows)
    for line in report["lights"]:
        terminal.line(f"light    {line}")
    for name, words in (("coarse", "coarse against fine"), (NO_GI, "without GI against with")):
        difference = report["differences"][name]
        terminal.line(f"{words}: FLIP {difference['flip']:.4f}, relMSE {difference['rel_mse']:.4g}")
    kind = " (software: times say nothing about a graphics card)" if report["software_adapter"] else ""
    terminal.line(f"adapter  {report['adapter']}{kind}")
    terminal.line(f"report   {settings.page}")
