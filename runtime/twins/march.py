"""Twin of shaders/lib/march.wgsl: sphere tracing of many rays at once, by any of the strides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit import sdf
from fit.primitives import PrimitiveSet
from runtime.twins import stride as strides

Float64 = NDArray[np.float64]
Index = NDArray[np.intp]

MARCH_STEPS = 128


@dataclass(frozen=True)
class Arrival:
    """Of n rays: t (n,); primitive (n,), -1 for none; steps (n,), the queries."""

    t: Float64
    primitive: Index
    steps: Index


def march_by_strides(
    method: int,
    primitives: PrimitiveSet,
    origins: Float64,
    directions: Float64,
    reach: Float64,
    hit_distance: float,
) -> Arrival:
    """Where rays (n, 3), (n, 3) from free places meet the finite primitives, at most `reach` (n,) away."""
    n, rows = len(origins), np.arange(len(origins))
    code = np.full(n, method, np.uint32)
    t, radius, stride = np.zeros(n), np.zeros(n), np.zeros(n)
    slope = np.array(strides.stride_first_slope(code))
    left, primitive, steps = np.full(n, -1), np.full(n, -1), np.zeros(n, np.intp)
    alive = np.ones(n, bool)
    for step in range(MARCH_STEPS):
        active = np.flatnonzero(alive)
        if not len(active):
            break
        steps[active] += 1
        places = origins[active] + directions[active] * (t + stride)[active, None]
        table = sdf.distance(primitives, places)
        excluded = left[active] >= 0
        table[np.flatnonzero(excluded), left[active][excluded]] = np.inf
        distance, index = np.full(n, np.inf), np.full(n, -1)
        index[active] = table.argmin(axis=1)
        distance[active] = table.min(axis=1)
        leaving = np.zeros(n, bool)
        close = active[np.isfinite(distance[active])]
        outward = sdf.gradient(
            primitives, origins[close] + directions[close] * (t + stride)[close, None], index[close]
        )
        leaving[close] = (np.einsum("ni,ni->n", outward, directions[close]) >= 0) & (
            distance[close] > -hit_distance
        )
        if step == 0:
            left[leaving] = index[leaving]
        goes_on = alive & ~(leaving if step == 0 else np.zeros(n, bool))
        rejected = goes_on & (stride > radius) & (stride > radius + distance)
        slope[rejected], stride[rejected] = strides.STRIDE_HEAD_ON, radius[rejected]
        kept = goes_on & ~rejected
        moved = kept & (stride > 0)
        measured = np.divide(distance - radius, stride, out=np.zeros(n), where=moved)
        slope[moved] = strides.stride_next_slope(code, slope, measured)[moved]
        t[kept] += stride[kept]
        radius[kept] = distance[kept]
        met = kept & (radius < hit_distance)
        primitive[met & ~leaving] = index[met & ~leaving]
        radius[met & leaving], slope[met & leaving] = hit_distance, strides.STRIDE_HEAD_ON
        alive &= ~(met & ~leaving) & ~(kept & (t + radius >= reach))
        longer = rows[kept & alive]
        stride[longer] = np.minimum(strides.stride_length(code, radius, slope)[longer], (reach - t)[longer])
    primitive[alive] = index[alive]
    return Arrival(t, primitive, steps)
