"""What every report page is made of: the page itself, tables, tiles, facts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import resources
from string import Template
from typing import Any

from pipelines.report.plots import short_number


def page(title: str, sections: Iterable[str]) -> str:
    """A whole HTML page that needs nothing but itself."""
    text = resources.files("pipelines.report").joinpath("template.html").read_text(encoding="utf-8")
    return Template(text).substitute(title=escape(title), body="\n".join(sections))


def facts(pairs: Iterable[tuple[str, object]]) -> str:
    """A line of labelled facts."""
    items = "".join(f"<li><b>{escape(label)}</b> {escape(str(text))}</li>" for label, text in pairs)
    return f'<ul class="facts">{items}</ul>'


def version_fact(report: Mapping[str, Any]) -> tuple[str, str]:
    """Which program made a report, with which seed, when."""
    return ("Version", f"sdfprim {report['version']}, seed {report['seed']}, {report['created']}")


def machine_fact(report: Mapping[str, Any]) -> tuple[str, str]:
    """Where a report was made."""
    machine = report["machine"]
    return ("Machine", f"{machine['processor']}, {machine['cores']} cores")


def tiles(pairs: Iterable[tuple[str, str]]) -> str:
    """Large figures with a caption each."""
    inner = "".join(
        f'<div class="tile"><strong>{escape(figure)}</strong><span>{escape(caption)}</span></div>'
        for figure, caption in pairs
    )
    return f'<div class="tiles">{inner}</div>'


def table(headers: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """First column is the label, the second a remark below it, the others numbers."""
    head = f"<th>{headers[0]}</th>" + "".join(f'<th class="number">{h}</th>' for h in headers[1:])
    lines = []
    for label, remark, *values in rows:
        small = f"<small>{escape(remark)}</small>" if remark else ""
        cells = "".join(f'<td class="number">{escape(value)}</td>' for value in values)
        lines.append(f"<tr><td>{escape(label)}{small}</td>{cells}</tr>")
    body = "".join(lines)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def spaces(found: Sequence[Mapping[str, Any]]) -> str:
    """The spaces that were taken as air."""
    items = "".join(f"<li>{escape(_space(space))}</li>" for space in found)
    return f"<ul>{items or '<li>nothing</li>'}</ul>"


def _space(space: Mapping[str, Any]) -> str:
    point = ", ".join(f"{value:.2f}" for value in space["point"])
    return f"{short_number(space['volume'])} m3 around ({point}): {space['evidence']}"
