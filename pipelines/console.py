"""What a person sees: progress and notes on stderr, results on stdout. Nothing moves where nobody watches."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from pipelines.documents import to_json_value

Update = Callable[[str, float], None]
"""Called with what is at work and how much of the whole is done, 0 to 1."""


PIPE_WIDTH = 160
"""Columns of a table that goes to a file or another program."""


class Terminal:
    """stdout and stderr of one command. With `as_json`, stdout carries one JSON document and nothing else."""

    def __init__(self, as_json: bool = False) -> None:
        self.as_json = as_json
        width = None if sys.stdout.isatty() else PIPE_WIDTH
        self._out = Console(highlight=False, soft_wrap=True, markup=False, width=width)
        self._err = Console(stderr=True, highlight=False, soft_wrap=True, markup=False)

    def note(self, text: str) -> None:
        """A line for people, on stderr."""
        self._err.print(text)

    def error(self, text: str) -> None:
        """What went wrong, on stderr."""
        self._err.print(f"sdfprim: {text}", style="red")

    def result(self, report: Mapping[str, Any], show: Callable[[], None]) -> None:
        """The command's result: the report as JSON, or what `show` prints."""
        if self.as_json:
            print(json.dumps(to_json_value(report), indent=2, allow_nan=False))
        else:
            show()

    def line(self, text: str) -> None:
        """A line of the result."""
        self._out.print(text)

    def table(self, headers: Sequence[str], rows: Sequence[Sequence[Any]], title: str | None = None) -> None:
        """A table of the result; numbers, and texts that begin with one, are set to the right."""
        table = Table(title=title, title_justify="left")
        for column, header in enumerate(headers):
            are_figures = all(_is_figure(row[column]) for row in rows)
            table.add_column(header, justify="right" if are_figures else "left", overflow="fold")
        for row in rows:
            table.add_row(*(_cell(value) for value in row))
        self._out.print(table, soft_wrap=False)

    @contextlib.contextmanager
    def progress(self) -> Iterator[Update]:
        """A progress bar while the block runs; where stderr is no terminal, only the changes of its text."""
        if not self._err.is_terminal:
            yield self._plain_update()
            return
        text = TextColumn("{task.description}", markup=False)
        columns = (text, BarColumn(bar_width=24), TimeElapsedColumn())
        with Progress(*columns, console=self._err, transient=True) as bars:
            task = bars.add_task("", total=1.0)
            yield lambda text, share: bars.update(task, description=text, completed=share)

    def _plain_update(self) -> Update:
        last = ""

        def update(text: str, share: float) -> None:
            nonlocal last
            if text != last:
                self.note(text)
                last = text

        return update


def _is_figure(value: Any) -> bool:
    if isinstance(value, str):
        return value == "-" or value.lstrip("-")[:1].isdigit()
    return value is None or isinstance(value, int | float)


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)
