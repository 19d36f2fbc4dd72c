"""`sdfprim bench`: what the fit, the passes and the tracing cost."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from pipelines import (
    bench_contact,
    bench_fit,
    bench_frame,
    bench_tracing,
    render,
)
from pipelines.cli.common import FAILED, OK, Flag, Numbers, Output
from pipelines.console import Terminal
from pipelines.options import parse_budgets, parse_size


def bench_fits(
    *files: Path,
    output: Annotated[Path, Output],
    budgets: str | None = None,
    details: bool = True,
    peers: Annotated[bool, Flag] = False,
    peer_budgets: str | None = None,
    air: Annotated[list[str] | None, Numbers, Parameter(negative="")] = None,
    scale: float = 1.0,
    seed: int = 0,
    timeout: float = 300.0,
    json: Annotated[bool, Flag] = False,
) -> int:
    """Measure error and seconds of the fit over budgets, by kind and by step of the method.

    Writes OUTPUT/report.json, .csv, .md and .html (one page that opens without a network) after every run.

    Parameters
    ----------
    files
        .gltf or .glb files.
    output
        Folder for the results; it is made where it is missing.
    budgets
        Numbers of primitives with commas between them; 4,8,16,32,64,128,256,512 by default.
    details
        Fit again with kinds and steps of the method left out, at 64 primitives.
    peers
        Also run V-HACD and CoACD on the same samples (pip install 'sdfprim[peers]').
    peer_budgets
        Numbers of hulls; 64 by default.
    air
        A space that is air: outside, or a point x,y,z in it. May be given several times.
    scale
        Multiplies every length.
    seed
        Seed of all random choices.
    timeout
        Seconds after which a run is given up.
    json
        Print the report as JSON.
    """
    terminal = Terminal(json)
    settings = bench_fit.BenchSettings(
        files,
        output,
        parse_budgets("--budgets", budgets) if budgets else bench_fit.BUDGETS,
        details,
        peers,
        parse_budgets("--peer-budgets", peer_budgets) if peer_budgets else (bench_fit.DETAIL,),
        tuple(air or ()),
        scale,
        seed,
        timeout,
    )
    with terminal.progress() as update:
        report = bench_fit.run(settings, update)
    terminal.result(report, lambda: bench_fit.show(report, settings, terminal))
    return FAILED if bench_fit.failed(report) else OK


def bench_contact_light(
    *files: Path,
    output: Annotated[Path, Output],
    set_: Annotated[Path | None, Parameter(name="--set")] = None,
    camera: Annotated[str | None, Numbers] = None,
    sun: Annotated[str | None, Numbers] = None,
    sky: Annotated[str | None, Numbers] = None,
    lights: Literal["file"] | None = None,
    size: str = "320x180",
    samples: int = 256,
    frames: int = bench_contact.FRAMES,
    seed: int = 0,
    json: Annotated[bool, Flag] = False,
) -> int:
    """Measure contact light's ambient occlusion against rays over its settings, each changed alone.

    Writes OUTPUT/report.json after every setting.

    Parameters
    ----------
    files
        .gltf or .glb files; two that come with the program by default.
    output
        Folder for the results; it is made where it is missing.
    set_
        Primitives of the one scene: the irradiance near to things is held against path tracing, too.
    camera
        As for render.
    sun
        As for render.
    sky
        As for render.
    lights
        As for render.
    size
        Width x height in pixels.
    samples
        Rays, and paths, for each point of the truth.
    frames
        Frames until contact light is judged.
    seed
        Seed of all random choices.
    json
        Print the report as JSON.
    """
    terminal = Terminal(json)
    lighting = render.LightingOptions(sun, sky, lights == "file")
    settings = bench_contact.ContactBenchSettings(
        files, output, set_, camera, lighting, parse_size(size), samples, frames, seed
    )
    with terminal.progress() as update:
        report = bench_contact.run(settings, update)
    terminal.result(report, lambda: bench_contact.show(report, settings, terminal))
    return OK


def bench_tracers(
    *,
    output: Annotated[Path, Output],
    set_: Annotated[list[Path] | None, Parameter(name="--set", negative="")] = None,
    primitives: str | None = None,
    rays: int = bench_tracing.RAYS,
    repeats: int = 8,
    seed: int = 0,
    json: Annotated[bool, Flag] = False,
) -> int:
    """Count what finding the nearest primitive takes, by every culling, and following a ray, by every stride.

    Distances are counted on the GPU and are the same on any; times are of the adapter at hand. Measures a
    generated hall and a generated town. Writes OUTPUT/report.json and OUTPUT/report.md.

    Parameters
    ----------
    output
        Folder for the results; it is made where it is missing.
    set_
        A set of primitives to measure, too. May be given several times.
    primitives
        Numbers of primitives in the generated scenes; 43,200,1000 by default, none beside --set.
    rays
        Rays through each set.
    repeats
        How often each pass is timed.
    seed
        Seed of scenes, rays and clusters.
    json
        Print the report as JSON.
    """
    terminal = Terminal(json)
    counts = parse_budgets("--primitives", primitives) if primitives else () if set_ else bench_tracing.COUNTS
    settings = bench_tracing.TracingBenchSettings(output, tuple(set_ or ()), counts, rays, repeats, seed)
    with terminal.progress() as update:
        report = bench_tracing.run(settings, update)
    terminal.result(report, lambda: bench_tracing.show(report, settings, terminal))
    return OK


def bench_frames(
    scene: Path,
    *,
    output: Annotated[Path, Output],
    set_: Annotated[list[Path], Parameter(name="--set", negative="")],
    preset: str = "balanced",
    size: str | None = None,
    frames: int = 300,
    max_probes: int | None = None,
    camera: Annotated[str | None, Numbers] = None,
    sun: Annotated[str | None, Numbers] = None,
    sky: Annotated[str | None, Numbers] = None,
    lights: Literal["file"] | None = None,
    scale: float = 1.0,
    json: Annotated[bool, Flag] = False,
) -> int:
    """Time SDFDDGI by stage over sets of primitives while camera and sun move: Tables 1 to 3 of its paper.

    Writes OUTPUT/frame.json and OUTPUT/frame.md, our rows beside the paper's.

    Parameters
    ----------
    scene
        A .gltf or .glb file.
    output
        Folder for the results.
    set_
        A set of primitives of the scene, from convert. May be given several times, the smallest first.
    preset
        The committed settings that every figure is of: balanced.
    size
        Width x height in pixels; the preset's own, 1920x1080, by default.
    frames
        Frames that are timed, after 64 that are not.
    max_probes
        Probes at most, instead of the preset's; a software adapter takes 256.
    camera
        As for render.
    sun
        As for render.
    sky
        As for render.
    lights
        As for render.
    scale
        Multiplies every length.
    json
        Print the report as JSON.
    """
    terminal = Terminal(json)
    settings = bench_frame.FrameBenchSettings(
        scene,
        output,
        tuple(set_),
        preset,
        parse_size(size) if size else None,
        frames,
        max_probes=max_probes,
        camera=camera,
        lighting=render.LightingOptions(sun, sky, lights == "file"),
        scale=scale,
    )
    with terminal.progress() as update:
        report = bench_frame.run(settings, update)
    terminal.result(report, lambda: bench_frame.show(report, settings, terminal))
    return OK
