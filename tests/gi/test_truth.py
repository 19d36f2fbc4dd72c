"""SDFDDGI by brute force against Mitsuba, on primitives that are the scene: no fit is in between.

What the probes cannot represent is measured by filling them with Mitsuba's irradiance; beside that, the
solver itself may add little.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from fit import gltf
from fit.export import read
from pipelines.difference import relative_error
from runtime.estimate import Estimate
from runtime.lights import choose_illumination
from runtime.probes import ProbeGrid
from runtime.sdfddgi import SdfddgiSettings
from runtime.world import World

AIR = {"cornell": ((-1.0, 0.0, -1.0), (1.0, 2.0, 1.0)), "two_rooms": ((-3.05, 0.0, -1.5), (3.05, 2.6, 1.5))}

EIGHTH = {"cornell": 0.25, "two_rooms": 0.375}
"""Metres: an eighth of the room."""

BRUTE_FORCE = {"fresh_factor": 1, "settling_history": 1.0, "settling_growth": 0.0, "softness": 1e-4}
"""Each frame stands for itself while the bounces come in; those after `settling_frames` are averaged."""


@dataclass(frozen=True)
class Measured:
    truth: Estimate
    floor: Estimate
    solver: tuple[np.ndarray, np.ndarray] | None

    def error(self, found: tuple[np.ndarray, np.ndarray]) -> float:
        return relative_error(found, (self.truth.first, self.truth.second)).rel_mse

    @property
    def floor_error(self) -> float:
        return self.error((self.floor.first, self.floor.second))

    @property
    def solver_error(self) -> float:
        assert self.solver is not None
        return self.error(self.solver)

    @property
    def added_error(self) -> float:
        """Of the solver against the filled probes."""
        assert self.solver is not None
        return relative_error(self.solver, (self.floor.first, self.floor.second)).rel_mse


@pytest.fixture
def measure(gpu, bundled_assets, make_stage, surface_points):
    """Truth, floor and two runs of SDFDDGI at points that random rays through a stage's air meet."""
    pytest.importorskip("mitsuba", reason="Mitsuba is not installed: pip install 'sdfprim[reference]'")
    from pipelines.reference import primitive_reference
    from pipelines.representation_floor import representation_floor

    def run(
        name: str, spacing: float, *, count: int, samples: int, frames: tuple[int, int] | None = None
    ) -> Measured:
        primitives = read(bundled_assets / f"{name}.npz")
        light = choose_illumination(gltf.load(bundled_assets / f"{name}.glb"))
        world = World(gpu, None, primitives)
        points, normals = surface_points(world, AIR[name], count)
        reference = primitive_reference(primitives, light)
        truth = reference.irradiance(points, normals, samples=4 * samples)
        grid = ProbeGrid.around(AIR[name], spacing)
        settings = SdfddgiSettings(grid=grid)
        floor = representation_floor(gpu, world, settings, reference, points, normals, samples=samples)
        if frames is None:
            return Measured(truth, floor, None)
        settle, average = frames
        runs = []
        for seed in (0, 1):
            stage = make_stage(
                "sdfddgi",
                primitives,
                grid=grid,
                rays_per_probe=256,
                settling_frames=settle,
                seed=seed,
                **BRUTE_FORCE,
            )
            runs.append(stage.run(settle + average).irradiance(points, normals).astype(np.float64))
        return Measured(truth, floor, (runs[0], runs[1]))

    return run


def test_the_solver_adds_little_to_what_probes_cannot_represent(measure):
    found = measure("cornell", 0.5, count=300, samples=32, frames=(6, 6))
    assert found.added_error <= 0.01


@pytest.mark.slow
@pytest.mark.parametrize(("name", "limit"), [("two_rooms", 0.002), ("cornell", 0.03)])
def test_brute_force_reaches_the_floor(measure, name, limit):
    """The Cornell box's floor is itself 0.02: the umbra of its short block is narrower than a probe cell."""
    found = measure(name, EIGHTH[name], count=1000, samples=256, frames=(20, 10))
    assert found.solver_error <= limit
    assert found.added_error <= 0.002


@pytest.mark.slow
@pytest.mark.parametrize("name", EIGHTH)
def test_errors_fall_as_probes_are_added(measure, name):
    errors = [measure(name, k * EIGHTH[name], count=600, samples=64).floor_error for k in (4.0, 2.0, 1.0)]
    assert errors[0] > errors[1] > errors[2]
