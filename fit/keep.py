"""Which parts matter: the small ones that get no primitive, and the lamps that must have one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fit.fit_parts import bounding_fit
from fit.glow import Glow
from fit.primitives import Kind
from fit.recognize import Piece, recognize
from fit.scene import Float64
from fit.shapes import Shapes, distances_to_one, join, make_shapes
from fit.spaces import Air
from fit.split import Parts
from fit.surface import Surface
from fit.targets import Seen

MOST_SKIPPED = 0.1
"""Of the projected area: a scene that is nothing but small parts is still fitted."""

LEAST_POWER = 0.01
"""Of the light that the strongest lamp emits: below it a lamp may share its neighbour's primitive."""

_PROUD = 0.02
"""Of a cell: a lamp stands out of the wall that it hangs on, so that a ray meets the lamp first."""

_FLAT_ENOUGH = 0.5
"""Of a cell: mean distance of a lamp's surface from its box; a worse one is left to the general fit."""


def skip_small_parts(
    parts: Parts, walls: Surface, seen: Seen, least_share: float
) -> tuple[NDArray[np.int64], Float64, list[dict[str, object]]]:
    """Parts to fit, by falling projected area; samples' weights (p,), zero on skipped parts; those parts."""
    share = np.bincount(parts.of_triangle, weights=seen.projected, minlength=len(parts))
    area = np.bincount(parts.of_triangle, weights=walls.areas, minlength=len(parts))
    rising = np.argsort(share, kind="stable")
    skipped_rows = rising[(share[rising] < least_share) & (np.cumsum(share[rising]) <= MOST_SKIPPED)]
    is_skipped = np.zeros(len(parts), bool)
    is_skipped[skipped_rows] = True
    weights = np.where(is_skipped[parts.of_triangle[seen.samples.triangle]], 0.0, seen.weights)
    total = float(weights.sum())
    skipped = [
        {
            "name": parts.names[p],
            "instance": int(parts.instance[p]),
            "projected_area_share": float(share[p]),
            "area_m2": float(area[p]),
        }
        for p in np.flatnonzero(is_skipped & (area > 0))
    ]
    falling = rising[::-1]
    return (
        falling[~is_skipped[falling] & (share[falling] > 0)],
        weights / (total if total > 0 else 1.0),
        skipped,
    )


def emissive_parts(glow: Glow, air: Air, parts: Parts, most: int) -> Shapes:
    """One fixed shape for each of the parts that emit the most light, the strongest first."""
    walls = air.walls
    of_sample = parts.of_triangle[glow.triangle]
    power = np.bincount(of_sample, weights=glow.flux.sum(axis=1), minlength=len(parts))
    strongest = np.argsort(-power, kind="stable")[:most]
    lamps = []
    for part in strongest[power[strongest] > LEAST_POWER * power.max(initial=0.0)]:
        rows = np.flatnonzero(parts.of_triangle == part)
        piece = Piece(walls.vertices[rows], walls.normals[rows], walls.areas[rows])
        exact = recognize(piece)
        shape = exact if len(exact) == 1 else bounding_fit(piece)
        points = glow.points[of_sample == part]
        if np.abs(distances_to_one(shape, 0, points)).mean() <= _FLAT_ENOUGH * air.cell:
            halves = shape.halves + _PROUD * air.cell
            lamps.append(
                make_shapes(Kind(shape.kinds[0]), shape.centers, shape.frames[0], halves, exact=True)
            )
    return join(lamps)
