"""What `bench gi` keeps of a scene: the rows of its report, and the pictures that deserve to be shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from pipelines.bench_gi_summary import SETTING
from pipelines.console import Update
from pipelines.matrix_sets import NamedSet

if TYPE_CHECKING:
    from pipelines.bench_gi_scene import SceneBench, Variant
    from pipelines.gi_errors import SetTruth

Row = Mapping[str, Any]

KINDS = ("mesh", "primitives", "ours", "fit-flip", "solver-flip", "total-flip")
"""Pictures of a run: see `Judge.pictures`."""


@dataclass
class Results:
    """Fills a scene's rows and keeps its pictures by name."""

    scene: dict[str, Any]
    bench: SceneBench
    pictures: dict[str, Any]
    truths: dict[str, SetTruth] = field(default_factory=dict)

    def add_set(self, named: NamedSet, update: Update) -> None:
        """Path traces a set in every view."""
        self.truths = self.bench.truths_of(named.primitives, update)
        views = {}
        for name, truth in self.truths.items():
            errors = {key: asdict(getattr(truth, key)) for key in ("fit", "geometry", "material")}
            noise = {"primitives": truth.lit.noise, "gray primitives": truth.gray.noise}
            views[name] = errors | {"noise": noise, "unplaced": float(1 - truth.is_free.mean())}
        self.scene["sets"].append({"name": named.name} | named.about | {"views": views})

    def add_run(self, named: NamedSet, budget: int, variant: Variant, update: Update) -> None:
        """Lights the set that was added last, and keeps row and pictures."""
        lit = self.bench.light(named, budget, self.truths, variant, update)
        self.scene["runs"].append(lit.row)
        self.scene["notes"] = list(dict.fromkeys((*self.scene["notes"], *lit.notes)))
        for shot in self.bench.shots:
            found = shot.judge.pictures(self.truths[shot.name], lit.irradiance[shot.name])
            for kind, pixels in found.items():
                self.pictures[picture_name(self.scene, lit.row, shot.name, kind)] = pixels


def picture_name(scene: Row, run: Row, view: str, kind: str) -> str:
    """Of a run's picture; of the mesh and the set, which runs share, too. kind: see `Judge.pictures`."""
    if kind == "mesh":
        return f"{scene['name']}, {view}, mesh"
    if kind in ("primitives", "fit-flip"):
        return f"{scene['name']}, {view}, {run['set']}, {kind}"
    parts = (scene["name"], view, run["set"], run["method"], run["max_probes"], run["rays_per_probe"], kind)
    return ", ".join(str(part) for part in parts if part is not None)


def shown_runs(scene: Row, chosen: Mapping[str, Row]) -> list[Row]:
    """A scene's runs that deserve a picture: those of the presets, and the best of each method."""
    keys = [tuple(row[key] for key in SETTING) for row in chosen.values()]
    runs = scene["runs"]
    for method in dict.fromkeys(run["method"] for run in runs):
        own = [run for run in runs if run["method"] == method and run["total"] is not None]
        keys += [tuple(min(own, key=lambda run: run["total"])[key] for key in SETTING)] if own else []
    by_key = {tuple(run[key] for key in SETTING): run for run in runs}
    return [by_key[key] for key in dict.fromkeys(keys)]


def shown_pictures(
    scenes: Sequence[Row],
    chosen: Mapping[str, Row],
    pictures: Mapping[str, Any],
) -> dict[str, Any]:
    """The pictures of those runs."""
    names = [
        picture_name(scene, run, view["name"], kind)
        for scene in scenes
        for run in shown_runs(scene, chosen)
        for view in scene["views"]
        for kind in KINDS
    ]
    return {name: pictures[name] for name in dict.fromkeys(names)}
