"""The representation floor: what no solver on a grid of probes can beat.

The probes are filled by the reference and looked up as SDFDDGI looks them up, by trilinear weights times
visibility, which is exact here: without the soft edges that hide a probe little by little. What is wrong
then is what a few numbers at a few places cannot tell.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from pipelines.reference import Reference
from pipelines.reference.truth import Progress
from runtime.device import Gpu
from runtime.estimate import Estimate
from runtime.probes import IRRADIANCE_SIZE, texel_directions
from runtime.sdfddgi import Sdfddgi, SdfddgiSettings
from runtime.technique import Gather
from runtime.world import World

SHARP = 1e-4
"""Radians: the softness of a visibility that is exact but for a hair."""


def representation_floor(
    gpu: Gpu,
    world: World,
    settings: SdfddgiSettings,
    reference: Reference,
    points: ArrayLike,
    normals: ArrayLike,
    *,
    samples: int = 256,
    seed: int = 0,
    progress: Progress | None = None,
) -> Estimate:
    """Indirect E at world points (n, 3) with unit normals (n, 3), from the probes of `settings` when
    `reference`, which must be of the world's own primitives, fills them with `samples` for each texel.

    Its halves come from the two halves of those samples; `standard_error` is half of what they differ by.
    """
    technique = Sdfddgi(gpu, world, replace(settings, softness=SHARP))
    positions, is_on = technique.place()
    filled = _fill(reference, positions[is_on], samples, seed, progress)
    gather = Gather(gpu, world, technique)

    def look_up(values: np.ndarray) -> np.ndarray:
        irradiance = np.zeros((len(positions), IRRADIANCE_SIZE**2, 3))
        irradiance[is_on] = values.reshape(-1, IRRADIANCE_SIZE**2, 3)
        technique.fill(irradiance)
        return gather.irradiance(points, normals).astype(np.float64)

    first, second, value = (look_up(v) for v in (filled.first, filled.second, filled.value))
    error = np.abs((first - second).mean(axis=-1)) / 2
    return Estimate(value, first, second, error, filled.samples)


def _fill(
    reference: Reference, positions: np.ndarray, samples: int, seed: int, progress: Progress | None
) -> Estimate:
    directions = texel_directions()
    starts = np.repeat(positions, len(directions), axis=0)
    return reference.irradiance(
        starts, np.tile(directions, (len(positions), 1)), samples=samples, seed=seed, progress=progress
    )
