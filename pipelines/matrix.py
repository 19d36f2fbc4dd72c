"""`sdfprim compare` with sets, methods or probes of one's own choice: every set by every way to light it.

Each set has its fit error, each cell its solver and total error and its time; for each way to light, the
knee is the smallest set from which on more primitives hardly help.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipelines.console import Terminal, Update
from pipelines.convert import check_air, make_folder, require_file
from pipelines.documents import report_header, to_json_value, write_json, write_text
from pipelines.errors import UsageError
from pipelines.matrix_sets import NamedSet, Wish, file_stem, obtain, wishes
from pipelines.methods import technique_settings
from pipelines.options import ProbesOption
from pipelines.studio import AS_IN_THE_FILE, DEFAULT_FRAMES, LightingOptions, Studio

if TYPE_CHECKING:
    from pipelines.gi_errors import Error, GiErrors, Judge, SetTruth, TruthSettings
    from runtime.estimate import Estimate
    from runtime.renderer import Result

KNEE = 1.1
"""A set is good enough where its total error is at most so many times the least of its column."""

CERTAIN = 0.5
"""Share of relMSE that its standard error may be before a note asks for more samples."""

FIT_SHARE, TRUTH_SHARE = 0.4, 0.2
"""Shares of the progress bar; the pictures and the sets' own truths take the rest."""


@dataclass(frozen=True)
class MatrixSettings:
    """What was asked for. Without files, presets and budgets both presets are taken; `truth` is what path
    traces the mesh and the sets; `floor` asks for the error of probes that it fills as well."""

    scene: Path
    output: Path
    truth: TruthSettings
    sets: tuple[Path, ...] = ()
    presets: tuple[str, ...] = ()
    budgets: tuple[int, ...] = ()
    methods: tuple[str, ...] = ("sdfddgi",)
    probes: tuple[ProbesOption | None, ...] = (None,)
    camera: str | None = None
    lighting: LightingOptions = AS_IN_THE_FILE
    exposure: float = 0.0
    scale: float = 1.0
    size: tuple[int, int] = (320, 180)
    frames: int = DEFAULT_FRAMES
    air: tuple[str, ...] = ()
    seed: int = 0
    floor: bool = False

    @property
    def page(self) -> Path:
        """The report for people."""
        return self.output / "report.html"

    def wishes(self) -> list[Wish]:
        """The sets, in rows."""
        some = self.sets or self.presets or self.budgets
        return wishes(self.sets, self.presets if some else ("coarse", "fine"), self.budgets)

    def columns(self) -> list[Column]:
        """The ways to light; light without probes stands once."""
        found = [
            Column(method, None if method == "none" else probes)
            for method in self.methods
            for probes in self.probes
        ]
        return list(dict.fromkeys(found))


@dataclass(frozen=True)
class Column:
    """One way to light a set."""

    method: str
    probes: ProbesOption | None

    @property
    def name(self) -> str:
        """In words."""
        return self.method if self.probes is None else f"{self.method}, {self.probes.text}"


def run(settings: MatrixSettings, progress: Update) -> dict[str, Any]:
    """Fills the matrix; writes sets, pictures, `report.json` and `report.html`, and returns the report.

    Raises:
        UsageError: a file or camera is not there, or a name is not known.
        MissingMitsuba: it is asked for and not installed.
        NoAdapter: there is no GPU.
        ValueError: the scene or a set cannot be read, or the camera sees nothing.
    """
    from fit import gltf
    from pipelines.gi_errors import Judge
    from pipelines.report.matrix_page import build_page

    check(settings)
    progress("load", 0.0)
    scene = gltf.load(settings.scene, scale=settings.scale)
    studio = Studio.set_up(scene, settings.camera, settings.lighting, settings.size, settings.exposure)
    sets = _obtain_all(settings, scene, progress)
    for named in sets:
        if named.air is not None:
            studio = studio.moved_inside(named.air)
    judge = Judge.of(studio, settings.truth, _within(progress, FIT_SHARE, TRUTH_SHARE))
    bench = _Bench(settings, studio, judge, _within(progress, FIT_SHARE + TRUTH_SHARE))
    rows = [bench.row(number, named) for number, named in enumerate(sets)]
    report = (
        report_header("compare", settings, settings.seed)
        | studio.describe()
        | {"frames": settings.frames, "truth": asdict(settings.truth), "notes": bench.notes}
        | {"columns": [column.name for column in settings.columns()], "sets": rows}
        | {
            "knee": {column.name: knee(rows, column.name) for column in settings.columns()},
            "knee_factor": KNEE,
        }
    )
    bench.write_picture("mesh", judge.pixels.display(judge.mesh.value))
    write_json(settings.output / "report.json", report)
    write_text(settings.page, build_page(to_json_value(report), bench.pictures))
    return report


def check(settings: MatrixSettings) -> None:
    """Raises UsageError for what can be seen to be wrong before any work is done, and makes the folder."""
    from pipelines.methods import find_method

    require_file(settings.scene)
    for file in settings.sets:
        require_file(file)
    for method in settings.methods:
        find_method(method)
    settings.lighting.check()
    check_air(settings.air)
    if settings.frames < 1:
        raise UsageError(f"--frames {settings.frames}: give at least 1")
    if not 0 < settings.scale < float("inf"):
        raise UsageError(f"--scale {settings.scale}: give a number above zero")
    if settings.truth.samples < 2:
        raise UsageError(
            f"--samples {settings.truth.samples}: give at least 2, so that the noise can be told"
        )
    if settings.truth.engine == "reference":
        from pipelines.reference.mitsuba import load_mitsuba

        load_mitsuba()
    make_folder(settings.output)


def knee(rows: list[dict[str, Any]], column: str) -> str | None:
    """The smallest set whose total error is at most `KNEE` times the column's least; None where no cell has
    one. The error is the ratio of means, which the truth's noise moves least."""
    totals = {
        row["name"]: (
            row["primitives"],
            max(row["cells"][column]["errors"]["total"]["irradiance"]["ratio"], 0),
        )
        for row in rows
    }
    finite = {name: pair for name, pair in totals.items() if np.isfinite(pair[1])}
    if not finite:
        return None
    least = min(error for _, error in finite.values())
    good = [name for name, (_, error) in finite.items() if error <= KNEE * least]
    return min(good, key=lambda name: finite[name][0])


def _obtain_all(settings: MatrixSettings, scene: Any, progress: Update) -> list[NamedSet]:
    asked = settings.wishes()
    share = FIT_SHARE / len(asked)
    return [
        obtain(
            wish,
            scene,
            settings.output,
            settings.air,
            settings.seed,
            _within(progress, number * share, share),
        )
        for number, wish in enumerate(asked)
    ]


class _Bench:
    """Lights sets and judges them; collects pictures and notes."""

    def __init__(self, settings: MatrixSettings, studio: Studio, judge: Judge, progress: Update) -> None:
        self._settings, self._studio, self._judge, self._progress = settings, studio, judge, progress
        self._columns = settings.columns()
        self._steps = len(settings.wishes()) * (len(self._columns) + 1)
        self.pictures: dict[str, Any] = {}
        self.notes: list[str] = list(judge.truth.notes())

    def row(self, number: int, named: NamedSet) -> dict[str, Any]:
        """A set's keys: what it is, its fit error, and a cell for each column."""
        done = number * (len(self._columns) + 1)
        truth = self._judge.truth_of(named.primitives, self._step(done))
        self.write_picture(f"{named.name}, set", self._judge.pixels.display(truth.lit.value))
        self._note_noise(f"{named.name}: fit", truth.fit)
        cells = {}
        for k, column in enumerate(self._columns):
            result = self._light(named, column, self._step(done + 1 + k))
            floor = self._floor(truth, column, self._step(done + 1 + k))
            errors = self._judge.errors(truth, result.images["irradiance"], floor)
            cells[column.name] = _cell(result, errors)
            self._note_noise(f"{named.name}, {column.name}: total", errors.total)
            self._write_cell(f"{named.name}, {column.name}", truth, result)
        shared = {key: asdict(getattr(truth, key)) for key in ("fit", "geometry", "material")}
        about = {"name": named.name, "noise": errors.noise, "unplaced": errors.unplaced}
        return about | named.about | {"errors": shared, "points": errors.points, "cells": cells}

    def _light(self, named: NamedSet, column: Column, update: Update) -> Result:
        words = f"light {named.name}: {column.name}"
        result = self._studio.render(
            named.primitives,
            column.method,
            self._settings.frames,
            ("irradiance",),
            lambda frame, frames: update(words, frame / frames),
            column.probes,
        )
        self.notes = list(dict.fromkeys((*self.notes, *result.notes)))
        return result

    def _note_noise(self, name: str, error: Error) -> None:
        figures = error.irradiance
        if figures.standard_error > CERTAIN * abs(figures.rel_mse):
            self.notes.append(
                f"{name} relMSE {figures.rel_mse:.3g} is uncertain by {figures.standard_error:.2g}, because "
                "the truth is noisy or black there: take more --samples, or compare the ratios of means"
            )

    def _floor(self, truth: SetTruth, column: Column, update: Update) -> Estimate | None:
        """Of the column's grid of probes; None where there are none, or where it is not asked for."""
        if not self._settings.floor or column.method == "none":
            return None
        software = self._studio.gpu.is_software
        probes = technique_settings("sdfddgi", truth.primitives, column.probes, software=software)
        return self._judge.floor_of(truth, probes, update)

    def _write_cell(self, name: str, truth: SetTruth, result: Result) -> None:
        pictures = self._judge.pictures(truth, result.images["irradiance"])
        self.write_picture(name, pictures["ours"])
        self.write_picture(f"{name}, total flip", pictures["total-flip"])

    def write_picture(self, name: str, pixels: Any) -> None:
        """Writes a PNG beside the report and keeps it for the page."""
        from runtime.images import write_png

        self.pictures[name] = pixels
        write_png(self._settings.output / f"{file_stem(name)}.png", pixels)

    def _step(self, number: int) -> Update:
        return _within(self._progress, number / self._steps, 1 / self._steps)


def _cell(result: Result, errors: GiErrors) -> dict[str, Any]:
    timed = [milliseconds for milliseconds in result.timings.values() if milliseconds is not None]
    keys = ("solver", "total") if errors.floor is None else ("solver", "total", "floor")
    shown: Mapping[str, Any] = {key: asdict(getattr(errors, key)) for key in keys}
    return {
        "errors": shown,
        "frame_ms": sum(timed) if timed else None,
        "passes_ms": dict(result.timings),
        "timed_frames": result.frames,
    }


def _within(progress: Update, start: float, share: float | None = None) -> Update:
    """A part of the progress bar; the rest of it without a share."""
    width = 1 - start if share is None else share
    return lambda text, fraction: progress(text, start + width * fraction)


def show(report: dict[str, Any], settings: MatrixSettings, terminal: Terminal) -> None:
    """Prints the matrix, the knees, and where the report lies."""
    headers = ["set", "primitives", "fit", "geometry"]
    headers += [f"{column}: {what}" for column in report["columns"] for what in ("solver", "total", "ms")]
    rows: list[list[Any]] = []
    for row in report["sets"]:
        cells = [row["cells"][column] for column in report["columns"]]
        figures = [
            value
            for cell in cells
            for value in (*(_ratio(cell["errors"][key]) for key in ("solver", "total")), cell["frame_ms"])
        ]
        fit = [_ratio(row["errors"][key]) for key in ("fit", "geometry")]
        rows.append([row["name"], row["primitives"], *fit, *figures])
    terminal.table(headers, rows, "indirect irradiance: mean square over mean squared truth")
    for column, name in report["knee"].items():
        terminal.line(f"knee     {column}: {name}, within {KNEE:g} times the least total error")
    for row in report["sets"]:
        noise = ", ".join(f"{name} {share:.2%}" for name, share in row["noise"].items())
        terminal.line(f"noise    {row['name']}: {noise}")
    for note in report["notes"]:
        terminal.line(f"note     {note}")
    kind = " (software: times say nothing about a graphics card)" if report["software_adapter"] else ""
    terminal.line(f"adapter  {report['adapter']}{kind}")
    terminal.line(f"report   {settings.page}")


def _ratio(error: Mapping[str, Any]) -> float:
    return float(error["irradiance"]["ratio"])
