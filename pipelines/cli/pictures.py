"""Commands that light a scene: `render`, `compare`, `demo`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from pipelines import (
    compare,
    demo,
    matrix,
    render,
)
from pipelines.animate import TimeOptions, parse_span
from pipelines.cli.common import OK, Flag, Numbers, Output
from pipelines.console import Terminal
from pipelines.errors import UsageError
from pipelines.methods import METHODS, Culling, Quality
from pipelines.options import parse_budgets, parse_names, parse_probes, parse_size


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
