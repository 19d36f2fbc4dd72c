"""`figures.html`: every figure with its caption, its pictures, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pipelines.report.elements import facts, machine_fact, page, version_fact
from pipelines.report.pictures import data_uri, single


def build_page(report: Mapping[str, Any], folder: Path) -> str:
    """The whole page; the pictures are read from `folder` and put into it."""
    width, height = report["size"] if "size" in report else report["settings"]["size"]
    shown = facts(
        (
            ("Adapter", report.get("adapter", "none")),
            machine_fact(report),
            ("Pictures", f"{width} x {height}, {report['settings']['frames']} frames"),
            ("Path tracing", f"{report['settings']['samples']} paths a pixel"),
            version_fact(report),
        )
    )
    head = (
        "<h1>SDFDDGI: the paper's figures, and ours</h1>"
        "<p>Counterparts of figures of Hu et al., Efficient real-time dynamic diffuse global illumination "
        f"using signed distance fields, made by this program.</p>{shown}"
    )
    return page("SDFDDGI: figures", [head, *(_figure(figure, folder) for figure in report["figures"])])


def _figure(figure: Mapping[str, Any], folder: Path) -> str:
    pictures = "".join(
        single(data_uri(_pixels(folder / panel["picture"]), 92), _tag(panel)) for panel in figure["panels"]
    )
    missing = f'<p class="note">Not made: {escape(figure["missing"])}.</p>' if figure["missing"] else ""
    wrong = f"<p><b>What is wrong:</b> {escape(figure['wrong'])}</p>" if figure["wrong"] else ""
    return (
        f"<h2>Figure {figure['number']}: {escape(figure['title'])}</h2><p>{escape(figure['caption'])}</p>"
        f'{missing}<div class="row">{pictures}</div>{wrong}'
    )


def _tag(panel: Mapping[str, Any]) -> str:
    count = panel["primitives"]
    return panel["tag"] + ("" if count is None else f"; {count} primitives")


def _pixels(file: Path) -> Any:
    with Image.open(file) as image:
        return np.asarray(image.convert("RGB"))
