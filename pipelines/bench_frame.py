"""`sdfprim bench frame`: GPU milliseconds of the pipeline by stage, as in Tables 1 to 3 of the SDFDDGI paper.

Frames in which camera and sun move, of one committed preset, over sets of primitives; medians and 95th
percentiles. A stage's time is that of its passes; the total runs from the technique's first timestamp to its
last, gaps between passes included.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fit.scene import Camera, Float64
from pipelines.console import Terminal, Update
from pipelines.convert import make_folder, require_file
from pipelines.documents import report_header, write_json, write_text
from pipelines.errors import UsageError
from pipelines.report.frame_markdown import build_markdown
from pipelines.studio import AS_IN_THE_FILE, LightingOptions, Studio
from runtime.presets import PRESETS

if TYPE_CHECKING:
    from fit.primitives import PrimitiveSet
    from runtime.lights import AnyLight
    from runtime.renderer import Renderer
    from runtime.settings import RenderSettings
    from runtime.timing import Interval

STAGES: Mapping[str, tuple[str, ...]] = {
    "culling": ("world/",),
    "probe update": ("sdfddgi/",),
    "contact GI": ("contact/",),
    "shading": ("shading/", "composite/gather_irradiance"),
}
"""Stages of the technique by the folders of their kernels, in the paper's words; its CPU does the culling."""

BESIDE: Mapping[str, tuple[str, ...]] = {
    "G-buffer": ("primary/",),
    "shadow maps and RSM": ("direct/draw_light_view",),
    "direct light": ("direct/light_pixels",),
    "picture": ("composite/", "glossy/"),
}
"""What a frame has anyway, and the technique's total leaves out."""

WARM_UP = 64
"""Frames before the timed ones: new probes take more rays than later, clocks rise."""

SWAY, TURN, SUN_TURN = 0.01, 0.15, 0.2
"""How far the camera goes, of the scene's diagonal, how far it turns and how far the sun does, radians."""


@dataclass(frozen=True)
class FrameBenchSettings:
    """What `bench frame` was asked for: sets of primitives of one scene, a preset of `runtime.presets`."""

    scene: Path
    output: Path
    sets: tuple[Path, ...]
    preset: str = "balanced"
    size: tuple[int, int] | None = None
    frames: int = 300
    warm_up: int = WARM_UP
    max_probes: int | None = None
    camera: str | None = None
    lighting: LightingOptions = AS_IN_THE_FILE
    scale: float = 1.0


def run(settings: FrameBenchSettings, update: Update) -> dict[str, Any]:
    """Times every set, and writes OUTPUT/frame.json and OUTPUT/frame.md.

    Raises:
        UsageError: a file, camera or preset is not there.
        NoAdapter: there is no GPU.
    """
    from fit import export, gltf

    check(settings)
    scene = gltf.load(settings.scene, scale=settings.scale)
    preset = _preset(settings)
    studio = Studio.set_up(scene, settings.camera, settings.lighting, preset.size, 0.0)
    if studio.gpu.is_software and settings.max_probes is None:
        settings = replace(settings, max_probes=SOFTWARE_PROBES)
        preset = _preset(settings)
    report = (
        report_header("bench frame", settings, seed=0)
        | studio.describe()
        | {"preset": settings.preset, "probes": None, "sets": []}
    )
    for number, file in enumerate(settings.sets):
        primitives = export.read(file)
        done = _share(update, number, len(settings.sets))
        row, report["probes"] = _time_set(studio, primitives, preset, settings, done)
        report["sets"].append({"file": file, "primitives": len(primitives)} | row)
        write_json(settings.output / "frame.json", report)
        write_text(settings.output / "frame.md", build_markdown(report))
    return report


SOFTWARE_PROBES = 256
"""Probes on a software adapter, whose times mean nothing: the command is tried there, not the speed."""


def check(settings: FrameBenchSettings) -> None:
    """Raises UsageError for what can be seen to be wrong before any work is done, and makes the folder."""
    require_file(settings.scene)
    if not settings.sets:
        raise UsageError("--set: name at least one set of primitives, from convert")
    for file in settings.sets:
        require_file(file)
    settings.lighting.check()
    if settings.preset not in PRESETS:
        raise UsageError(f"--preset {settings.preset}: there are {', '.join(PRESETS)}")
    if settings.frames < 2 or settings.warm_up < 0:
        raise UsageError(f"--frames {settings.frames}: give at least 2")
    make_folder(settings.output)


def _preset(settings: FrameBenchSettings) -> RenderSettings:
    preset = PRESETS[settings.preset]
    technique = preset.technique
    if settings.max_probes is not None:
        technique = replace(technique, max_probes=settings.max_probes)
    return replace(preset, size=settings.size or preset.size, technique=technique)


def _time_set(
    studio: Studio,
    primitives: PrimitiveSet,
    preset: RenderSettings,
    settings: FrameBenchSettings,
    done: Update,
) -> tuple[dict[str, Any], int]:
    from runtime.renderer import Renderer

    renderer = Renderer(studio.gpu, studio.scene, primitives, preset, studio.illumination)
    lower, upper = renderer.world.bounds
    reach = SWAY * float(np.linalg.norm(upper - lower))
    frames = []
    total = settings.warm_up + settings.frames
    for number in range(total):
        phase = 2 * np.pi * number / settings.frames
        _step(renderer, studio.view.camera, studio.illumination.lights, phase, reach)
        renderer.draw_frame()
        intervals = renderer.pass_intervals()
        if number >= settings.warm_up:
            frames.append(intervals)
        done("time frames", (number + 1) / total)
    return summarise(frames), int(renderer.technique.count)  # type: ignore[attr-defined]


def _step(renderer: Renderer, camera: Camera, lights: Sequence[AnyLight], phase: float, reach: float) -> None:
    """Sways and turns the camera, and turns every sun, by a phase (radians) that ends where it began."""
    from runtime.lights import Sun

    place = camera.world_from_local.copy()
    place[:3, 3] += reach * np.sin(phase) * camera.world_from_local[:3, 0]
    place[:3, :3] = _about_y(TURN * np.sin(2 * phase)) @ camera.world_from_local[:3, :3]
    renderer.set_camera(replace(camera, world_from_local=place))
    turn = _about_y(SUN_TURN * np.sin(phase))
    moved = [
        replace(one, direction=tuple((turn @ one.direction).tolist())) if isinstance(one, Sun) else one
        for one in lights
    ]
    if moved != list(lights) or phase:
        renderer.set_lights(moved)


def _about_y(angle: float) -> Float64:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def summarise(frames: Sequence[Sequence[Interval]]) -> dict[str, Any]:
    """Median and 95th percentile of every stage, of the total and of every pass, in milliseconds.

    A pass belongs to the first of the stages, then of what stands beside them, that names its folder. Values
    are None where the adapter keeps no time.
    """
    parts = {**STAGES, **BESIDE}
    by_part: dict[str, list[float]] = {name: [] for name in parts}
    by_pass: dict[str, list[float]] = {}
    totals: list[float] = []
    for frame in frames:
        if any(one.begin is None for one in frame):
            return {"total": None, "stages": {}, "beside": {}, "passes": {}}
        spent = dict.fromkeys(parts, 0.0)
        for one in frame:
            assert one.begin is not None and one.end is not None
            spent[part_of(one.label)] += one.end - one.begin
            by_pass.setdefault(one.label, []).append(one.end - one.begin)
        for name, value in spent.items():
            by_part[name].append(value)
        own = [one for one in frame if part_of(one.label) in STAGES]
        totals.append(_span(own, frame))
    return {
        "total": _spread(totals),
        "stages": {name: _spread(by_part[name]) for name in STAGES},
        "beside": {name: _spread(by_part[name]) for name in BESIDE},
        "passes": {label: _spread(values) for label, values in by_pass.items()},
    }


def part_of(label: str) -> str:
    """The stage, or what stands beside them, that a pass belongs to.

    Raises:
        KeyError: none names it.
    """
    for name, prefixes in {**STAGES, **BESIDE}.items():
        if label.startswith(prefixes):
            return name
    raise KeyError(f"pass {label} belongs to no stage: add its folder to bench_frame.STAGES or BESIDE")


def _span(own: Sequence[Interval], frame: Sequence[Interval]) -> float:
    """Milliseconds from the first of `own` passes to the last, without the passes of others between them."""
    if not own:
        return 0.0
    begin, end = min(one.begin or 0.0 for one in own), max(one.end or 0.0 for one in own)
    others = [
        one for one in frame if one not in own and (one.begin or 0.0) >= begin and (one.end or 0.0) <= end
    ]
    return end - begin - sum((one.end or 0.0) - (one.begin or 0.0) for one in others)


def _spread(values: Sequence[float]) -> dict[str, float]:
    return {"median": float(np.median(values)), "p95": float(np.percentile(values, 95))}


def _share(update: Update, number: int, count: int) -> Update:
    return lambda stage, done: update(f"set {number + 1} of {count}: {stage}", (number + done) / count)


def show(report: dict[str, Any], settings: FrameBenchSettings, terminal: Terminal) -> None:
    """Prints a row for each set, and where the tables lie."""
    kind = " (software: times mean nothing)" if report["software_adapter"] else ""
    terminal.line(f"adapter  {report['adapter']}{kind}")
    rows = [
        [
            one["primitives"],
            _median(one["total"]),
            *(_median(one["stages"].get(name)) for name in STAGES),
            *(_median(one["beside"].get(name)) for name in BESIDE),
        ]
        for one in report["sets"]
    ]
    terminal.table(["primitives", "total ms", *STAGES, *BESIDE], rows)
    terminal.line(f"tables   {settings.output / 'frame.md'}")


def _median(spread: Mapping[str, float] | None) -> float | None:
    return None if spread is None else spread["median"]
