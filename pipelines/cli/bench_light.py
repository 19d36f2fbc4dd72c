"""`sdfprim bench gi`: speed against error of global illumination, and the paper's figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, TypeVar, get_args

from cyclopts import Parameter

from pipelines import (
    bench_gi,
    compare,
    render,
)
from pipelines.cli.common import FAILED, OK, Flag, Numbers, Output
from pipelines.console import Terminal
from pipelines.errors import UsageError
from pipelines.figures import make
from pipelines.methods import METHODS, Culling
from pipelines.options import parse_budgets, parse_names, parse_size

T = TypeVar("T")


def bench_light(
    *files: Path,
    output: Annotated[Path, Output],
    set_: Annotated[list[Path] | None, Parameter(name="--set", negative="")] = None,
    sets: Annotated[list[Path] | None, Parameter(negative="")] = None,
    presets: str | None = None,
    budgets: str | None = None,
    gi: str = ",".join(bench_gi.METHODS_TRIED),
    probes: str = ",".join(map(str, bench_gi.PROBES)),
    rays: str = ",".join(map(str, bench_gi.RAYS)),
    truth: Literal["reference", "reference-gpu"] = "reference",
    samples: int = 256,
    noise: float | None = None,
    camera: Annotated[list[str] | None, Numbers, Parameter(negative="")] = None,
    views: Path | None = None,
    sun: Annotated[str | None, Numbers] = None,
    sky: Annotated[str | None, Numbers] = None,
    lights: Literal["file"] | None = None,
    exposure: Annotated[float, Numbers] = 0.0,
    scale: float = 1.0,
    size: str = "320x180",
    timed_size: str | None = None,
    frames: int = bench_gi.FRAMES,
    timed_frames: int = 32,
    air: Annotated[list[str] | None, Numbers, Parameter(negative="")] = None,
    culling: str = "grid",
    seed: int = 0,
    figures: Annotated[bool, Flag] = False,
    figure: Annotated[list[int] | None, Parameter(negative="")] = None,
    model: Path | None = None,
    json: Annotated[bool, Flag] = False,
) -> int:
    """Measure time and error of light over budgets, probes, rays and methods, and find the best settings.

    Writes OUTPUT/report.json, .md and .html (one page that opens without a network), pictures, and
    presets.json with the settings that render --quality takes, after every method.

    Parameters
    ----------
    files
        .gltf or .glb files.
    output
        Folder for the results; it is made where it is missing.
    set_
        A set of primitives of the one scene. May be given several times.
    sets
        A folder in which convert wrote a set of each scene. May be given several times: coarse, fine.
    presets
        Fits to light through: coarse, fine, or coarse,fine.
    budgets
        Fits to light through, by numbers of primitives; 8,32,128,512 by default, none beside sets and
        --presets.
    gi
        Ways to light, with commas between them. Those that see the mesh only light the largest set.
    probes
        Numbers of probes at most, with commas between them.
    rays
        Rays of a probe in a frame, multiples of 64, with commas between them.
    truth
        What path traces: reference (Mitsuba) or reference-gpu (the runtime).
    samples
        Paths for each point of the truth.
    noise
        End a path tracing once its mean absolute noise is this share of the mean, such as 0.02.
    camera
        As for render. May be given several times: errors and times are means over all.
    views
        A file of cameras, light and exposure for each scene, like the program's own assets/views.toml, in
        the place of --camera, --sun, --sky and --exposure.
    sun
        As for render.
    sky
        As for render.
    lights
        As for render.
    exposure
        Stops, the same for every picture.
    scale
        Multiplies every length.
    size
        Width x height in pixels of the pictures that are judged.
    timed_size
        Width x height in pixels of the frames that are timed; 1920x1080, or those that are judged on a
        software adapter.
    frames
        Frames until the light is judged.
    timed_frames
        Frames that are timed, after the light has settled.
    air
        A space that is air, as for convert: outside, or a point x,y,z in it. May be given several times.
    culling
        Ways to find the nearest primitive, with commas between them: grid, clusters, none. The first is
        judged, all are timed.
    seed
        Seed of all random choices.
    figures
        Make counterparts of the SDFDDGI paper's figures instead: OUTPUT/figures.html and its pictures, of
        bundled scenes, or with FILES as its Sponza and --set as the set of it.
    figure
        With --figures: the number of one to make. May be given several times; all by default.
    model
        With --figures: the body of Figure 14, the paper's dragon.
    json
        Print the report as JSON.
    """
    from pipelines.gi_errors.truth import TruthSettings

    terminal = Terminal(json)
    if figures:
        wanted = make.FiguresSettings(
            output,
            _at_most_one("FILES", files),
            _at_most_one("--set", set_ or ()),
            model,
            tuple(figure or ()),
            _at_most_one("--camera", camera or ()),
            render.LightingOptions(sun, sky, lights == "file"),
            exposure,
            parse_size(size),
            frames,
            samples,
        )
        with terminal.progress() as update:
            report = make.run(wanted, update)
        terminal.result(report, lambda: make.show(report, wanted, terminal))
        return OK
    if figure or model:
        raise UsageError("--figure and --model belong to --figures")
    settings = bench_gi.GiBenchSettings(
        files,
        output,
        TruthSettings(truth, samples, noise, seed),
        sets=tuple(set_ or ()),
        set_folders=tuple(sets or ()),
        presets=parse_names("--presets", presets, compare.PRESETS) if presets else (),
        budgets=parse_budgets("--budgets", budgets)
        if budgets
        else ()
        if set_ or sets or presets
        else bench_gi.BUDGETS,
        methods=parse_names("--gi", gi, METHODS),
        probes=parse_budgets("--probes", probes),
        rays=parse_budgets("--rays", rays),
        cameras=tuple(camera or ()),
        views=views,
        lighting=render.LightingOptions(sun, sky, lights == "file"),
        exposure=exposure,
        scale=scale,
        size=parse_size(size),
        timed_size=parse_size(timed_size) if timed_size else None,
        frames=frames,
        timed_frames=timed_frames,
        air=tuple(air or ()),
        seed=seed,
        cullings=parse_names("--culling", culling, get_args(Culling)),
    )
    with terminal.progress() as update:
        report = bench_gi.run(settings, update)
    terminal.result(report, lambda: bench_gi.show(report, settings, terminal))
    return FAILED if bench_gi.failed(report) else OK


def _at_most_one(option: str, given: Sequence[T]) -> T | None:
    if len(given) > 1:
        raise UsageError(f"{option}: --figures takes one at most")
    return given[0] if given else None
