"""One scene of `bench gi`: its views and their truths, and what a setting of light costs and gives there."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipelines.console import Update
from pipelines.matrix_sets import NamedSet
from pipelines.methods import find_method, sees_mesh
from pipelines.staging import Stage, StagedShot
from pipelines.studio import Studio
from pipelines.views import choose_view

if TYPE_CHECKING:
    from fit.primitives import PrimitiveSet
    from pipelines.bench_gi import GiBenchSettings
    from pipelines.gi_errors import Judge, SetTruth
    from runtime.renderer import Renderer

NOT_GI = ("primary/", "direct/", "composite/combine_light", "composite/tone_map")
"""Passes, or folders of passes, that a picture without indirect light has as well."""

LOOKUP = "composite/gather_irradiance"
"""The pass that asks the probes, for every pixel; all other passes of GI bring the probes up to date."""

NOISY = 0.1
"""Mean absolute noise of a truth, a share of its mean, above which relMSE is a matter of chance."""

WARM_UP = 8
"""Frames before the timed ones: shadow maps are drawn, and new probes take more rays than later."""

TRUTH_SHARE = 0.3
"""Share of a scene's progress bar that the truth of the mesh takes."""


@dataclass(frozen=True)
class Variant:
    """One setting of light; none of both numbers for a method without probes."""

    method: str
    max_probes: int | None = None
    rays_per_probe: int | None = None

    @property
    def options(self) -> dict[str, Any]:
        """Settings of the technique."""
        given = {"max_probes": self.max_probes, "rays_per_probe": self.rays_per_probe}
        return {key: value for key, value in given.items() if value is not None}

    @property
    def name(self) -> str:
        """In words."""
        if self.max_probes is None:
            return self.method
        return f"{self.method}, {self.max_probes} probes, {self.rays_per_probe} rays"


def variants(settings: GiBenchSettings, *, largest: bool) -> Iterator[Variant]:
    """What to light a set with. Methods that see the mesh itself, and none, only light the largest one."""
    for method in settings.methods:
        if sees_mesh(method) and not largest:
            continue
        for probes in settings.probes:
            for rays in settings.rays:
                yield Variant(method, probes, rays)
    if largest:
        yield Variant("none")


@dataclass(frozen=True)
class Shot:
    """A view: its camera's name, its studio, and its truth."""

    name: str
    studio: Studio
    judge: Judge

    def describe(self) -> dict[str, Any]:
        """A report's keys."""
        noise = {"mesh": self.judge.mesh.noise, "gray mesh": self.judge.mesh_gray.noise}
        points = len(self.judge.pixels.points)
        samples = self.judge.mesh.samples
        return self.studio.describe() | {"name": self.name, "noise": noise, "points": points} | {
            "samples": samples
        }  # fmt: skip


@dataclass(frozen=True)
class Lit:
    """A run's row for the report, and the indirect irradiance (h, w, 3) of each view."""

    row: dict[str, Any]
    irradiance: dict[str, NDArray[np.float32]]
    notes: tuple[str, ...]


def _noise_note(shot: Shot) -> str | None:
    noise = shot.judge.mesh.noise
    if noise <= NOISY:
        return None
    return (
        f"{shot.name}: {shot.judge.mesh.samples} paths a point leave {noise:.0%} of noise in the truth. It "
        "is subtracted from all errors, but relMSE divides by each point's own truth, noise and all: go by "
        "the ratios of means, or take more --samples"
    )


class SceneBench:
    """One scene in all its views; sets and ways to light it are held against it."""

    def __init__(self, settings: GiBenchSettings, stage: Stage, studio: Studio, update: Update) -> None:
        self.settings = settings
        share = TRUTH_SHARE / len(stage.shots)
        self.shots = [
            Shot(shot.name, each, _judge(settings, each, update, number * share, share))
            for number, (shot, each) in enumerate(_studios(stage, studio))
        ]

    def notes(self) -> list[str]:
        """What to know of the truth: which engine measured it, and where it is too noisy for relMSE."""
        return [*self.shots[0].judge.truth.notes(), *filter(None, map(_noise_note, self.shots))]

    def truths_of(self, primitives: PrimitiveSet, update: Update) -> dict[str, SetTruth]:
        """The path-traced set, in each view."""
        return {shot.name: shot.judge.truth_of(primitives, update) for shot in self.shots}

    def light(
        self, named: NamedSet, budget: int, truths: dict[str, SetTruth], variant: Variant, update: Update
    ) -> Lit:
        """Lights a set, judges every view, and times every pass."""
        renderer = self._renderer(self.settings.size, named.primitives, variant)
        irradiance = self._pictures(renderer, variant, update)
        timer = renderer
        if (size := self.settings.timed_size_on(self.shots[0].studio.gpu)) != self.settings.size:
            timer = self._renderer(size, named.primitives, variant)
        passes, wall_ms = self._times(timer, update)
        costs = self._costs(passes, wall_ms)
        views = {
            shot.name: _errors(shot.judge, truths[shot.name], irradiance[shot.name], variant)
            for shot in self.shots
        }
        key: dict[str, Any] = {"set": named.name, "primitives": len(named.primitives)}
        key |= {"max_primitives": budget, **asdict(variant), "timed_size": size}
        key |= {"cullings_ms": self._cullings(named.primitives, variant, size, costs["gi_ms"], update)}
        row = key | costs | _figures(views) | {"passes_ms": passes, "wall_ms": wall_ms, "views": views}
        return Lit(row, irradiance, renderer.notes())

    def _costs(self, passes: dict[str, float | None], wall_ms: float) -> dict[str, float | None]:
        return pass_costs(passes, wall_ms if self.shots[0].studio.gpu.is_software else None)

    def _cullings(
        self,
        primitives: PrimitiveSet,
        variant: Variant,
        size: tuple[int, int],
        first_ms: float | None,
        update: Update,
    ) -> dict[str, float | None]:
        """Milliseconds of GI by every way to find the nearest primitive; those of the first are known. What
        sees the mesh, or nothing, has one way alone."""
        first, *others = self.settings.cullings
        found = {first: first_ms}
        if variant.method == "none" or sees_mesh(variant.method):
            return found
        for culling in others:
            timer = self._renderer(size, primitives, variant, culling)
            found[culling] = self._costs(*self._times(timer, update))["gi_ms"]
        return found

    def _renderer(
        self, size: tuple[int, int], primitives: PrimitiveSet, variant: Variant, culling: str | None = None
    ) -> Renderer:
        from runtime.renderer import Renderer

        studio = replace(self.shots[0].studio, size=size)
        culling = culling or self.settings.cullings[0]
        settings = studio.settings(variant.method, primitives, culling=culling, **variant.options)
        return Renderer(studio.gpu, studio.scene, primitives, settings, studio.illumination)

    def _pictures(
        self, renderer: Renderer, variant: Variant, update: Update
    ) -> dict[str, NDArray[np.float32]]:
        """Settled light. It is the same for every camera, except where the probes follow the camera."""
        follows = "cascades" in find_method(variant.method).options
        frames = 1 if variant.method == "none" else self.settings.frames
        found = {}
        for number, shot in enumerate(self.shots):
            settle = frames - 1 if number == 0 or follows else 0
            result = renderer.render(
                shot.studio.view.camera,
                settle=settle,
                only=("irradiance",),
                progress=lambda done, count: update("light", 0.7 * done / count),
            )
            found[shot.name] = result.images["irradiance"]
        return found

    def _times(self, renderer: Renderer, update: Update) -> tuple[dict[str, float | None], float]:
        """GPU ms of the passes of every frame: medians, then the mean over the views; and, by the clock on
        the wall, mean ms of a frame that is waited for."""
        renderer.render(self.shots[0].studio.view.camera, settle=WARM_UP)
        update("time", 0.8)
        found, seconds = [], 0.0
        for shot in self.shots:
            renderer.render(shot.studio.view.camera)
            began = time.perf_counter()
            timed = renderer.render(frames=self.settings.timed_frames, only=())
            seconds += time.perf_counter() - began
            found.append(timed.timings)
        passes = {name: _mean([timings.get(name) for timings in found]) for name in found[0]}
        return passes, 1000 * seconds / (self.settings.timed_frames * len(found))


def _studios(stage: Stage, studio: Studio) -> Iterator[tuple[StagedShot, Studio]]:
    """The studio with each camera that was asked for, else with its own."""
    width, height = studio.size
    for shot in stage.shots:
        view = studio.view if shot.camera is None else choose_view(shot.camera, studio.scene, width / height)
        yield shot, replace(studio, view=view, exposure=shot.exposure)


def _judge(settings: GiBenchSettings, studio: Studio, update: Update, start: float, share: float) -> Judge:
    from pipelines.gi_errors import Judge

    return Judge.of(studio, settings.truth, lambda text, part: update(text, start + share * part))


def _errors(
    judge: Judge, truth: SetTruth, irradiance: NDArray[np.float32], variant: Variant
) -> dict[str, Any]:
    """Solver and total error. A method that sees the mesh has no fit between: its solver's is the total."""
    errors = judge.errors(truth, irradiance)
    solver = errors.total if sees_mesh(variant.method) else errors.solver
    fit = None if sees_mesh(variant.method) else errors.fit
    return {
        "fit": None if fit is None else _short(fit),
        "solver": asdict(solver),
        "total": asdict(errors.total),
    }


def _short(error: Any) -> dict[str, Any]:
    """Without the regions: a set's own rows have them."""
    found = asdict(error)
    del found["regions"]
    return found


def pass_costs(passes: dict[str, float | None], wall_ms: float | None) -> dict[str, float | None]:
    """Milliseconds of GI, whole and in its two parts, and of the frame; None where the adapter tells none.

    wall_ms: of a software adapter's frame. Mesa's llvmpipe writes the time stamp before a compute pass after
    it where nothing was rastered yet, so what no later pass took is the update's.
    """
    names = ("gi_ms", "update_ms", "lookup_ms", "frame_ms")
    known = {name: value for name, value in passes.items() if value is not None}
    if len(known) < len(passes):
        return dict.fromkeys(names)
    updates = [known[name] for name in known if name != LOOKUP and not name.startswith(NOT_GI)]
    lookup, frame, update = known.get(LOOKUP, 0.0), sum(known.values()), sum(updates)
    if wall_ms is not None:
        update = max(wall_ms - (frame - update), update) if updates else 0.0
        frame = wall_ms
    return dict(zip(names, (update + lookup, update, lookup, frame), strict=True))


def _figures(views: dict[str, dict[str, Any]]) -> dict[str, float | None]:
    """Means over the views: ratios of means, relMSE whole and trimmed, FLIP and the bias."""

    def ratios(kind: str) -> list[float | None]:
        return [None if view[kind] is None else view[kind]["irradiance"]["ratio"] for view in views.values()]

    totals = [view["total"] for view in views.values()]
    return {
        **{kind: _mean(ratios(kind)) for kind in ("fit", "solver", "total")},
        "total_rel_mse": _mean([total["irradiance"]["rel_mse"] for total in totals]),
        "total_trimmed": _mean([total["irradiance"]["trimmed"] for total in totals]),
        "flip": _mean([total["flip"] for total in totals]),
        "bias": _mean([total["bias"] for total in totals]),
    }


def _mean(values: list[float | None] | list[float]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if len(known) == len(values) and np.isfinite(known).all() else None
