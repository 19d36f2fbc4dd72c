"""Camera-dependent culling of primitives (SDFDDGI, section 3.1), with a bound on what it can change.

A primitive is left out when it is small from everywhere in the volume of the probes, wherever the camera
looks: what is behind the viewer still lights and shadows what is in view. Together, those left out fill so
little of any point's sphere of directions that its irradiance changes by no more than the share asked for:

    |change of E| <= (sum of their solid angles) * (largest change of radiance)
                  <= share * pi * (largest radiance around)

since a cosine is at most 1. What shines is never left out, nor what can shadow the volume from a lamp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.primitives import PrimitiveSet
from runtime.lights import AnyLight, Sun

Float64 = NDArray[np.float64]
Mask = NDArray[np.bool_]
Box = tuple[Float64, Float64]


@dataclass(frozen=True)
class Culled:
    """Which of n primitives are left out, and by what share of pi times the largest radiance that changes
    the irradiance of a point in the volume at most."""

    is_culled: Mask
    share: float

    @property
    def count(self) -> int:
        return int(np.count_nonzero(self.is_culled))


def cull(primitives: PrimitiveSet, volume: Box, share: float, lights: Sequence[AnyLight] = ()) -> Culled:
    """The most primitives whose solid angles, seen from anywhere in the box `volume` (3,), (3,), add up to
    `share` of pi at most."""
    radii = primitives.bounding_radii()
    angles = np.full(len(primitives), np.inf)
    finite = np.flatnonzero(~primitives.is_half_space & ~primitives.emission.any(axis=(1, 2)))
    centres, balls = primitives.positions[finite], radii[finite]
    found = solid_angles(centres, balls, volume)
    for light in lights:
        found[may_shadow(centres, balls, volume, light)] = np.inf
    angles[finite] = found
    order = np.argsort(angles, kind="stable")
    sums = np.cumsum(np.minimum(angles[order], 1e3))
    count = int(np.searchsorted(sums, share * np.pi, side="right"))
    is_culled = np.zeros(len(primitives), bool)
    is_culled[order[:count]] = True
    return Culled(is_culled, float(sums[count - 1] / np.pi) if count else 0.0)


def solid_angles(centres: Float64, radii: Float64, volume: Box) -> Float64:
    """Largest solid angle (n,) of balls (n, 3), (n,) seen from a point of the box; infinite if they meet."""
    away = np.linalg.norm(centres - np.clip(centres, *volume), axis=1)
    sine = radii / np.maximum(away, 1e-300)
    outside = 2 * np.pi * (1 - np.sqrt(np.maximum(1 - np.minimum(sine, 1.0) ** 2, 0)))
    return np.where(sine < 1, outside, np.inf)


def may_shadow(centres: Float64, radii: Float64, volume: Box, light: AnyLight) -> Mask:
    """Whether balls (n, 3), (n,) may stand between the box and a light. Errs towards yes."""
    lower, upper = volume
    middle, reach = (lower + upper) / 2, float(np.linalg.norm(upper - lower)) / 2
    if isinstance(light, Sun):
        towards = np.asarray(light.direction, np.float64) / np.linalg.norm(light.direction)
        way = centres - middle
        along = way @ towards
        beside = np.linalg.norm(way - along[:, None] * towards, axis=1)
        return (along > -(reach + radii)) & (beside < reach + radii)
    lamp = np.asarray(light.position, np.float64)
    if np.all((lamp >= lower) & (lamp <= upper)):
        return np.zeros(len(centres), bool)  # the box is convex: what is outside shadows what is outside
    to_ball, to_box = centres - lamp, middle - lamp
    far, near = np.linalg.norm(to_ball, axis=1), float(np.linalg.norm(to_box))
    cosine = to_ball @ to_box / np.maximum(far * near, 1e-300)
    width = np.arcsin(np.minimum(radii / np.maximum(far, 1e-300), 1))
    width += np.arcsin(min(reach / max(near, 1e-300), 1))
    return (far - radii < near + reach) & (np.arccos(np.clip(cosine, -1, 1)) < width)
