"""Path-traced irradiance of meshes and of primitive sets, by either path tracer; measured once and kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from fit.primitives import PrimitiveSet
from fit.scene import Camera, Float64, Scene
from pipelines.reference import mesh_reference, primitive_reference
from pipelines.reference.mitsuba import engine_notes, load_mitsuba
from pipelines.reference.store import cached, digest, estimate_arrays, estimate_of
from pipelines.reference.triangulate import triangulate
from pipelines.reference.truth import Picture
from pipelines.representation_floor import representation_floor
from runtime.device import Gpu
from runtime.estimate import Estimate
from runtime.lights import Illumination
from runtime.path_tracer import PathTracer
from runtime.sdfddgi import SdfddgiSettings
from runtime.world import World

Engine = Literal["reference", "reference-gpu"]

REVISION = 2
"""Raised when either path tracer measures something else than before, so that what was kept is forgotten."""

PROBES_OF_A_LOOKUP = 8
"""Probes that fill a floor need so many times fewer samples for the same noise."""

Progress = Callable[[float], None]


@dataclass(frozen=True)
class TruthSettings:
    """engine: Mitsuba, or the runtime's path tracer. samples: paths a point. noise: mean absolute noise, a
    share of the mean, at which to end before."""

    engine: Engine = "reference"
    samples: int = 256
    noise: float | None = None
    seed: int = 0


class Tracer(Protocol):
    """What both path tracers offer."""

    def irradiance(
        self,
        points: NDArray[np.floating],
        normals: NDArray[np.floating],
        *,
        samples: int,
        target: float | None,
        seed: int,
        progress: Progress | None,
    ) -> Estimate: ...


@dataclass(frozen=True)
class Truth:
    """The two path tracers under one light."""

    gpu: Gpu
    illumination: Illumination
    settings: TruthSettings

    def notes(self) -> tuple[str, ...]:
        """What to know of the path tracer itself.

        Raises:
            MissingMitsuba: it is asked for and not installed.
        """
        return engine_notes(load_mitsuba()) if self.settings.engine == "reference" else ()

    def of_mesh(
        self, scene: Scene, points: Float64, normals: Float64, progress: Progress | None = None
    ) -> Estimate:
        """Indirect E at points (n, 3) of a scene's mesh with normals (n, 3).

        Raises:
            MissingMitsuba: it is asked for and not installed.
            ValueError: the scene draws no triangle.
        """
        geometry = digest(replace(scene, source=Path()))
        return self._kept(lambda: self._mesh_tracer(scene), geometry, points, normals, progress)

    def picture(
        self, scene: Scene, camera: Camera, size: tuple[int, int], progress: Progress | None = None
    ) -> Picture:
        """What Mitsuba sees through a camera. Errors as `of_mesh`."""
        s = self.settings

        def measure() -> dict[str, NDArray[Any]]:
            picture = mesh_reference(scene, self.illumination).picture(
                camera, size, samples=s.samples, target=s.noise, seed=s.seed, progress=progress
            )
            notes = np.array(picture.notes, np.str_)
            return estimate_arrays(picture.beauty) | {"direct": picture.direct, "notes": notes}

        geometry = digest(replace(scene, source=Path()))
        parts = ("picture", REVISION, self._version(), geometry, self.illumination, camera, size, s)
        arrays, _ = cached(parts, measure)
        return Picture(estimate_of(arrays), arrays["direct"], tuple(arrays["notes"].tolist()))

    def of_primitives(
        self,
        primitives: PrimitiveSet,
        starts: Float64,
        normals: Float64,
        is_free: NDArray[np.bool_],
        progress: Progress | None = None,
    ) -> Estimate:
        """Indirect E through a set at free places (n, 3); 0 where there is none. Errors as `of_mesh`."""
        geometry = digest(replace(primitives, names=()))
        found = self._kept(
            lambda: self._set_tracer(primitives), geometry, starts[is_free], normals[is_free], progress
        )
        return spread(found, is_free)

    def floor(
        self,
        world: World,
        probes: SdfddgiSettings,
        points: Float64,
        normals: Float64,
        progress: Progress | None = None,
    ) -> Estimate:
        """What probes of these settings give at free points (n, 3) when this path tracer fills them: see
        `representation_floor`. Errors as `of_mesh`."""
        s = self.settings
        samples = max(s.samples // PROBES_OF_A_LOOKUP, 2)
        primitives = world.primitives
        geometry = digest(replace(primitives, names=()))
        parts = ("floor", REVISION, self._version(), geometry, self.illumination, probes, points, normals)

        def measure() -> dict[str, NDArray[Any]]:
            tracer = self._set_tracer(primitives)
            return estimate_arrays(
                representation_floor(
                    self.gpu,
                    world,
                    probes,
                    tracer,
                    points,
                    normals,
                    samples=samples,
                    seed=s.seed,
                    progress=progress,
                )
            )

        return estimate_of(cached((*parts, samples, s.seed), measure)[0])

    def _kept(
        self,
        make: Callable[[], Tracer],
        geometry: str,
        points: Float64,
        normals: Float64,
        progress: Progress | None,
    ) -> Estimate:
        s = self.settings
        parts = ("irradiance", REVISION, self._version(), geometry, self.illumination, points, normals, s)

        def measure() -> Estimate:
            return make().irradiance(
                points, normals, samples=s.samples, target=s.noise, seed=s.seed, progress=progress
            )

        return estimate_of(cached(parts, lambda: estimate_arrays(measure()))[0])

    def _version(self) -> str:
        """Of the engine: another one has other noise."""
        if self.settings.engine == "reference-gpu":
            return self.gpu.adapter_summary
        mi = load_mitsuba()
        return f"mitsuba {mi.__version__} {mi.variant()}"

    def _mesh_tracer(self, scene: Scene) -> Any:
        if self.settings.engine == "reference-gpu":
            return PathTracer(self.gpu, scene, self.illumination)
        return mesh_reference(scene, self.illumination)

    def _set_tracer(self, primitives: PrimitiveSet) -> Any:
        if self.settings.engine == "reference-gpu":
            return PathTracer(self.gpu, triangulate(primitives), self.illumination)
        return primitive_reference(primitives, self.illumination)


def spread(found: Estimate, mask: NDArray[np.bool_]) -> Estimate:
    """A measurement at the points of a mask (n,) as one at all of them; 0 elsewhere."""

    def rows(values: Float64) -> Float64:
        full = np.zeros((len(mask), *values.shape[1:]))
        full[mask] = values
        return full

    value, first, second = (rows(values) for values in (found.value, found.first, found.second))
    return Estimate(value, first, second, rows(found.standard_error), found.samples)
