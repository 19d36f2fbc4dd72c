"""`sdfprim bench tracing`: what it takes to find the nearest primitive, and to follow a ray.

Distances to primitives are counted by the GPU itself, so that any adapter gives the same figures; times are
those of the adapter at hand.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipelines.bench_tracing_scenes import SCENES, rays_in_air
from pipelines.console import Terminal, Update
from pipelines.convert import make_folder, require_file
from pipelines.documents import report_header, to_json_value, write_json, write_text
from pipelines.errors import UsageError

if TYPE_CHECKING:
    from fit.primitives import PrimitiveSet
    from runtime.device import Gpu
    from runtime.tracer import Hits
    from runtime.world import World

COUNTS = (43, 200, 1000)
RAYS = 4096

LOOPS_ON_SOFTWARE = 30_000
"""Distances of one ray that Mesa's llvmpipe surely computes: it leaves all loops after 65,535 rounds."""

STEPS_AT_MOST = 30
"""Of a typical ray; longer ones are too few to tell in a mean."""

SAME_PLACE = 3.0
"""Hit distances within which two hits are the same. They may name either of two walls where these meet."""


@dataclass(frozen=True)
class TracingBenchSettings:
    """What `bench tracing` was asked for.

    sets: files of primitives, measured beside the generated scenes with `counts` primitives each. rays: in
    each. repeats: how often a pass is timed.
    """

    output: Path
    sets: tuple[Path, ...] = ()
    counts: tuple[int, ...] = COUNTS
    rays: int = RAYS
    repeats: int = 8
    seed: int = 0


def run(settings: TracingBenchSettings, update: Update) -> dict[str, Any]:
    """Measures every set and writes `report.json` and `report.md`.

    Raises:
        UsageError: a file is not there, or the options make no sense.
        NoAdapter: there is no GPU.
    """
    from pipelines.report.tracing_markdown import build_markdown
    from runtime.device import open_device

    check(settings)
    gpu = open_device()
    report = report_header("bench tracing", settings, settings.seed)
    report |= {"adapter": gpu.adapter_summary, "software_adapter": gpu.is_software, "sets": []}
    jobs = list(_sets(settings))
    for number, (name, primitives) in enumerate(jobs):
        update(name, number / len(jobs))
        report["sets"].append(measure(gpu, name, primitives, settings))
        write_json(settings.output / "report.json", report)
        write_text(settings.output / "report.md", build_markdown(to_json_value(report)))
    return report


def check(settings: TracingBenchSettings) -> None:
    """Raises UsageError for what can be seen to be wrong before any work is done, and makes the folder."""
    for file in settings.sets:
        require_file(file)
    if not settings.counts and not settings.sets:
        raise UsageError("--primitives: give at least one number, or a --set")
    if settings.counts and min(settings.counts) < 7:
        raise UsageError(f"--primitives {min(settings.counts)}: a hall has six walls; give at least 7")
    for option, value in (("--rays", settings.rays), ("--repeats", settings.repeats)):
        if value < 1:
            raise UsageError(f"{option} {value}: give at least 1")
    make_folder(settings.output)


def _sets(settings: TracingBenchSettings) -> Iterator[tuple[str, PrimitiveSet]]:
    from fit import export

    for file in settings.sets:
        yield file.name.partition(".")[0], export.read(file)
    for name, make in SCENES.items():
        for count in settings.counts:
            yield name, make(count, settings.seed)


def measure(gpu: Gpu, name: str, primitives: PrimitiveSet, settings: TracingBenchSettings) -> dict[str, Any]:
    """A set's row: its lists, what each culling asks, and what each kind of stride asks and finds."""
    from runtime.settings import CULLINGS, WorldSettings
    from runtime.tracer import STRIDES
    from runtime.world import World

    rays = rays_in_air(primitives, settings.rays, settings.seed)
    worlds = {
        culling: World(gpu, None, primitives, settings=WorldSettings(culling=culling, seed=settings.seed))
        for culling in CULLINGS
    }
    trial = _Trial(gpu, rays, settings.repeats)
    cullings = {
        culling: trial.row(world)
        for culling, world in worlds.items()
        if culling != "none" or not gpu.is_software or len(primitives) * STEPS_AT_MOST < LOOPS_ON_SOFTWARE
    }
    cullings["clusters, unbounded"] = trial.row(worlds["clusters"], bounded=False)
    plain, _ = trial.trace(worlds["grid"], "plain")
    strides = {name: trial.row(worlds["grid"], name, truth=plain) for name in STRIDES}
    grid = worlds["grid"]
    return {
        "name": name,
        "primitives": len(primitives),
        "lists": asdict(grid.list_statistics()) | {"bytes": grid.grid.memory},
        "build_ms": _build_ms(gpu, grid, settings.repeats),
        "clusters": worlds["clusters"].cluster_count,
        "cullings": cullings,
        "strides": strides,
    }


@dataclass(frozen=True)
class _Trial:
    """The same rays through one world after the other."""

    gpu: Gpu
    rays: tuple[Any, Any]
    repeats: int

    def trace(
        self, world: World, strides: str | None = None, *, bounded: bool = True
    ) -> tuple[Hits, float | None]:
        """Hits, and the median milliseconds of the pass."""
        from runtime.timing import Timer
        from runtime.tracer import Tracer

        tracer, timer = Tracer(self.gpu, world, strides, bounded=bounded), Timer(self.gpu)
        times = []
        for _ in range(1 if self.gpu.is_software else self.repeats):
            hits = tracer.trace(*self.rays, softness=0.0, timer=timer)
            times.append(timer.results()["world/trace_rays"])
        return hits, None if self.gpu.is_software else _median(times)

    def row(
        self, world: World, strides: str | None = None, truth: Hits | None = None, *, bounded: bool = True
    ) -> dict[str, Any]:
        """Means over the rays. truth: hits to be the same; a ray that took all steps of its march is in
        neither number."""
        from runtime.tracer import MOST_STEPS

        hits, milliseconds = self.trace(world, strides, bounded=bounded)
        row: dict[str, Any] = {
            "queries_per_ray": float(hits.steps.mean()),
            "distances_per_query": float(hits.asked.sum() / max(hits.steps.sum(), 1)),
            "distances_per_ray": float(hits.asked.mean()),
            "trace_ms": milliseconds,
        }
        if truth is not None:
            near = SAME_PLACE * world.settings.hit_distance_share * world.diagonal
            same = ((hits.primitive < 0) == (truth.primitive < 0)) & (np.abs(hits.t - truth.t) < near)
            row["other_hits"] = int(np.count_nonzero(~same & (truth.steps < MOST_STEPS)))
        return row


def _build_ms(gpu: Gpu, world: World, repeats: int) -> float | None:
    """Median milliseconds of building the lists anew, as after every primitive has moved."""
    from runtime.encoder import Recorder
    from runtime.timing import Timer

    if gpu.is_software:
        return None
    timer = Timer(gpu)
    times: list[float | None] = []
    for _ in range(repeats):
        world.update(world.primitives)
        rec = Recorder(gpu, timer, label="build")
        world.record(rec)
        rec.submit()
        times += timer.results().values()
    return _median(times)


def _median(times: list[float | None]) -> float | None:
    known = [time for time in times if time is not None]
    return float(np.median(known)) if known else None


def show(report: dict[str, Any], settings: TracingBenchSettings, terminal: Terminal) -> None:
    """Prints what each culling and each kind of stride asks."""
    from pipelines.report.tracing_markdown import TABLES

    for table in TABLES:
        terminal.table(table.headers, table.rows(to_json_value(report)["sets"]), table.title)
    kind = " (software: it is not timed)" if report["software_adapter"] else ""
    terminal.line(f"adapter  {report['adapter']}{kind}")
    terminal.line(f"report   {settings.output / 'report.md'}")
