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
from pipelines.reference.mitsuba import load_mitsuba
from pipelines.reference.store import cached, digest, estimate_arrays, estimate_of
from pipelines.reference.triangulate import triangulate
from pipelines.reference.truth import Picture
from runtime.device import Gpu
from runtime.estimate import Estimate
from runtime.lights import Illumination
from runtime.path_tracer import PathTracer

Engine = Literal["reference", "reference-gpu"]

REVISION = 1
"""Raised when either path tracer measures something else than before, so that what was kept is forgotten."""

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
        return Estimate(
            _spread(found.value, is_free),
            _spread(found.first, is_free),
            _spread(found.second, is_free),
            _spread(found.standard_error, is_free),
            found.samples,
        )

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


def _spread(values: Float64, mask: NDArray[np.bool_]) -> Float64:
    rows = np.zeros((len(mask), *values.shape[1:]))
    rows[mask] = values
    return rows
