"""`sdfprim convert`: glTF files to primitive sets, one report for all of them."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from pipelines.console import Terminal
from pipelines.documents import report_header, write_json
from pipelines.errors import UsageError
from pipelines.naming import result_names
from pipelines.quantities import quantity
from pipelines.worker import Progress, run_isolated

Preset = Literal["coarse", "fine"]

RESULT_SUFFIXES = (".prims.glb", ".prims.npz")

SHOWN_METRICS = {
    "mean error": ("surface_to_set_mean_m", "m"),
    "covered": ("covered_half_pct", "%"),
    "false solid": ("false_solid", "%"),
    "leaks": ("leaks", "%"),
    "blocked": ("blocked", "%"),
    "hole": ("largest_hole_m", "m"),
}
"""The metrics that the printed table shows, by their headers, with units; the report has all of them."""

EMPTY_ROW: dict[str, Any] = {
    "name": None,
    "status": "failed",
    "error": None,
    "primitives": None,
    "kinds": None,
    "bytes": None,
    "seconds": None,
    "peak_rss_mb": None,
    "metrics": None,
    "volumes": None,
    "per_primitive": [],
    "air": [],
    "repairs": {},
    "ignored": [],
    "skipped_parts": [],
    "notes": [],
    "stages": {},
}
"""Every row of the report has these keys; a failed one keeps the values that it has here."""


@dataclass(frozen=True)
class ConvertSettings:
    """What `convert` was asked for: `air` is `outside` or `x,y,z`, metres; `timeout` is seconds a file;
    `instancing` fits what is drawn more than once by itself, once."""

    files: tuple[Path, ...]
    output: Path
    max_primitives: int | None = None
    max_bytes: int | None = None
    max_error: float | None = None
    preset: Preset | None = None
    air: tuple[str, ...] = ()
    scale: float = 1.0
    seed: int = 0
    timeout: float = 900.0
    max_leaks: float = 1.0
    instancing: bool = False


@dataclass(frozen=True)
class FileProgress:
    """What is at work now: which file of how many, and the stage of it."""

    index: int
    count: int
    name: str
    stage: str
    fraction: float

    @property
    def share(self) -> float:
        """How much of all the work is done, 0 to 1."""
        return (self.index + min(self.fraction, 1.0)) / self.count

    def describe(self) -> str:
        """The file and stage in words."""
        return f"[{self.index + 1}/{self.count}] {self.name}: {self.stage}"


def run(
    settings: ConvertSettings,
    progress: Callable[[FileProgress], None] | None = None,
    finished: Callable[[dict[str, Any]], None] | None = None,
) -> dict[str, Any]:
    """Converts every file and returns the report, which also lies in `output/report.json` after each file.

    Nothing that a file does stops the others: each is converted in a process of its own.

    Raises:
        UsageError: a file is missing, or the options make no sense.
    """
    check(settings)
    names = input_names(settings.files)
    _keep_inputs(settings, names)
    make_folder(settings.output)
    assets: list[dict[str, Any]] = []
    report = report_header("convert", settings, settings.seed) | {"assets": assets}
    for index, (file, name) in enumerate(zip(settings.files, names, strict=True)):

        def at_stage(stage: str, fraction: float, index: int = index, name: str = name) -> None:
            if progress:
                progress(FileProgress(index, len(names), name, stage, fraction))

        assets.append(convert_isolated(file, name, settings, at_stage))
        write_json(settings.output / "report.json", report)
        if finished:
            finished(assets[-1])
    return report


def check(settings: ConvertSettings) -> None:
    """Raises UsageError for what can be seen to be wrong before any file is opened."""
    if not settings.files:
        raise UsageError("no file given: name at least one .gltf or .glb")
    for file in settings.files:
        require_file(file)
    check_air(settings.air)
    from fit.primitives import GPU_RECORD_BYTES

    if settings.max_bytes is not None and settings.max_bytes < GPU_RECORD_BYTES:
        raise UsageError(f"--max-bytes {settings.max_bytes}: one primitive takes {GPU_RECORD_BYTES}")
    for option, value in (
        ("--max-primitives", settings.max_primitives),
        ("--max-error", settings.max_error),
        ("--max-leaks", settings.max_leaks),
        ("--scale", settings.scale),
        ("--timeout", settings.timeout),
    ):
        if value is not None and not 0 < value < float("inf"):
            raise UsageError(f"{option} {value}: give a number above zero")


def check_air(seeds: Sequence[str]) -> None:
    """Raises UsageError unless each text names a space that is air."""
    from fit.air import parse_seed

    for text in seeds:
        try:
            parse_seed(text)
        except ValueError as error:
            raise UsageError(f"--air {text}: {error}") from error


def require_file(file: Path) -> None:
    """Raises UsageError unless `file` is a file."""
    if file.is_dir():
        raise UsageError(f"{file} is a folder: name the .gltf or .glb in it")
    if not file.is_file():
        raise UsageError(f"{file}: no such file; check the path (relative ones start at {Path.cwd()})")


def convert_isolated(file: Path, name: str, settings: ConvertSettings, progress: Progress) -> dict[str, Any]:
    """One row of the report, from a process of its own; failures of every sort are rows too."""
    outcome = run_isolated(convert_file, file, name, settings, timeout=settings.timeout, progress=progress)
    row = {"source": file.as_posix()} | EMPTY_ROW | {"name": name}
    if outcome.error is None:
        row |= outcome.result | {"status": "ok"}
    else:
        row["error"] = outcome.error
    return row | {"seconds": round(outcome.seconds, 3), "peak_rss_mb": outcome.peak_rss_mb}


def convert_file(file: Path, name: str, settings: ConvertSettings, progress: Progress) -> dict[str, Any]:
    """Loads, fits and writes `output/<name>.prims.glb` and `.npz`; what it learnt, as a row's keys."""
    from fit import export, gltf

    progress("load", 0.0)
    scene = gltf.load(file, scale=settings.scale)
    result = fit_scene(scene, settings, progress)
    progress("write", 0.0)
    for suffix in RESULT_SUFFIXES:
        export.write(result.primitives, settings.output / f"{name}{suffix}")
    return describe_fit(result) | {"repairs": scene.repairs, "ignored": list(scene.ignored)}


def fit_scene(scene: Any, settings: ConvertSettings, progress: Progress | None = None) -> Any:
    """`fit.solve.fit` with the settings of the command."""
    from fit import solve

    return solve.fit(
        scene,
        solve.FitSettings(
            max_primitives=settings.max_primitives,
            max_bytes=settings.max_bytes,
            max_error=settings.max_error,
            max_leaks=settings.max_leaks,
            preset=settings.preset,
            air=settings.air,
            seed=settings.seed,
            instancing=settings.instancing,
        ),
        progress=progress,
    )


def describe_fit(result: Any) -> dict[str, Any]:
    """A row's keys that follow from a `fit.solve.Fit`."""
    return describe_primitives(result.primitives) | {
        "metrics": asdict(result.metrics),
        "volumes": asdict(result.volumes),
        "per_primitive": [asdict(error) for error in result.errors],
        "air": [asdict(space) for space in result.air.spaces],
        "skipped_parts": list(result.skipped_parts),
        "notes": list(result.notes),
        "stages": {stage: round(seconds, 3) for stage, seconds in result.seconds.items()},
    }


def describe_primitives(primitives: Any) -> dict[str, Any]:
    """Count, count of each kind, and bytes on the GPU."""
    from fit.primitives import GPU_RECORD_BYTES, Kind

    counts = Counter(int(kind) for kind in primitives.kinds)
    return {
        "primitives": len(primitives),
        "kinds": {kind.name.lower(): counts[kind.value] for kind in Kind},
        "bytes": len(primitives) * GPU_RECORD_BYTES,
    }


def input_names(files: tuple[Path, ...]) -> list[str]:
    """A name for each file, no two equal; raises UsageError where a file is given twice."""
    try:
        return result_names(files)
    except ValueError as error:
        raise UsageError(f"{error}: name each file once") from error


def _keep_inputs(settings: ConvertSettings, names: list[str]) -> None:
    results = {
        (settings.output / f"{name}{suffix}").resolve() for name in names for suffix in RESULT_SUFFIXES
    }
    for file in settings.files:
        if file.resolve() in results:
            raise UsageError(f"-o {settings.output}: {file} would be overwritten; name another folder")


def make_folder(folder: Path) -> None:
    """Makes the results' folder; raises UsageError where that can't be done."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"-o {folder}: {error.strerror}; name a folder that can be written") from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UsageError(f"-o {folder}: nothing may be written there; name a folder that can be written")


MOST_NOTES = 3
"""Notes of a file that the terminal shows; the report has all."""


def show(report: dict[str, Any], settings: ConvertSettings, terminal: Terminal) -> None:
    """Prints a row for each file, then what failed and why, and what is worth knowing."""
    rows = [
        [
            row["name"],
            row["status"],
            row["primitives"],
            row["bytes"],
            *(quantity((row["metrics"] or {}).get(key), unit) for key, unit in SHOWN_METRICS.values()),
            row["seconds"],
            row["peak_rss_mb"],
        ]
        for row in report["assets"]
    ]
    terminal.table(["name", "status", "set", "bytes", *SHOWN_METRICS, "seconds", "MiB"], rows)
    for row in report["assets"]:
        if row["error"]:
            source = f"{row['source']}: "
            terminal.line(f"failed   {source}{row['error'].removeprefix(source)}")
    for row in report["assets"]:
        for note in row["notes"][:MOST_NOTES]:
            terminal.line(f"note     {row['name']}: {note}")
        if len(row["notes"]) > MOST_NOTES:
            terminal.line(f"note     {row['name']}: {len(row['notes']) - MOST_NOTES} more in the report")
    terminal.line(f"report   {settings.output / 'report.json'}")
