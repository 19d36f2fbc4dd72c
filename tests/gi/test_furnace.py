"""Furnaces: where the answer is known exactly, and most mistakes of normalisation, axes and texels show."""

import numpy as np
import pytest

from fit.encoding import decode_albedo, encode_albedo
from fit.primitives import make_box
from runtime.probes import ProbeGrid
from runtime.sky import Sky

AXES = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]

GRID = ProbeGrid((-2.0, -2.0, -2.0), 2.0, (3, 3, 3))


def a_speck():
    """Next to nothing: a world needs a primitive."""
    return make_box((0.3, 0.4, 0.5), (1e-3, 1e-3, 1e-3), albedo=(0, 0, 0))


def points_in_the_air(count: int = 400):
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(count, 3))
    normals[: len(AXES)] = AXES
    return rng.uniform(-1.9, 1.9, (count, 3)), normals / np.linalg.norm(normals, axis=1, keepdims=True)


def test_constant_sky(technique, make_stage):
    points, normals = points_in_the_air()
    stage = make_stage(technique, a_speck(), sky=Sky.constant((1.0, 2.0, 0.5)), grid=GRID).run(8)
    expected = np.pi * np.array([1.0, 2.0, 0.5])
    np.testing.assert_allclose(stage.irradiance(points, normals) / expected, 1.0, atol=0.005)


@pytest.mark.parametrize("axis", AXES)
def test_gradient_sky(technique, make_stage, axis):
    points, normals = points_in_the_air()
    sky = Sky.gradient((1.0, 1.0, 1.0), (0.8, 0.6, 0.4), axis)
    stage = make_stage(technique, a_speck(), sky=sky, grid=GRID).run(24)
    cosine = normals @ np.array(axis, float)
    expected = np.pi * (1 + 2 / 3 * np.array([0.8, 0.6, 0.4]) * cosine[:, None])
    np.testing.assert_allclose(stage.irradiance(points, normals) / expected, 1.0, atol=0.01)


@pytest.mark.parametrize(("albedo", "frames"), [(0.2, 60), (0.5, 100), (0.8, 300), (0.95, 700)])
def test_closed_box_of_glowing_walls(technique, make_stage, make_room, inner_surface, albedo, frames):
    glow = 2.0
    room = make_room(0.2, albedo=albedo, emission=glow)
    stage = make_stage(technique, room, grid=ProbeGrid((-1.0, -1.0, -1.0), 1.0, (3, 3, 3))).run(frames)
    stored = float(decode_albedo(encode_albedo(np.full((1, 3), albedo)))[0, 0])
    expected = np.pi * glow / (1 - stored)
    np.testing.assert_allclose(stage.irradiance(*inner_surface(300)) / expected, 1.0, atol=0.02)
