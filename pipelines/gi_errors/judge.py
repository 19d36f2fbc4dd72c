"""The three errors of a lit picture: of the fit, of the solver, and both together.

    judge = Judge.of(studio, TruthSettings(samples=256))
    truth = judge.truth_of(primitives)
    errors = judge.errors(truth, result.images["irradiance"])

The fit error is of path-traced primitives against the path-traced mesh; the solver error is ours against the
path-traced primitives; the total error is ours against the path-traced mesh. All are of indirect irradiance
at the mesh's G-buffer points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.primitives import PrimitiveSet
from fit.scene import Float64
from pipelines.console import Update
from pipelines.difference import RelativeError, flip, psnr, relative_error, relative_square
from pipelines.gi_errors.pixels import Pixels, UInt8
from pipelines.gi_errors.regions import Region, by_region
from pipelines.gi_errors.truth import Truth, TruthSettings, spread
from pipelines.reference.gray import gray_scene, gray_set
from pipelines.studio import Studio
from runtime.estimate import Estimate
from runtime.sdfddgi import SdfddgiSettings
from runtime.starts import find_starts
from runtime.world import World

Halves = tuple[Float64, Float64]


@dataclass(frozen=True)
class Error:
    """How far irradiance is from its reference.

    bias: of the mean, as a share of the reference's; None where that is black. flip, psnr (dB): of the
    pictures that the irradiance makes; their floors are those of the reference's two halves.
    """

    irradiance: RelativeError
    bias: float | None
    regions: dict[str, Region]
    flip: float
    flip_floor: float
    psnr: float
    psnr_floor: float


@dataclass(frozen=True)
class GiErrors:
    """The errors of one picture through one set.

    geometry: the fit error with albedo 0.5 everywhere. material: of what the fit's error at each point
    differs from that one's. floor: of the best that the probes could hold, against the primitives. noise:
    mean absolute noise of each reference, a share of its mean. unplaced: share of points from which no free
    place is found among the primitives; they count as black.
    """

    fit: Error
    geometry: Error
    material: RelativeError
    solver: Error
    total: Error
    floor: Error | None
    noise: dict[str, float]
    samples: dict[str, int]
    points: int
    unplaced: float


@dataclass(frozen=True)
class SetTruth:
    """Path-traced irradiance through a set, at the mesh's points, in its colours and in gray, and the fit
    error that follows from it: see `GiErrors`."""

    primitives: PrimitiveSet
    starts: Float64
    is_free: NDArray[np.bool_]
    lit: Estimate
    gray: Estimate
    fit: Error
    geometry: Error
    material: RelativeError


@dataclass(frozen=True)
class Judge:
    """One view of one scene, path traced; sets and techniques are held against it."""

    studio: Studio
    truth: Truth
    pixels: Pixels
    mesh: Estimate
    mesh_gray: Estimate

    @staticmethod
    def of(studio: Studio, settings: TruthSettings | None = None, progress: Update | None = None) -> Judge:
        """Path traces the mesh, or takes what was kept.

        Raises:
            MissingMitsuba: the engine is Mitsuba and it is not installed.
            ValueError: the camera sees nothing.
        """
        truth = Truth(studio.gpu, studio.illumination, settings or TruthSettings())
        pixels = Pixels.of(studio)
        scene, where = studio.scene, (pixels.points, pixels.normals)
        mesh = truth.of_mesh(scene, *where, _part(progress, "path trace the mesh", 0.0))
        gray = truth.of_mesh(gray_scene(scene), *where, _part(progress, "path trace the gray mesh", 0.5))
        return Judge(studio, truth, pixels, mesh, gray)

    def truth_of(self, primitives: PrimitiveSet, progress: Update | None = None) -> SetTruth:
        """Path traces a set from where the runtime would look, or takes what was kept."""
        pixels = self.pixels
        world = World(self.studio.gpu, self.studio.scene, primitives)
        starts, is_free = find_starts(
            self.studio.gpu, world, pixels.points, pixels.normals, pixels.towards_viewer
        )
        where = (starts, pixels.normals, is_free)
        lit = self.truth.of_primitives(primitives, *where, _part(progress, "path trace the set", 0.0))
        gray = self.truth.of_primitives(
            gray_set(primitives), *where, _part(progress, "path trace the gray set", 0.5)
        )
        fit, geometry = self.error(lit, self.mesh), self.error(gray, self.mesh_gray)
        material = self._material(lit, gray)
        return SetTruth(primitives, starts, is_free, lit, gray, fit, geometry, material)

    def floor_of(self, truth: SetTruth, probes: SdfddgiSettings, progress: Update | None = None) -> Estimate:
        """Irradiance at the points from such probes, were they filled by the path tracer: what no solver on
        the same grid can beat."""
        free = truth.is_free
        world = World(self.studio.gpu, self.studio.scene, truth.primitives)
        bar = None if progress is None else lambda share: progress("fill the probes by path tracing", share)
        found = self.truth.floor(world, probes, truth.starts[free], self.pixels.normals[free], bar)
        return spread(found, free)

    def errors(
        self,
        truth: SetTruth,
        irradiance: NDArray[np.floating],
        floor: Estimate | NDArray[np.floating] | None = None,
    ) -> GiErrors:
        """Of a picture's indirect irradiance (h, w, 3) through that set.

        floor: see `floor_of`; or irradiance (n, 3) at the points.
        """
        ours = self.pixels.rows(irradiance)
        references = {
            "mesh": self.mesh,
            "gray mesh": self.mesh_gray,
            "primitives": truth.lit,
            "gray primitives": truth.gray,
        }
        return GiErrors(
            fit=truth.fit,
            geometry=truth.geometry,
            material=truth.material,
            solver=self.error(ours, truth.lit),
            total=self.error(ours, self.mesh),
            floor=None if floor is None else self.error(floor, truth.lit),
            noise={name: estimate.noise for name, estimate in references.items()},
            samples={name: estimate.samples for name, estimate in references.items()},
            points=len(ours),
            unplaced=float(1 - truth.is_free.mean()),
        )

    def error(self, found: Estimate | NDArray[np.floating], reference: Estimate) -> Error:
        """Of irradiance (n, 3) at the points; its own noise is taken out where it is a measurement."""
        x, a = _halves(found), (reference.first, reference.second)
        value, truth = (x[0] + x[1]) / 2, reference.value
        shown, pixels = self.pixels.shown, self.pixels
        pictures = [pixels.display(rows) for rows in (truth, value, *a)]
        level = float(truth.mean())
        return Error(
            irradiance=relative_error(x, a),
            bias=float(value.mean()) / level - 1 if level > 0 else None,
            regions=by_region(pixels, x, a),
            flip=flip(pictures[0], pictures[1])[0],
            flip_floor=flip(pictures[2], pictures[3])[0],
            psnr=psnr(pictures[0], pictures[1], shown),
            psnr_floor=psnr(pictures[2], pictures[3], shown),
        )

    def pictures(self, truth: SetTruth, irradiance: NDArray[np.floating]) -> dict[str, UInt8]:
        """Ours, the path-traced set and mesh, and the FLIP maps of the three errors, sRGB (h, w, 3)."""
        display = self.pixels.display
        ours, primitives, mesh = (
            display(rows) for rows in (self.pixels.rows(irradiance), truth.lit.value, self.mesh.value)
        )
        return {
            "ours": ours,
            "primitives": primitives,
            "mesh": mesh,
            "fit-flip": flip(mesh, primitives)[1],
            "solver-flip": flip(primitives, ours)[1],
            "total-flip": flip(mesh, ours)[1],
        }

    def _material(self, lit: Estimate, gray: Estimate) -> RelativeError:
        (p, q), (m, n) = _halves(lit), _halves(self.mesh)
        (p_gray, q_gray), (m_gray, n_gray) = _halves(gray), _halves(self.mesh_gray)
        return relative_square(((p - m) - (p_gray - m_gray), (q - n) - (q_gray - n_gray)), (m, n))


def _halves(found: Estimate | NDArray[np.floating]) -> Halves:
    if isinstance(found, Estimate):
        return found.first, found.second
    values = np.asarray(found, np.float64)
    return values, values


def _part(progress: Update | None, text: str, start: float) -> Callable[[float], None] | None:
    """Half of a progress bar."""
    if progress is None:
        return None
    return lambda share: progress(text, start + share / 2)
