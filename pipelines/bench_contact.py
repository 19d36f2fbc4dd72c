"""`sdfprim bench contact`: contact light's ambient occlusion against rays, over its settings.

Each setting is changed alone, the others as they are by default; what the walk on the screen calls open is
compared with what rays among the triangles find, over the same radius with the same falloff. With a set, the
irradiance that comes of it is compared with path tracing, too: that is what a radius is chosen by.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipelines.bundled import bundled_file
from pipelines.console import Terminal, Update
from pipelines.convert import make_folder, require_file
from pipelines.difference import relative_error, twice
from pipelines.documents import report_header, write_json
from pipelines.errors import UsageError
from pipelines.studio import AS_IN_THE_FILE, LightingOptions, Studio

if TYPE_CHECKING:
    from runtime.contact_settings import ContactSettings
    from runtime.estimate import Estimate

BUNDLED = ("atrium.glb", "two_rooms.glb")

VARIATIONS: dict[str, tuple[Any, ...]] = {
    "radius_share": (0.015, 0.06),
    "falloff": (0.15, 0.6, 1.0),
    "thickness": (0.1, 0.3, 4.0),
    "step_exponent": (1.0, 2.0, 3.0),
    "steps": (3, 12),
    "slices": (2,),
    "scale": (1, 2),
}
"""What is tried beside the defaults."""

FRAMES = 32
"""Whole frames until contact light has settled."""

SETTLE = 64
"""Frames before them that only bring the probes' light up to date."""

NEAR = 0.9
"""Pixels that are less open than this are near to something: there irradiance is judged."""


@dataclass(frozen=True)
class ContactBenchSettings:
    """What `bench contact` was asked for. files: scenes, or none for those that come with the program; set:
    of the one scene; samples: rays, and paths, for each point of the truth; size: pixels."""

    files: tuple[Path, ...]
    output: Path
    primitives: Path | None = None
    camera: str | None = None
    lighting: LightingOptions = AS_IN_THE_FILE
    size: tuple[int, int] = (320, 180)
    samples: int = 256
    frames: int = FRAMES
    seed: int = 0


def run(settings: ContactBenchSettings, update: Update) -> dict[str, Any]:
    """Measures every scene under every variation and writes report.json.

    Raises:
        UsageError: a file or camera is not there, or the options make no sense.
        NoAdapter: there is no GPU.
        ValueError: a file can't be read; the message says which and why.
    """
    from fit import gltf

    check(settings)
    files = settings.files or tuple(map(bundled_file, BUNDLED))
    report = report_header("bench contact", settings, settings.seed) | {"rows": []}
    for number, file in enumerate(files):
        scene = gltf.load(file)
        studio = Studio.set_up(scene, settings.camera, settings.lighting, settings.size, 0.0)
        report |= {"adapter": studio.gpu.adapter_summary}
        bench = _SceneBench(settings, studio)
        tried = list(variations(settings.seed))
        for step, (name, contact) in enumerate(tried):
            update(f"{file.stem}: {name}", (number + step / len(tried)) / len(files))
            report["rows"].append({"scene": file.stem, "changed": name} | bench.measure(contact))
            write_json(settings.output / "report.json", report)
    return report


def check(settings: ContactBenchSettings) -> None:
    """Raises UsageError for what can be seen to be wrong before any work is done, and makes the folder."""
    for file in (*settings.files, *([settings.primitives] if settings.primitives else [])):
        require_file(file)
    if settings.primitives is not None and len(settings.files) != 1:
        raise UsageError("--set: a set is of one scene; name that scene")
    if settings.samples < 2 or settings.frames < 1:
        raise UsageError("--samples, --frames: give at least 2 samples and 1 frame")
    settings.lighting.check()
    make_folder(settings.output)


def variations(seed: int = 0) -> Iterator[tuple[str, ContactSettings]]:
    """The defaults, and each setting changed alone; a name for each."""
    from runtime.contact_settings import ContactForm, ContactSettings

    defaults = ContactSettings(seed=seed)
    yield "defaults", defaults
    for name, values in VARIATIONS.items():
        for value in values:
            if value != getattr(defaults, name):
                yield f"{name} {value}", replace(defaults, **{name: value})
    yield "as printed", replace(defaults, form=ContactForm.PRINTED)


class _SceneBench:
    """One view of one scene; its truths are traced once."""

    def __init__(self, settings: ContactBenchSettings, studio: Studio) -> None:
        from fit import export
        from pipelines.gi_errors.pixels import Pixels
        from runtime.path_tracer import PathTracer

        self.settings, self.studio = settings, studio
        self.primitives = None if settings.primitives is None else export.read(settings.primitives)
        self.pixels = Pixels.of(studio)
        self.tracer = PathTracer(studio.gpu, studio.scene, studio.illumination)
        self._open: dict[tuple[float, float], NDArray[np.float64]] = {}
        self._lit: tuple[Estimate, NDArray[np.float64]] | None = None

    def measure(self, contact: ContactSettings) -> dict[str, Any]:
        """Errors of what is open and, with a set, of the irradiance near to things."""
        images = self._draw(contact)
        shown = self.pixels.shown
        rays = np.ones(shown.shape)
        rays[shown] = self._rays(contact)
        scale = contact.scale_of(self.settings.size)
        texels = np.s_[::scale, ::scale]
        seen = images["contact/ao"][..., 0]
        row = compare_openness(seen[shown[texels]], rays[texels][shown[texels]])
        if self.primitives is None:
            return row
        near = rays[shown] < NEAR
        truth, without = self._paths()

        def error(irradiance: NDArray[np.floating]) -> float:
            halves = (truth.first[near], truth.second[near])
            return relative_error(twice(irradiance[near]), halves).rel_mse

        return row | {
            "near": float(near.mean()),
            "rel_mse": error(self.pixels.rows(images["irradiance"])),
            "rel_mse_without": error(without),
            "rel_mse_occluded": error(without * rays[shown][:, None]),
        }

    def _draw(self, contact: ContactSettings | None) -> Mapping[str, NDArray[np.float32]]:
        """The last frame's views."""
        from fit.primitives import PrimitiveSet
        from runtime.renderer import Renderer

        s, studio = self.settings, self.studio
        primitives = PrimitiveSet.empty() if self.primitives is None else self.primitives
        gi = "none" if self.primitives is None else "sdfddgi"
        drawn = replace(studio.settings(gi, primitives), contact=contact)
        renderer = Renderer(studio.gpu, studio.scene, primitives, drawn, studio.illumination)
        views = ("irradiance",) if contact is None else ("irradiance", "contact/ao")
        settle = 0 if self.primitives is None else SETTLE
        return renderer.render(studio.view.camera, frames=s.frames, settle=settle, only=views).images

    def _rays(self, contact: ContactSettings) -> NDArray[np.float64]:
        """What rays find open, of every point."""
        s, pixels = self.settings, self.pixels
        radius = contact.radius_within(self.studio.scene)
        key = (radius, contact.falloff)
        if key not in self._open:
            self._open[key] = self.tracer.openness(
                pixels.points, pixels.normals, *key, samples=s.samples, seed=s.seed
            )
        return self._open[key]

    def _paths(self) -> tuple[Estimate, NDArray[np.float64]]:
        """Path-traced irradiance of every point, and that of the probes alone."""
        if self._lit is None:
            s, pixels = self.settings, self.pixels
            truth = self.tracer.irradiance(pixels.points, pixels.normals, samples=s.samples, seed=s.seed)
            self._lit = truth, pixels.rows(self._draw(None)["irradiance"])
        return self._lit


def compare_openness(seen: NDArray[np.floating], rays: NDArray[np.floating]) -> dict[str, float]:
    """Of openness (n,): the mean by rays, its deviation, how far what was seen is from it (RMS, bias), and
    the power of what was seen that would be nearest to it: 1 where the integral is right."""
    difference = seen - rays
    powers = np.linspace(0.5, 2.0, 61)
    errors = [np.mean((np.clip(seen, 0, 1) ** power - rays) ** 2) for power in powers]
    return {
        "open": float(rays.mean()),
        "deviation": float(rays.std()),
        "rms": float(np.sqrt(np.mean(difference**2))),
        "bias": float(difference.mean()),
        "best_power": float(powers[int(np.argmin(errors))]),
    }


def show(report: dict[str, Any], settings: ContactBenchSettings, terminal: Terminal) -> None:
    """One table of all rows."""
    headers = {
        "scene": "scene",
        "changed": "setting",
        "open": "open, by rays",
        "deviation": "its deviation",
        "rms": "RMS error",
        "bias": "bias",
        "best_power": "best power",
    }
    if settings.primitives is not None:
        headers |= {"rel_mse": "relMSE near", "rel_mse_without": "without", "rel_mse_occluded": "AO alone"}
    rows = [
        [f"{row[key]:.4f}" if isinstance(row[key], float) else row[key] for key in headers]
        for row in report["rows"]
    ]
    terminal.table(list(headers.values()), rows)
    terminal.line(f"wrote    {settings.output / 'report.json'}")
