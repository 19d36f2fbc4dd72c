"""`sdfprim bench gi`: milliseconds and errors of light over budgets, probes, rays and methods.

Every set is lit by every method with every number of probes and rays, and held against path tracing; the
Pareto-best settings become the presets that `render --quality` takes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipelines.bench_gi_results import Results, shown_pictures
from pipelines.bench_gi_summary import choose, preset_of, settings_of
from pipelines.console import Terminal, Update
from pipelines.convert import RESULT_SUFFIXES, check_air, input_names, make_folder, require_file
from pipelines.documents import report_header, to_json_value, write_json, write_text
from pipelines.errors import UsageError
from pipelines.gi_presets import write_presets
from pipelines.matrix_sets import NamedSet, Wish, file_stem, obtain, wishes
from pipelines.staging import Stage, stage
from pipelines.studio import AS_IN_THE_FILE, LightingOptions, Studio
from pipelines.worker import describe_error

if TYPE_CHECKING:
    from pipelines.gi_errors import TruthSettings
    from runtime.device import Gpu

BUDGETS = (8, 32, 128, 512)
METHODS_TRIED = ("sdfddgi", "ddgi", "ddgi-triangles")
PROBES = (2048, 9856)
RAYS = (64, 192)

FRAMES = 128
"""Frames until the slowest method's light has settled."""

TIMED_SIZE = (1920, 1080)
"""Pixels at which a graphics card is timed; software is timed at the size of the pictures."""

FIT_SHARE, TRUTH_SHARE = 0.3, 0.3
"""Shares of a scene's progress bar: its fits, and its path-traced mesh."""


@dataclass(frozen=True)
class GiBenchSettings:
    """What `bench gi` was asked for.

    sets: of the one scene, and set_folders: with one of each scene, as `convert` names them; beside fits by
    `presets` and with `budgets`. probes: numbers of them, at most;
    rays: of a probe in a frame. cameras: names or numbers, as for `render`; without any, each file's first.
    views: a file of cameras, light and exposure for each scene, in their place: see `named_views`. size,
    timed_size: pixels, of the pictures that are judged and of those that are timed. cullings: ways to find
    the nearest primitive; the first is judged, and all are timed.
    """

    files: tuple[Path, ...]
    output: Path
    truth: TruthSettings
    sets: tuple[Path, ...] = ()
    set_folders: tuple[Path, ...] = ()
    presets: tuple[str, ...] = ()
    budgets: tuple[int, ...] = BUDGETS
    methods: tuple[str, ...] = METHODS_TRIED
    probes: tuple[int, ...] = PROBES
    rays: tuple[int, ...] = RAYS
    cameras: tuple[str, ...] = ()
    views: Path | None = None
    lighting: LightingOptions = AS_IN_THE_FILE
    exposure: float = 0.0
    scale: float = 1.0
    size: tuple[int, int] = (320, 180)
    timed_size: tuple[int, int] | None = None
    frames: int = FRAMES
    timed_frames: int = 32
    air: tuple[str, ...] = ()
    seed: int = 0
    cullings: tuple[str, ...] = ("grid",)

    @property
    def page(self) -> Path:
        """The report for people."""
        return self.output / "report.html"

    def timed_size_on(self, gpu: Gpu) -> tuple[int, int]:
        """Pixels of the timed pictures."""
        return self.timed_size or (self.size if gpu.is_software else TIMED_SIZE)

    def wishes(self, scene: Path) -> list[Wish]:
        """The sets of a scene."""
        found = [Wish(folder.name, file=self.set_in(folder, scene)) for folder in self.set_folders]
        return found + wishes(self.sets, self.presets, self.budgets)

    def set_in(self, folder: Path, scene: Path) -> Path:
        """A scene's set in a folder that `convert` wrote.

        Raises:
            UsageError: there is none.
        """
        file = folder / f"{scene.stem}{RESULT_SUFFIXES[-1]}"
        if not file.is_file():
            raise UsageError(
                f"--sets {folder}: {file} is not there; make it: sdfprim convert {scene} -o {folder}"
            )
        return file

    def stage(self, scene: Path) -> Stage:
        """Cameras and light of a scene.

        Raises:
            UsageError: the file of views has none of the scene, or several under different light.
        """
        return stage(scene, self.views, Stage.of_options(self.cameras, self.lighting, self.exposure))


def run(settings: GiBenchSettings, update: Update) -> dict[str, Any]:
    """Measures every scene; the report is written after every method, so that an interrupt costs one.

    Raises:
        UsageError: a file or camera is not there, or the options make no sense.
        MissingMitsuba: it is asked for and not installed.
        NoAdapter: there is no GPU.
    """
    check(settings)
    names = input_names(settings.files)
    bench = _Bench(settings, report_header("bench gi", settings, settings.seed) | {"scenes": []})
    share = 1 / len(names)
    for number, (file, name) in enumerate(zip(settings.files, names, strict=True)):
        bench.run_scene(file, name, _within(update, number * share, share))
    return bench.report


def check(settings: GiBenchSettings) -> None:
    """Raises UsageError for what can be seen to be wrong before any work is done, and makes the folder."""
    from pipelines.methods import find_method

    if not settings.files:
        raise UsageError("no file given: name at least one .gltf or .glb")
    for file in (*settings.files, *settings.sets):
        require_file(file)
    if settings.sets and len(settings.files) > 1:
        raise UsageError("--set: a set is of one scene; name one scene, or let --budgets fit them all")
    for method in settings.methods:
        find_method(method)
    if "none" in settings.methods:
        raise UsageError("--gi none: light without GI is always in the report; leave it out")
    settings.lighting.check()
    if settings.views and (settings.cameras or settings.lighting != AS_IN_THE_FILE or settings.exposure):
        raise UsageError(
            f"--views {settings.views}: it gives cameras, light and exposure; leave those options out"
        )
    for file in settings.files:
        settings.stage(file)
        names = [wish.name for wish in settings.wishes(file)]
        if not names:
            raise UsageError("--budgets: give at least one budget, a preset or a set")
        for name in names:
            if names.count(name) > 1:
                raise UsageError(f"--sets: several sets are called {name!r}; name the folders differently")
    check_air(settings.air)
    if min(settings.probes) < 8:
        raise UsageError(f"--probes {min(settings.probes)}: one cell of a grid already has 8 probes")
    for rays in settings.rays:
        if rays % 64:
            raise UsageError(f"--rays {rays}: give multiples of 64, so that workgroups share them evenly")
    for option, value in (("--frames", settings.frames), ("--timed-frames", settings.timed_frames)):
        if value < 1:
            raise UsageError(f"{option} {value}: give at least 1")
    if not 0 < settings.scale < float("inf"):
        raise UsageError(f"--scale {settings.scale}: give a number above zero")
    if settings.truth.samples < 2:
        raise UsageError(f"--samples {settings.truth.samples}: give at least 2, so that noise can be told")
    if settings.truth.engine == "reference":
        from pipelines.reference.mitsuba import load_mitsuba

        load_mitsuba()
    make_folder(settings.output)


@dataclass
class _Bench:
    """The report as it grows, and the pictures of what it advises."""

    settings: GiBenchSettings
    report: dict[str, Any]
    pictures: dict[str, Any] = field(default_factory=dict)
    written: tuple[Path, ...] = ()

    def run_scene(self, file: Path, name: str, update: Update) -> None:
        """Everything on one scene; what is wrong with the scene is its failure and not the bench's."""
        scene: dict[str, Any] = {"name": name, "source": file.as_posix(), "status": "failed", "failure": None}
        scene |= {"views": [], "sets": [], "runs": [], "notes": []}
        self.report["scenes"].append(scene)
        try:
            self._measure(scene, file, update)
            scene["status"] = "ok"
        except UsageError:
            raise
        except (ValueError, OSError) as error:
            scene["failure"] = describe_error(error)
        self.write()

    def _measure(self, scene: dict[str, Any], file: Path, update: Update) -> None:
        from fit import gltf
        from pipelines.bench_gi_scene import SceneBench, variants

        settings = self.settings
        update("load", 0.0)
        loaded = gltf.load(file, scale=settings.scale)
        stage = settings.stage(file)
        first = stage.shots[0]
        studio = Studio.set_up(loaded, first.camera, stage.lighting, settings.size, first.exposure)
        self.report |= {
            "adapter": studio.gpu.adapter_summary,
            "software_adapter": studio.gpu.is_software,
            "timed_size": settings.timed_size_on(studio.gpu),
        }
        sets = self._obtain(scene["name"], loaded, update)
        for _, named in sets:
            if named.air is not None:
                studio = studio.moved_inside(named.air)
        bench = SceneBench(settings, stage, studio, _within(update, FIT_SHARE, TRUTH_SHARE))
        scene["views"] = [shot.describe() for shot in bench.shots]
        scene["notes"] = bench.notes()
        jobs = [
            (*each, tuple(variants(settings, largest=number == len(sets))))
            for number, each in enumerate(sets, 1)
        ]
        steps = _Steps(_within(update, FIT_SHARE + TRUTH_SHARE), sum(len(job[2]) + 1 for job in jobs))
        results = Results(scene, bench, self.pictures)
        for wish, named, found in jobs:
            budget = wish.limit or len(named.primitives)
            results.add_set(named, steps.next(f"{named.name}: "))
            for number, variant in enumerate(found, 1):
                results.add_run(named, budget, variant, steps.next(f"{named.name}, {variant.name}: "))
                if number == len(found) or found[number].method != variant.method:
                    self.write()

    def _obtain(self, name: str, scene: Any, update: Update) -> list[tuple[Wish, NamedSet]]:
        """The sets by rising number of primitives."""
        settings, asked = self.settings, self.settings.wishes(scene.source)
        share = FIT_SHARE / len(asked)
        folder = settings.output / name if len(settings.files) > 1 else settings.output
        make_folder(folder)
        found = [
            (
                wish,
                obtain(wish, scene, folder, settings.air, settings.seed, _within(update, k * share, share)),
            )
            for k, wish in enumerate(asked)
        ]
        return sorted(found, key=lambda pair: len(pair[1].primitives))

    def write(self) -> None:
        """`report.json`, `.md`, `.html`, `presets.json` and the pictures, of what is done so far."""
        from pipelines.report.gi_markdown import build_markdown
        from pipelines.report.gi_page import build_page
        from runtime.images import write_png

        done = [scene for scene in self.report["scenes"] if scene["runs"]]
        self.report["tried"] = tried = settings_of(done)
        chosen = choose(tried)
        self.report["presets"] = {name: dict(row) for name, row in chosen.items()}
        folder = self.settings.output
        write_json(folder / "report.json", self.report)
        source = {key: self.report.get(key) for key in ("version", "created", "adapter", "timed_size")}
        source["scenes"] = [scene["name"] for scene in done]
        write_presets(folder / "presets.json", {name: preset_of(row) for name, row in chosen.items()}, source)
        shown = shown_pictures(done, chosen, self.pictures)
        files = {folder / f"{file_stem(name)}.png": pixels for name, pixels in shown.items()}
        for file in self.written:
            if file not in files:
                file.unlink(missing_ok=True)
        for file, pixels in files.items():
            write_png(file, pixels)
        self.written = tuple(files)
        values = to_json_value(self.report)
        write_text(folder / "report.md", build_markdown(values))
        write_text(self.settings.page, build_page(values, shown))


class _Steps:
    """Even parts of a progress bar, one after the other."""

    def __init__(self, update: Update, count: int) -> None:
        self._update, self._count, self._done = update, count, 0

    def next(self, label: str) -> Update:
        """The next part; its texts begin with the label."""
        part = _within(self._update, self._done / self._count, 1 / self._count)
        self._done += 1
        return lambda text, share: part(f"{label}{text}", share)


def _within(progress: Update, start: float, share: float | None = None) -> Update:
    """A part of the progress bar; the rest of it without a share."""
    width = 1 - start if share is None else share
    return lambda text, fraction: progress(text, start + width * fraction)


def failed(report: Mapping[str, Any]) -> bool:
    """Whether a scene failed."""
    return any(scene["failure"] for scene in report["scenes"])


def show(report: Mapping[str, Any], settings: GiBenchSettings, terminal: Terminal) -> None:
    """Prints every run, the presets, and where the report lies."""
    from pipelines.report.gi_advice import advice_lines

    headers = ["set", "method", "probes", "rays", "GI ms", "frame ms", "fit", "solver", "total", "FLIP"]
    keys = ("set", "method", "max_probes", "rays_per_probe", "gi_ms", "frame_ms", "fit", "solver", "total")
    for scene in report["scenes"]:
        rows = [[run[key] for key in (*keys, "flip")] for run in scene["runs"]]
        terminal.table(headers, rows, f"{scene['name']}: mean square over mean squared truth")
        if scene["failure"]:
            terminal.line(f"failed   {scene['name']}: {scene['failure']}")
        for note in scene["notes"]:
            terminal.line(f"note     {note}")
    for line in advice_lines(report):
        terminal.line(line)
    if "adapter" in report:
        kind = " (software: times say nothing about a graphics card)" if report["software_adapter"] else ""
        terminal.line(f"adapter  {report['adapter']}{kind}")
    terminal.line(f"report   {settings.page}")
