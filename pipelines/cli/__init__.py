"""The `sdfprim` command: parses arguments, calls each command's `run`, prints what it returns.

Exit codes: 0 all went well, 1 something failed, 2 the command was used wrongly, 130 interrupted.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import cyclopts

from pipelines.cli.bench import bench_contact_light, bench_fits, bench_frames, bench_tracers
from pipelines.cli.bench_light import bench_light
from pipelines.cli.common import BAD_USAGE, FAILED, INTERRUPTED, OK
from pipelines.cli.pictures import compare_sets, render_scene, run_demo
from pipelines.cli.sets import convert_files, inspect_files, slice_scene
from pipelines.console import Terminal
from pipelines.errors import UsageError
from pipelines.machine import package_version
from pipelines.worker import describe_error

app = cyclopts.App(
    name="sdfprim",
    help="Fit analytic SDF primitives to a glTF scene, and light the scene through them.",
    help_epilogue="Exit codes: 0 all went well, 1 something failed, 2 bad usage, 130 interrupted.",
    version=package_version(),
    help_format="plaintext",
    suppress_keyboard_interrupt=False,
)
bench = cyclopts.App(name="bench", help="Measure what the program does, over budgets, and beside its peers.")

app.command(inspect_files, name="inspect")
app.command(convert_files, name="convert")
app.command(render_scene, name="render")
app.command(slice_scene, name="slices")
app.command(compare_sets, name="compare")
app.command(run_demo, name="demo")
app.command(bench)
bench.command(bench_fits, name="fit")
bench.command(bench_light, name="gi")
bench.command(bench_contact_light, name="contact")
bench.command(bench_tracers, name="tracing")
bench.command(bench_frames, name="frame")


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
        command = " ".join(("sdfprim", *(error.command_chain or ())))
        terminal.error(f"{str(error).strip()} ({command} --help lists what there is)")
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
