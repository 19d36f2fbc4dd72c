"""The `sdfprim` command: parses arguments, calls each command's `run`, prints what it returns.

Exit codes: 0 all went well, 1 something failed, 2 the command was used wrongly, 130 interrupted.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args

import cyclopts
from cyclopts import Parameter

from pipelines import (
    bench_contact,
    bench_fit,
    bench_frame,
    bench_gi,
    bench_tracing,
    compare,
    convert,
    demo,
    describe,
    matrix,
    render,
    slices,
)
from pipelines.animate import TimeOptions, parse_span
from pipelines.console import Terminal
from pipelines.errors import UsageError
from pipelines.figures import make
from pipelines.machine import package_version
from pipelines.methods import METHODS, Culling, Quality
from pipelines.options import parse_budgets, parse_names, parse_probes, parse_size
from pipelines.worker import describe_error

T = TypeVar("T")

OK, FAILED, BAD_USAGE, INTERRUPTED = 0, 1, 2, 130

app = cyclopts.App(
    name="sdfprim",
    help="Fit analytic SDF primitives to a glTF scene, and light the scene through them.",
    help_epilogue="Exit codes: 0 all went well, 1 something failed, 2 bad usage, 130 interrupted.",
    version=package_version(),
    help_format="plaintext",
    suppress_keyboard_interrupt=False,
)

bench = cyclopts.App(name="bench", help="Measure what the program does, over budgets, and beside its peers.")
app.command(bench)

Numbers = Parameter(allow_leading_hyphen=True)
"""A value may start with a minus sign: --air -1,0,2."""

Output = Parameter(name=("--output", "-o"))
Flag = Parameter(negative="")


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the console script."""
    sys.exit(execute(sys.argv[1:] if arguments is None else arguments))


def execute(arguments: Sequence[str]) -> int:
    """Runs one command line and returns its exit code; every foreseeable failure is one line on stderr."""
    terminal = Terminal()
    try:
        return int(app(arguments, exit_on_error=False, print_error=False, result_action="return_value") or OK)
    except cyclopts.MissingArgumentError as error:
        terminal.error(_missing(error))
        return BAD_USAGE
    except cyclopts.CycloptsError as error:
        terminal.error(f"{str(error).strip()} (sdfprim --help lists what there is)")
        return BAD_USAGE
    except UsageError as error:
        terminal.error(str(error))
        return BAD_USAGE
    except KeyboardInterrupt:
        terminal.error("interrupted; what was finished is kept")
        return INTERRUPTED
    except Exception as error:
        message = _foreseen(error)
        if message is None:
            raise
        terminal.error(message)
        return FAILED


def _missing(error: cyclopts.MissingArgumentError) -> str:
    """`--output` is left out altogether, or stands there without a value: cyclopts says the same of both."""
    command = " ".join(error.command_chain or ())
    name = error.argument.name if error.argument else "an argument"
    if error.argument and error.argument.index is not None:
        what = f"{name.lstrip('-').upper()} is needed"
    else:
        what = f"{name} and its value are needed"
    return f"{command}: {what} (sdfprim {command} --help lists what there is)"


def _foreseen(error: Exception) -> str | None:
    """Bad input, a full disk, no GPU: in words. None for anything else, a fault that shows its trace."""
    from runtime.device import NoAdapter

    if isinstance(error, NoAdapter):
        return str(error)
    return describe_error(error) if isinstance(error, ValueError | OSError) else None


@app.command(name="inspect")
def inspect_files(*files: Path, scale: float = 1.0, json: Annotated[bool, Flag] = False) -> int:
    """Tell what a glTF file holds, and what of it will not be used.

    Parameters
    ----------
    files
        .gltf or .glb files.
    scale
        Multiplies every length.
    json
        Print the report as JSON.
    """
    terminal = Terminal(json)
    report = describe.run(describe.InspectSettings(files, scale))
    terminal.result(report, lambda: describe.show(report, terminal))
    return _exit_code(report)


@app.command(name="convert")
def convert_files(
    *files: Path,
    output: Annotated[Path, Output],
    max_primitives: int | None = None,
    max_bytes: int | None = None,
    max_error: float | None = None,
    max_leaks: float = 1.0,
    preset: convert.Preset | None = None,
    air: Annotated[list[str] | None, Numbers, Parameter(negative="")] = None,
    scale: float = 1.0,
    seed: int = 0,
    timeout: float = 900.0,
    instances: Annotated[bool, Flag] = False,
    json: Annotated[bool, Flag] = False,
) -> int:
    """Approximate glTF scenes by boxes, spheres, cylinders and planes.

    Writes OUTPUT/<stem>.prims.glb and .prims.npz for each file, and OUTPUT/report.json for all of them.

    Parameters
    ----------
    files
        .gltf or .glb files.
    output
        Folder for the results; it is made where it is missing.
    max_primitives
        At most this many primitives.
    max_bytes
        At most this many bytes on the GPU; 64 for each primitive.
    max_error
        Stop adding primitives once 95 % of the seen surface is this near to the set, metres.
    max_leaks
        Share of rays, such as 0.02, above which primitives are added for smaller gains than by default.
    preset
        coarse (48 primitives at most) or fine (192), where no other budget is given.
    air
        A space that is air: outside, or a point x,y,z in it. May be given several times.
    scale
        Multiplies every length.
    seed
        Seed of all random choices.
    timeout
        Seconds after which a file is given up.
    instances
        Fit what is drawn more than once by itself, once, and place it: for towns of a few kinds of houses.
    json
        Print the report as JSON.
    """
    terminal = Terminal(json)
    settings = convert.ConvertSettings(
        files, output, max_primitives, max_bytes, max_error, preset, tuple(air or ()), scale, seed, timeout,
        max_leaks, instances,
    )  # fmt: skip
    with terminal.progress() as update:
        report = convert.run(settings, progress=lambda state: update(state.describe(), state.share))
    terminal.result(report, lambda: convert.show(report, settings, terminal))
    return _exit_code(report)


@app.command(name="render")
def render_scene(
    scene: Path,
    *,
    output: Annotated[Path, Output],
    set_: Annotated[Path | None, Parameter(name="--set")] = None,
    gi: render.Technique | None = None,
    quality: Quality | None = None,
    presets: Path | None = None,
    camera: Annotated[str | None, Numbers] = None,
    sun: Annotated[str | None, Numbers] = None,
    sky: Annotated[str | None, Numbers] = None,
    lights: Literal["file"] | None = None,
    exposure: Annotated[float, Numbers] = 0.0,
    scale: float = 1.0,
    aov: Annotated[bool, Flag] = False,
    size: str = "640x360",
    frames: int = render.DEFAULT_FRAMES,
    view: str = "final",
    samples: int = render.DEFAULT_SAMPLES,
    noise: float | None = None,
    glossy: Annotated[bool, Flag] = False,
    shading: Literal["shared", "full"] = "full",
    time: Annotated[float | None, Numbers] = None,
    animate: Annotated[str | None, Numbers] = None,
    frames_per_second: float = 24.0,
    animation: str | None = None,
    culling: Culling = "grid",
    contact: render.Contact = "off",
    json: Annotated[bool, Flag] = False,
) -> int:
    """Render a glTF scene, lit through its primitives.

    Parameters
    ----------
    scene
        A .gltf or .glb file.
    output
        The picture: .png (tone-mapped) or .exr (linear).
    set_
        The scene's primitives, from convert; without it the scene is converted first.
    gi
        The global illumination technique, sdfddgi by default; none shows direct light alone. ddgi-triangles
        is DDGI that sees the mesh itself, ddgi-cascades has four grids of probes around the camera. reference
        path traces the mesh with Mitsuba (pip install 'sdfprim[reference]'), reference-gpu with the runtime:
        the truth, to compare with. References are kept in the user's cache folder.
    quality
        Technique, probes, rays, and, without --set, number of primitives that bench gi found Pareto-best.
    presets
        A presets.json of bench gi that --quality chooses from; the program brings its own.
    camera
        A camera's name or number in the file, a named view, or x,y,z,tx,ty,tz,fov.
    sun
        x,y,z,strength: a vector towards the sun, and its irradiance in W/m2. Switches the file's lights off.
    sky
        r,g,b radiance in W/m2/sr, or an equirectangular .hdr or .exr. Switches the file's lights off.
    lights
        file: keep the file's lights beside --sun and --sky.
    exposure
        Stops; PNG only.
    scale
        Multiplies every length.
    aov
        Add position, normal, albedo, direct, indirect and irradiance to an EXR.
    size
        Width x height in pixels.
    frames
        Frames to render; the picture is the last one.
    view
        What to show: final, direct, indirect, irradiance, albedo, normal, depth, sdf-steps,
        candidate-counts, mesh, primitives, blend (the set over the mesh; red where it blocks light, blue
        where it leaks), side-by-side (those three in one picture), ...
    samples
        Of a reference: paths for each pixel.
    noise
        Of a reference: end once the mean absolute noise is this share of the mean, such as 0.02.
    glossy
        Smooth surfaces and metals reflect; without it every surface is diffuse, as in comparisons.
    shading
        How pixels get indirect light: shared asks the probes at one of sixteen in each frame and carries its
        light to the others, full asks at every pixel.
    time
        Seconds of the scene's animation to show; without it the scene is at rest.
    animate
        first:last in seconds: a row of pictures, for which OUTPUT has a number, as in frames/%04d.png. The
        light settles on the first one and then follows as in a game, one frame a picture.
    frames_per_second
        Pictures of a second of --animate.
    animation
        Name of the animation that plays; inspect lists them. All play by default.
    culling
        How the nearest primitive is found: by exact lists on a grid, by clusters, or by asking all (none).
        The picture is the same.
    contact
        Light from what is near on the screen and too small for the primitives: off, on, or paper (as SDFDDGI
        prints it, which loses energy). Its views are contact/ao, contact/near, contact/sources and, before
        they are denoised, contact/ao-raw and contact/near-raw.
    json
        Print the report as JSON.
    """
    terminal = Terminal(json)
    lighting = render.LightingOptions(sun, sky, lights == "file")
    if quality and gi:
        raise UsageError(f"--gi {gi}: --quality {quality} chooses the technique; leave one of them out")
    settings = render.PictureSettings(
        scene, output, set_, gi or "sdfddgi", camera, lighting, exposure, scale, aov, parse_size(size),
        frames, view, samples, noise, glossy, contact, render.ShadingMode(shading), quality, presets,
        TimeOptions(time, parse_span(animate), frames_per_second, animation), culling,
    )  # fmt: skip
    with terminal.progress() as update:
        report = render.run(settings, update)
    terminal.result(report, lambda: render.show(report, terminal))
    return OK


@app.command(name="slices")
def slice_scene(
    scene: Path,
    *,
    output: Annotated[Path, Output],
    set_: Annotated[Path | None, Parameter(name="--set")] = None,
    at: Annotated[str | None, Numbers] = None,
    air: Annotated[list[str] | None, Numbers, Parameter(negative="")] = None,
    scale: float = 1.0,
    width: int = 1500,
    json: Annotated[bool, Flag] = False,
) -> int:
    """Cut a scene open: which spaces are air, where the mesh is, and where the set fills them.

    Writes one PNG with a cut across each axis, a scale and a legend.

    Parameters
    ----------
    scene
        A .gltf or .glb file.
    output
        The picture, .png.
    set_
        The scene's primitives, from convert; without it the scene is converted first.
    at
        The point x,y,z that the cuts go through, metres; the middle of the air by default.
    air
        A space that is air, as for convert: outside, or a point x,y,z in it. May be given several times.
    scale
        Multiplies every length.
    width
        Of the picture, pixels.
    json
        Print the report as JSON.
    """
    terminal = Terminal(json)
    settings = slices.SlicesSettings(scene, output, set_, at, tuple(air or ()), scale, width)
    with terminal.progress() as update:
        report = slices.run(settings, update)
    terminal.result(report, lambda: slices.show(report, terminal))
    return OK


@app.command(name="compare")
def compare_sets(
    scene: Path,
    *,
    output: Annotated[Path, Output],
    set_: Annotated[list[Path] | None, Parameter(name="--set", negative="")] = None,
    presets: str | None = None,
    budgets: str | None = None,
    gi: str | None = None,
    probes: str | None = None,
    truth: Literal["reference", "reference-gpu"] | None = None,
    floor: Annotated[bool, Flag] = False,
    samples: int = 256,
    noise: float | None = None,
    camera: Annotated[str | None, Numbers] = None,
    sun: Annotated[str | None, Numbers] = None,
    sky: Annotated[str | None, Numbers] = None,
    lights: Literal["file"] | None = None,
    exposure: Annotated[float, Numbers] = 0.0,
    scale: float = 1.0,
    size: str | None = None,
    frames: int = render.DEFAULT_FRAMES,
    air: Annotated[list[str] | None, Numbers, Parameter(negative="")] = None,
    seed: int = 0,
    json: Annotated[bool, Flag] = False,
) -> int:
    """Put sets of primitives, and ways to light them, beside each other.

    A scene alone: a coarse set beside a fine one, in counts, errors, times and pictures. With any of --set,
    --presets, --budgets, --gi, --probes and --truth: every set by every way to light it, each with its errors
    of fit, solver and both against path tracing, and the smallest set that is about as good as any.
    Writes OUTPUT/report.json and OUTPUT/report.html, one page that opens without a network.

    Parameters
    ----------
    scene
        A .gltf or .glb file.
    output
        Folder for the results.
    set_
        A set of primitives of this scene. May be given several times.
    presets
        Fits to compare: coarse, fine, or coarse,fine.
    budgets
        Fits to compare, by numbers of primitives: 16,64,256.
    gi
        Ways to light: sdfddgi, ddgi, ddgi-triangles (DDGI that sees the mesh itself), none.
    probes
        Grids of probes: default, counts along x, y and z like 22x14x32, or spacings in metres like 0.5.
    truth
        What path traces: reference (Mitsuba, the default) or reference-gpu (the runtime).
    floor
        Also tell the error of the same probes filled by the path tracer: no solver can do better on them.
    samples
        Paths for each point of the truth.
    noise
        End a path tracing once its mean absolute noise is this share of the mean, such as 0.02.
    camera
        As for render.
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
        Width x height in pixels; 640x360, or 320x180 where path tracing is needed.
    frames
        Frames to render for each picture.
    air
        A space that is air, as for convert: outside, or a point x,y,z in it. May be given several times.
    seed
        Seed of all random choices.
    json
        Print the report as JSON.
    """
    terminal = Terminal(json)
    lighting = render.LightingOptions(sun, sky, lights == "file")
    if not any((set_, presets, budgets, gi, probes, truth, floor)):
        if air:
            raise UsageError(
                "--air: a comparison of coarse and fine finds the air itself; add --presets coarse,fine"
            )
        shape = parse_size(size or "640x360")
        settings = compare.CompareSettings(
            scene, output, camera, lighting, exposure, scale, shape, frames, seed
        )
        return _compare(settings, terminal)
    from pipelines.gi_errors.truth import TruthSettings

    asked = matrix.MatrixSettings(
        scene,
        output,
        TruthSettings(truth or "reference", samples, noise, seed),
        sets=tuple(set_ or ()),
        presets=parse_names("--presets", presets, compare.PRESETS) if presets else (),
        budgets=parse_budgets("--budgets", budgets) if budgets else (),
        methods=parse_names("--gi", gi, METHODS) if gi else ("sdfddgi",),
        probes=parse_probes(probes) if probes else (None,),
        camera=camera,
        lighting=lighting,
        exposure=exposure,
        scale=scale,
        size=parse_size(size or "320x180"),
        frames=frames,
        air=tuple(air or ()),
        seed=seed,
        floor=floor,
    )
    with terminal.progress() as update:
        report = matrix.run(asked, update)
    terminal.result(report, lambda: matrix.show(report, asked, terminal))
    return OK


@bench.command(name="fit")
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


@bench.command(name="gi")
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


@bench.command(name="contact")
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


def _at_most_one(option: str, given: Sequence[T]) -> T | None:
    if len(given) > 1:
        raise UsageError(f"{option}: --figures takes one at most")
    return given[0] if given else None


@bench.command(name="tracing")
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


@bench.command(name="frame")
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


@app.command(name="demo")
def run_demo(
    *, output: Annotated[Path, Output] = Path("out/demo"), json: Annotated[bool, Flag] = False
) -> int:
    """Convert, render and compare a scene that comes with the program.

    Parameters
    ----------
    output
        Folder for the results.
    json
        Print the report as JSON.
    """
    return _compare(demo.settings(output), Terminal(json))


def _compare(settings: compare.CompareSettings, terminal: Terminal) -> int:
    with terminal.progress() as update:
        report = compare.run(settings, update)
    terminal.result(report, lambda: compare.show(report, settings, terminal))
    return OK


def _exit_code(report: dict[str, Any]) -> int:
    return FAILED if any(row["status"] != "ok" for row in report["assets"]) else OK


if __name__ == "__main__":
    main()
