"""Which pictures each figure is made of: counterparts of those of Hu et al., SDFDDGI, by their numbers."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Literal

from pipelines.bundled import bundled_file
from pipelines.studio import Contact, LightingOptions
from runtime.probes import ProbeGrid

TRUTH: Literal["reference-gpu"] = "reference-gpu"
"""Lights a panel by path tracing the mesh with the runtime: nothing has to be installed for it."""


COARSE, FINE = 12, 96
"""Primitives of Figure 14's sets, at most."""


@dataclass(frozen=True)
class Subject:
    """What is shown. primitives: the file of its set, or None: a fit of at most `budget`. exposure: stops."""

    scene: Path
    primitives: Path | None
    lighting: LightingOptions
    camera: str | None = None
    exposure: float = 0.0
    budget: int | None = None


@dataclass(frozen=True)
class Panel:
    """One picture. gi: a method of `render`, or `TRUTH`; view: as for `render`; probes: as `--probes` takes
    them; grid: exactly these probes; stops: of exposure, on top of the subject's."""

    tag: str
    subject: Subject
    gi: str = "sdfddgi"
    view: str = "final"
    probes: str | None = None
    grid: ProbeGrid | None = None
    contact: Contact = "off"
    stops: float = 0.0


@dataclass(frozen=True)
class Figure:
    """A counterpart; missing: why there is no picture, where a file has to be given."""

    number: int
    panels: tuple[Panel, ...] = ()
    missing: str | None = None

    def words(self) -> dict[str, str]:
        """title; caption: what the paper shows, and what stands here; wrong: what is visibly wrong."""
        return _captions()[str(self.number)]


def _captions() -> dict[str, dict[str, str]]:
    text = resources.files("pipelines.figures").joinpath("captions.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def stage(name: str, camera: str | None = None, sky: str = "0,0,0") -> Subject:
    """A bundled stage in its own lights, under the sky that it was made for, or else the given one."""
    skies = tomllib.loads(bundled_file("stages.toml").read_text(encoding="utf-8"))
    sky = skies.get(name, {"sky": sky})["sky"]
    lighting = LightingOptions(sky=sky, keep_file_lights=True)
    return Subject(bundled_file(f"{name}.glb"), bundled_file(f"{name}.npz"), lighting, camera)


def catalogue(atrium: Subject | None, model: Subject | None) -> tuple[Figure, ...]:
    """Every figure with a counterpart, in the paper's order.

    atrium: the large scene, the paper's Sponza; None takes the small one that comes with the program.
    model: the body of Figure 14, the paper's dragon.
    """
    large = atrium or replace(stage("curtains", "court"), exposure=-1.0)
    room, two = replace(stage("cornell"), exposure=-0.5), stage("two_probe_room")
    sealed, walk = stage("dark_room", sky="1,1,1"), stage("curtains", "walk")
    corner = replace(room, camera="-0.2,0.55,0.55,-1,0,-0.9,60")
    return (
        Figure(1, (Panel("off", large, "none"), Panel("on", large), Panel("path traced", large, TRUTH))),
        Figure(4, (Panel("mesh", large, "none", "mesh"), Panel("primitives", large, "none", "primitives"))),
        Figure(
            7,
            tuple(
                Panel(f"{name}, probes {spacing} m apart", sealed, gi, probes=spacing, stops=2)
                for gi, name in (("sdfddgi", "SDFDDGI"), ("ddgi", "DDGI"))
                for spacing in ("1.5", "0.5")
            ),
        ),
        Figure(
            9,
            (
                Panel("probes alone", corner, view="indirect"),
                Panel("contact light as printed", corner, view="indirect", contact="paper"),
                Panel("contact light", corner, view="indirect", contact="on"),
                Panel("path traced", corner, TRUTH, "indirect"),
            ),
        ),
        Figure(
            11,
            (
                Panel("2 x 1 x 1 probes", two, grid=ProbeGrid((-1.0, 1.1, 0.0), 2.0, (2, 1, 1))),
                Panel("4 x 2 x 3", two, grid=ProbeGrid((-1.5, 0.6, -1.0), 1.0, (4, 2, 3))),
                Panel("9 x 5 x 7", two, grid=ProbeGrid((-1.8, 0.2, -1.35), 0.45, (9, 5, 7))),
                Panel("path traced", two, TRUTH),
            ),
        ),
        Figure(
            12,
            (
                Panel("room, without", room),
                Panel("room, with", room, contact="on"),
                Panel("atrium, without", large),
                Panel("atrium, with", large, contact="on"),
            ),
        ),
        Figure(
            13,
            (
                Panel("SDFDDGI", walk, view="irradiance", probes="1.2", stops=-1),
                Panel("DDGI", walk, "ddgi", "irradiance", "1.2", stops=-1),
                Panel("path traced", walk, TRUTH, "irradiance", stops=-1),
            ),
        ),
        Figure(14, missing="needs a body: give --model, such as the Stanford dragon as .glb")
        if model is None
        else Figure(14, _coarse_and_fine(model)),
    )


def _coarse_and_fine(model: Subject) -> tuple[Panel, ...]:
    panels: list[Panel] = []
    for name, budget in (("coarse", COARSE), ("fine", FINE)):
        subject = replace(model, budget=budget)
        panels.append(Panel(f"{name}: at most {budget}", subject, "none", "primitives"))
        panels.append(Panel(f"lit through the {name} set", subject, probes="6x5x3"))
    return tuple(panels)
