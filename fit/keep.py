"""Which parts matter: the small ones get no primitive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fit.scene import Float64
from fit.split import Parts
from fit.surface import Surface
from fit.targets import Seen

MOST_SKIPPED = 0.1
"""Of the projected area: a scene that is nothing but small parts is still fitted."""


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
