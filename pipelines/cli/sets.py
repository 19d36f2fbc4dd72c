"""Commands on files and sets: `inspect`, `convert`, `slices`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from pipelines import (
    convert,
    describe,
    slices,
)
from pipelines.cli.common import OK, Flag, Numbers, Output, exit_code
from pipelines.console import Terminal


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
    return exit_code(report)


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
    return exit_code(report)


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
