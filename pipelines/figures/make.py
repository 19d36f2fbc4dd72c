"""`sdfprim bench gi --figures`: renders every figure's pictures, and writes them, a report and a page."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipelines.console import Terminal, Update
from pipelines.convert import ConvertSettings, fit_scene, make_folder, require_file
from pipelines.documents import report_header, write_json, write_text
from pipelines.errors import UsageError
from pipelines.figures.catalogue import TRUTH, Figure, Panel, Subject, catalogue
from pipelines.figures.page import build_page
from pipelines.options import parse_probes
from pipelines.studio import AS_IN_THE_FILE, LightingOptions, Studio

if TYPE_CHECKING:
    from fit.primitives import PrimitiveSet
    from runtime.renderer import Result

SUN_AND_SKY = LightingOptions(sun="0.4,1,0.6,4", sky="0.5,0.6,0.8")
"""What Figure 14's body stands in."""


@dataclass(frozen=True)
class FiguresSettings:
    """What was asked for. scene, primitives: the paper's Sponza and its set; model: its dragon. only: numbers
    of figures, all by default. frames: before a picture; samples: paths a pixel of what is path traced."""

    output: Path
    scene: Path | None = None
    primitives: Path | None = None
    model: Path | None = None
    only: tuple[int, ...] = ()
    camera: str | None = None
    lighting: LightingOptions = AS_IN_THE_FILE
    exposure: float = 0.0
    size: tuple[int, int] = (640, 360)
    frames: int = 96
    samples: int = 256

    @property
    def page(self) -> Path:
        return self.output / "figures.html"


def run(settings: FiguresSettings, update: Update) -> dict[str, Any]:
    """Makes the figures: OUTPUT/figure-NN-K.png, OUTPUT/figures.json and OUTPUT/figures.html.

    A figure without the file that it needs is a row with the reason.

    Raises:
        UsageError: a file or figure is not there.
        NoAdapter: there is no GPU.
    """
    figures = check(settings)
    report = report_header("bench gi --figures", settings, seed=0) | {"figures": []}
    maker = _Maker(settings)
    count = max(sum(len(figure.panels) for figure in figures), 1)
    begun = 0
    for figure in figures:
        row: dict[str, Any] = {"number": figure.number, "missing": figure.missing, "panels": []}
        row |= figure.words()
        report["figures"].append(row)
        for index, panel in enumerate(figure.panels):
            update(f"figure {figure.number}: {panel.tag}", begun / count)
            begun += 1
            file = settings.output / f"figure-{figure.number:02d}-{index + 1}.png"
            row["panels"].append(maker.make(panel, file))
            report |= maker.adapter
            write_json(settings.output / "figures.json", report)
            write_text(settings.page, build_page(report, settings.output))
    write_json(settings.output / "figures.json", report)
    write_text(settings.page, build_page(report, settings.output))
    return report


def check(settings: FiguresSettings) -> tuple[Figure, ...]:
    """The figures that are wanted; makes the folder.

    Raises:
        UsageError: what can be seen to be wrong before any work is done.
    """
    for file in (settings.scene, settings.primitives, settings.model):
        if file is not None:
            require_file(file)
    if settings.primitives is not None and settings.scene is None:
        raise UsageError(f"--set {settings.primitives}: name the scene that it belongs to, too")
    settings.lighting.check()
    if settings.frames < 1 or settings.samples < 2:
        raise UsageError("--frames and --samples: give at least 1 frame and 2 samples")
    make_folder(settings.output)
    atrium = settings.scene and Subject(
        settings.scene, settings.primitives, settings.lighting, settings.camera, settings.exposure
    )
    model = settings.model and Subject(settings.model, None, SUN_AND_SKY)
    figures = catalogue(atrium or None, model or None)
    numbers = [figure.number for figure in figures]
    unknown = [str(number) for number in settings.only if number not in numbers]
    if unknown:
        raise UsageError(
            f"--figure {', '.join(unknown)}: there are counterparts of {', '.join(map(str, numbers))}"
        )
    return tuple(figure for figure in figures if not settings.only or figure.number in settings.only)


class _Maker:
    """Renders panels; scenes, sets and fits are made once."""

    def __init__(self, settings: FiguresSettings) -> None:
        self.settings = settings
        self.adapter: dict[str, Any] = {}
        self._studios: dict[tuple[Any, ...], Studio] = {}
        self._sets: dict[tuple[Any, ...], PrimitiveSet] = {}

    def make(self, panel: Panel, file: Path) -> dict[str, Any]:
        """Writes the panel's picture; what to tell of it."""
        from runtime.images import write_png

        studio = self._studio(panel)
        self.adapter = {key: studio.describe()[key] for key in ("adapter", "software_adapter", "size")}
        result, primitives = self._render(panel, studio)
        write_png(file, result.display(panel.view))
        linear = result.images[panel.view]
        return {
            "tag": panel.tag,
            "picture": file.name,
            "primitives": primitives,
            "mean": float(np.mean(linear, dtype=np.float64)),
            "camera": studio.view.origin,
            "lights": studio.describe()["lights"],
        }

    def _render(self, panel: Panel, studio: Studio) -> tuple[Result, int | None]:
        if panel.gi == TRUTH:
            from pipelines.gi_errors.truth import TruthSettings
            from pipelines.reference_picture import render_reference

            truth = TruthSettings(TRUTH, self.settings.samples)
            return render_reference(studio, truth, (panel.view,)).result, None
        primitives = self._primitives(panel.subject, studio)
        options: dict[str, Any] = {} if panel.grid is None else {"grid": panel.grid}
        probes = None if panel.probes is None else parse_probes(panel.probes)[0]
        frames = 1 if panel.gi == "none" else self.settings.frames
        result = studio.render(
            primitives, panel.gi, frames, (panel.view,), None, probes, contact=panel.contact, **options
        )
        return result, len(primitives)

    def _studio(self, panel: Panel) -> Studio:
        from fit import gltf

        subject = panel.subject
        key = (subject.scene, subject.camera, subject.lighting)
        if key not in self._studios:
            scene = gltf.load(subject.scene)
            self._studios[key] = Studio.set_up(
                scene, subject.camera, subject.lighting, self.settings.size, 0.0
            )
        return replace(self._studios[key], exposure=subject.exposure + panel.stops)

    def _primitives(self, subject: Subject, studio: Studio) -> PrimitiveSet:
        from fit import export

        key = (subject.scene, subject.primitives, subject.budget)
        if key not in self._sets:
            if subject.primitives is not None:
                self._sets[key] = export.read(subject.primitives)
            else:
                wanted = ConvertSettings((subject.scene,), self.settings.output, subject.budget)
                self._sets[key] = fit_scene(studio.scene, wanted).primitives
        return self._sets[key]


def show(report: dict[str, Any], settings: FiguresSettings, terminal: Terminal) -> None:
    """Prints a line for each figure, and where the page lies."""
    for figure in report["figures"]:
        told = figure["missing"] or f"{len(figure['panels'])} pictures"
        terminal.line(f"figure {figure['number']:>2}  {figure['title']}: {told}")
    terminal.line(f"page     {settings.page}")
