"""`sdfprim render`: one picture of a scene, lit through its primitives."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fit.motion import posed
from pipelines.animate import AT_REST, TimeOptions, numbered, play
from pipelines.console import Terminal, Update
from pipelines.convert import (
    ConvertSettings,
    describe_fit,
    describe_primitives,
    fit_scene,
    make_folder,
    require_file,
)
from pipelines.documents import report_header
from pipelines.errors import UsageError
from pipelines.gi_presets import GiPreset, find_preset
from pipelines.methods import Culling
from pipelines.studio import AS_IN_THE_FILE, DEFAULT_FRAMES, Contact, LightingOptions, Studio
from runtime.settings import ShadingMode
from runtime.views import AOV_LAYERS, UNLIT, VIEWS

if TYPE_CHECKING:
    from fit.primitives import PrimitiveSet
    from fit.scene import Scene
    from fit.spaces import Air
    from runtime.renderer import Result

Technique = Literal[
    "sdfddgi", "ddgi", "ddgi-triangles", "ddgi-cascades", "none", "reference", "reference-gpu"
]

REFERENCES = ("reference", "reference-gpu")
"""Path tracers of the mesh itself: Mitsuba's, and the runtime's."""

DEFAULT_SAMPLES = 64

CONVERT_SHARE = 0.4
"""Share of the progress bar that a conversion takes when it comes first."""


@dataclass(frozen=True)
class PictureSettings:
    """What `render` was asked for; `size` in pixels, `exposure` in stops. A view that shows no light takes
    one frame and no technique, whatever `frames` and `gi` say.

    samples, noise: of a reference, paths a pixel, and the mean absolute noise, a share of the mean, at which
    to end before. glossy: smooth surfaces and metals reflect. contact: light from what is near on the
    screen. shading: how indirect light comes to the pixels. quality: name of a preset, which then stands
    for `gi`; presets: the file that it is in, instead
    of the program's own. when: the time of the scene's animation, or the row of times for which `output`
    numbers a picture each.
    """

    scene: Path
    output: Path
    primitives: Path | None = None
    gi: Technique = "sdfddgi"
    camera: str | None = None
    lighting: LightingOptions = AS_IN_THE_FILE
    exposure: float = 0.0
    scale: float = 1.0
    aov: bool = False
    size: tuple[int, int] = (640, 360)
    frames: int = DEFAULT_FRAMES
    view: str = "final"
    samples: int = DEFAULT_SAMPLES
    noise: float | None = None
    glossy: bool = False
    contact: Contact = "off"
    shading: ShadingMode = ShadingMode.FULL
    quality: str | None = None
    presets: Path | None = None
    when: TimeOptions = AT_REST
    culling: Culling = "grid"

    @property
    def preset(self) -> GiPreset | None:
        """What `quality` names."""
        return None if self.quality is None else find_preset(self.quality, self.presets)


def run(settings: PictureSettings, progress: Update) -> dict[str, Any]:
    """Renders the picture, writes it, and returns the report.

    Raises:
        UsageError: a file, camera or view is not there.
        NoAdapter: there is no GPU.
        MissingMitsuba: it is asked for and not installed.
        ValueError: a file can't be read; the message says which and why.
    """
    from fit import gltf

    check(settings)
    if (preset := settings.preset) is not None:
        settings = replace(settings, gi=preset.gi)  # type: ignore[arg-type]
    if settings.gi == "reference":
        from pipelines.reference.mitsuba import load_mitsuba

        load_mitsuba()
    if settings.view in UNLIT and not settings.aov:
        settings = replace(settings, gi="none", frames=1)
    progress("load", 0.0)
    scene = settings.when.choose(gltf.load(settings.scene, scale=settings.scale))
    if settings.gi in REFERENCES and settings.when.seconds is not None:
        scene = posed(scene, settings.when.seconds)
    studio = Studio.set_up(scene, settings.camera, settings.lighting, settings.size, settings.exposure)
    if settings.gi in REFERENCES:
        return _run_reference(settings, studio, progress)
    primitives, air, source = _primitives(settings, scene, progress)
    if air is None and studio.view.made_up:
        air = _air(scene, progress)
    if air is not None:
        studio = studio.moved_inside(air)
    start = CONVERT_SHARE if settings.primitives is None else 0.1

    def done(frame: int, frames: int) -> None:
        progress("render", start + (1 - start) * frame / frames)

    began = time.perf_counter()
    views = (settings.view, *(AOV_LAYERS if settings.aov else ()))
    options: dict[str, Any] = {
        "glossy": settings.glossy,
        "contact": settings.contact,
        "culling": settings.culling,
        "shading": settings.shading,
    }
    if preset is not None:
        options |= preset.technique_options(software=studio.gpu.is_software)
    if times := settings.when.times():
        renderer = studio.open_renderer(primitives, settings.gi, **options)

        def write(number: int, result: Result) -> None:
            file = numbered(settings.output, number) if settings.when.span else settings.output
            write_picture(replace(settings, output=file), result)

        result = play(renderer, studio.view.camera, times, settings.frames, views, write, done)
    else:
        result = studio.render(primitives, settings.gi, settings.frames, views, done, **options)
        write_picture(settings, result)
    seconds = time.perf_counter() - began
    return (
        report_header("render", settings, seed=0)
        | studio.describe()
        | {"set": source, "gi": settings.gi, "view": settings.view, "frames": settings.frames}
        | {"shading": settings.shading.value}
        | {"notes": list(result.notes), "picture": settings.output, "seconds": round(seconds, 3)}
        | {"timed_frames": result.frames, "passes_ms": dict(result.timings), "times_s": list(times)}
    )


def _run_reference(settings: PictureSettings, studio: Studio, progress: Update) -> dict[str, Any]:
    """The same of the path-traced mesh."""
    from pipelines.gi_errors.truth import TruthSettings
    from pipelines.reference_picture import render_reference

    if studio.view.made_up and (air := _air(studio.scene, progress)) is not None:
        studio = studio.moved_inside(air)
    began = time.perf_counter()
    assert settings.gi in REFERENCES
    truth = TruthSettings(settings.gi, settings.samples, settings.noise)  # type: ignore[arg-type]
    views = (settings.view, *(AOV_LAYERS if settings.aov else ()))
    picture = render_reference(studio, truth, views, progress)
    seconds = time.perf_counter() - began
    write_picture(settings, picture.result)
    return (
        report_header("render", settings, seed=truth.seed)
        | studio.describe()
        | {"set": None, "gi": settings.gi, "view": settings.view, "frames": 0}
        | {"notes": list(picture.result.notes), "picture": settings.output, "seconds": round(seconds, 3)}
        | {"timed_frames": 0, "passes_ms": {}, "reference": picture.describe()}
    )


def check(settings: PictureSettings) -> None:
    """Raises UsageError for what can be seen to be wrong before any work is done."""
    require_file(settings.scene)
    if settings.primitives is not None:
        require_file(settings.primitives)
    settings.lighting.check()
    settings.when.check(settings.output)
    suffix = settings.output.suffix.lower()
    if suffix not in (".png", ".exr"):
        raise UsageError(f"-o {settings.output}: end the name in .png or .exr")
    if settings.aov and suffix != ".exr":
        raise UsageError(f"--aov writes its layers into an EXR: -o {settings.output.with_suffix('.exr')}")
    if settings.output.is_dir():
        raise UsageError(f"-o {settings.output} is a folder: name a file")
    make_folder(settings.output.parent)
    if settings.presets is not None and settings.quality is None:
        raise UsageError(f"--presets {settings.presets}: say which of them by --quality")
    if settings.preset is not None and settings.gi in REFERENCES:
        raise UsageError(f"--quality {settings.quality}: --gi {settings.gi} takes no probes")
    if settings.frames < 1:
        raise UsageError(f"--frames {settings.frames}: give at least 1")
    if settings.samples < 2:
        raise UsageError(f"--samples {settings.samples}: give at least 2, so that the noise can be told")
    if settings.noise is not None and not 0 < settings.noise < float("inf"):
        raise UsageError(f"--noise {settings.noise}: give a share of the mean above zero, such as 0.02")
    if settings.gi in REFERENCES and settings.when.span is not None:
        raise UsageError(f"--animate: --gi {settings.gi} makes one picture; give --time")
    if settings.gi in REFERENCES and settings.primitives is not None:
        raise UsageError(f"--set {settings.primitives}: --gi {settings.gi} lights the mesh and needs no set")
    if not 0 < settings.scale < float("inf"):
        raise UsageError(f"--scale {settings.scale}: give a number above zero")
    if not np.isfinite(settings.exposure):
        raise UsageError(f"--exposure {settings.exposure}: give a finite number of stops")
    is_technique_view = "/" in settings.view  # those are known when the technique runs
    if settings.gi in REFERENCES and settings.glossy:
        raise UsageError(
            f"--glossy: --gi {settings.gi} takes every surface for diffuse; leave one of them out"
        )
    if settings.gi in REFERENCES and settings.contact != "off":
        raise UsageError(
            f"--contact {settings.contact}: --gi {settings.gi} traces what is near; leave one of them out"
        )
    if settings.gi in REFERENCES and is_technique_view:
        raise UsageError(f"--view {settings.view}: --gi {settings.gi} has no such view")
    if settings.view not in VIEWS and not is_technique_view:
        raise UsageError(f"--view {settings.view}: there is no such view; there are {', '.join(VIEWS)}")


def write_picture(settings: PictureSettings, result: Result) -> None:
    """PNG with exposure and tone curve, or EXR with the layers that were asked for."""
    from runtime.images import write_exr, write_png

    if settings.output.suffix.lower() == ".png":
        write_png(settings.output, result.display(settings.view))
        return
    layers = {name: result.images[name] for name in AOV_LAYERS} if settings.aov else {}
    write_exr(settings.output, result.images[settings.view], layers)


def _primitives(
    settings: PictureSettings, scene: Scene, progress: Update
) -> tuple[PrimitiveSet, Air | None, dict[str, Any]]:
    """The set to light through: the given file, or a conversion here and now."""
    from fit import export

    if settings.primitives is not None:
        primitives = export.read(settings.primitives)
        return primitives, None, describe_primitives(primitives) | {"file": settings.primitives}

    def converting(stage: str, fraction: float) -> None:
        progress(f"no --set given, converting: {stage}", CONVERT_SHARE * fraction)

    most = None if settings.preset is None else settings.preset.max_primitives
    convert = ConvertSettings((settings.scene,), settings.output.parent, max_primitives=most)
    result = fit_scene(scene, convert, converting)
    return result.primitives, result.air, describe_fit(result) | {"file": None}


def _air(scene: Scene, progress: Update) -> Air | None:
    """Where the scene's air is; None where nothing of it stops light."""
    from fit.air import find_air
    from fit.surface import from_scene

    progress("look for a place for the camera", 0.0)
    try:
        return find_air(from_scene(scene), scene)
    except ValueError:
        return None


def show(report: dict[str, Any], terminal: Terminal) -> None:
    """Prints what was on, and the time of each pass."""
    kind = " (software: times say nothing about a graphics card)" if report["software_adapter"] else ""
    terminal.line(f"adapter  {report['adapter']}{kind}")
    terminal.line(f"camera   {report['camera']}")
    for line in report["lights"]:
        terminal.line(f"light    {line}")
    for line in report["notes"]:
        terminal.line(f"note     {line}")
    if report["set"] is None:
        reference = report["reference"]
        terminal.line(
            f"traced   {reference['samples']} paths a pixel, noise {reference['noise']:.2%} of the mean"
        )
    else:
        origin = report["set"]["file"] or "converted just now, because no --set was given"
        terminal.line(f"set      {report['set']['primitives']} primitives, {origin}")
        show_passes(report["passes_ms"], report["timed_frames"], terminal)
    terminal.line(f"wrote    {report['picture']}")


def show_passes(passes: dict[str, float | None], frames: int, terminal: Terminal) -> None:
    """The table of GPU times."""
    rows = [[name, milliseconds] for name, milliseconds in passes.items()]
    timed = [milliseconds for milliseconds in passes.values() if milliseconds is not None]
    rows.append(["total", sum(timed) if timed else None])
    terminal.table(["pass", f"GPU ms, median of {frames} frames"], rows)
