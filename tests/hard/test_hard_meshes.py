"""Meshes that break other fitters: each gives a valid, finite set near the mesh, in bounded time."""

from __future__ import annotations

from dataclasses import asdict, replace
from types import ModuleType

import numpy as np
import pytest

from fit.solve import Fit, FitSettings, fit

QUICK = FitSettings(resolution=60, max_primitives=8)

MOST_SECONDS = 60.0
"""CPU; each takes about two: what passes this hangs."""

CLOSE = 0.012
"""Of the diagonal: mean distance of the surface from a set of a few primitives."""


MOST_SOLID = 0.06
"""Of the air: lumps need more primitives than these tests give them."""

SCATTERED = (0.06, 0.12)
"""The same two of two hundred triangles that nothing joins."""


def assert_sound(result: Fit, size: float, close: float = CLOSE, most_solid: float = MOST_SOLID) -> None:
    """A valid set, every figure finite, the surface met within `close` and the air left free."""
    primitives, metrics = result.primitives.validate(), result.metrics
    assert 1 <= len(primitives) <= QUICK.limit()
    assert np.isfinite(primitives.positions).all()
    assert np.isfinite(primitives.sizes).all()
    numbers = {name: value for name, value in asdict(metrics).items() if isinstance(value, float)}
    assert all(np.isfinite(value) for value in numbers.values()), numbers
    assert metrics.surface_to_set_mean_m <= close * size
    assert metrics.air_distance_error_m <= 2 * close * size
    assert metrics.false_solid <= most_solid
    assert sum(result.seconds.values()) < MOST_SECONDS


def test_mesh(hard_mesh: str, meshes: ModuleType) -> None:
    mesh = meshes.MESHES[hard_mesh]()
    limits = SCATTERED if hard_mesh == "isolated triangles" else (CLOSE, MOST_SOLID)
    assert_sound(fit(meshes.scene_of(mesh), QUICK), meshes.diagonal(mesh[0]), *limits)


@pytest.mark.parametrize("base", ["table", pytest.param("lumpy_ball", marks=pytest.mark.slow)])
def test_damage(damage: str, base: str, meshes: ModuleType) -> None:
    mesh = getattr(meshes, base)()
    size = meshes.diagonal(mesh[0])
    damaged = meshes.DAMAGES[damage](*mesh, np.random.default_rng(3))
    close = (0.025 if base == "lumpy_ball" else CLOSE) + meshes.NOISE.get(damage, 0.0)
    assert_sound(fit(meshes.scene_of(damaged), QUICK), size, close)


def test_combination(combination: int, meshes: ModuleType) -> None:
    name, mesh, matrix = meshes.combined(combination)
    size = meshes.diagonal(mesh[0] @ matrix[:3, :3].T)
    limits = SCATTERED if name.startswith("isolated") else (0.03, MOST_SOLID)
    print(name)
    assert_sound(fit(meshes.scene_of(mesh, matrix), replace(QUICK, seed=combination)), size, *limits)
