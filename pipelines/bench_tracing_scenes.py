"""Generated sets for `bench tracing`: as many primitives as asked for, and points in their air.

hall    an indoor hall of 30 x 12 x 18 m, filled with boxes that are turned about the vertical
town    houses, trees and lamps on a square kilometre of ground
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from fit import sdf
from fit.primitives import PrimitiveSet, make_box, make_cylinder, make_half_space, make_sphere

Float64 = NDArray[np.float64]

HALL = np.array([30.0, 12.0, 18.0])
TOWN = 1000.0


def make_hall(count: int, seed: int) -> PrimitiveSet:
    """Six walls, and boxes that shrink as they become more, so that they fill about a tenth of the air."""
    rng = np.random.default_rng(seed)
    parts = []
    for axis in range(3):
        for side in (-1, 1):
            centre, size = np.zeros(3), HALL + 1.0
            centre[axis], size[axis] = side * (HALL[axis] + 0.5) / 2, 0.5
            parts.append(make_box(centre, size))
    edge = np.cbrt(0.1 * HALL.prod() / max(count - 6, 1))
    for _ in range(count - 6):
        size = edge * np.exp(rng.uniform(-0.7, 0.7, 3))
        parts.append(make_box(rng.uniform(-0.5, 0.5, 3) * HALL, size, _upright(rng)))
    return PrimitiveSet.concatenate(parts[:count])


def make_town(count: int, seed: int) -> PrimitiveSet:
    """Of four primitives two are houses, one a trunk and one the crown on it."""
    rng = np.random.default_rng(seed)
    parts = [make_half_space((0, 0, 0))]
    plot = TOWN / np.sqrt(count / 2)
    while len(parts) < count:
        place = rng.uniform(-0.5, 0.5, 2) * TOWN
        height, (width, depth) = rng.uniform(4, 25), plot * rng.uniform(0.2, 0.6, 2)
        parts.append(make_box((place[0], height / 2, place[1]), (width, height, depth), _upright(rng)))
        if len(parts) % 4 == 3:
            x, z = place + plot * rng.uniform(0.4, 0.6, 2)
            tall, crown = rng.uniform(2, 5), rng.uniform(1, 3)
            parts.append(make_cylinder((x, tall / 2, z), 0.3, tall))
            parts.append(make_sphere((x, tall + 0.7 * crown, z), crown))
    return PrimitiveSet.concatenate(parts[:count])


SCENES: Mapping[str, Callable[[int, int], PrimitiveSet]] = {"hall": make_hall, "town": make_town}


def rays_in_air(primitives: PrimitiveSet, count: int, seed: int) -> tuple[Float64, Float64]:
    """Origins and directions (count, 3) like those of probes: evenly in the air of the bounds, every way.

    Points lie in the middle 100 m of larger scenes, and up to 15 m high, as probes around a viewer do.
    """
    rng = np.random.default_rng(seed)
    lower, upper = primitives.bounds()
    middle, most = (lower + upper) / 2, np.array([50.0, 7.5, 50.0])
    low, high = np.maximum(lower, middle - most), np.minimum(upper, middle + most)
    if upper[1] - lower[1] > 15:
        low[1], high[1] = lower[1], lower[1] + 15
    origins = np.zeros((0, 3))
    for _ in range(1000):
        points = rng.uniform(low, high, (2 * count, 3))
        origins = np.concatenate([origins, points[sdf.union_distance(primitives, points)[0] > 1e-2]])
        if len(origins) >= count:
            break
    else:
        raise ValueError("the set leaves no air within its bounds: no ray can start there")
    directions = rng.normal(size=(count, 3))
    return origins[:count], directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _upright(rng: np.random.Generator) -> Float64:
    angle = rng.uniform(0, np.pi)
    return np.array([0, np.sin(angle / 2), 0, np.cos(angle / 2)])
