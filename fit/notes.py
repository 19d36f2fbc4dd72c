"""What a user should be told of a fit in words: what was not reached, and what a figure alone would hide."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from fit.air import parse_seed
from fit.measure import Metrics
from fit.primitives import PrimitiveSet
from fit.sdf import union_distance
from fit.settings import FitSettings

MANY_LEAK = 0.05
"""Share of the rays from which a set no longer stands in for its scene when light is traced."""


def notes_on_result(
    primitives: PrimitiveSet, metrics: Metrics, settings: FitSettings, surface_p95: float
) -> tuple[str, ...]:
    """Notes on a set in the world; surface_p95: metres within which 95 % of the seen surface lie."""
    notes = [] if len(primitives) else ["no primitive stands for what is seen from the air"]
    if settings.max_error is not None and surface_p95 > settings.max_error:
        notes.append(
            f"max_error {settings.max_error:g} m not reached: {surface_p95:.3g} m, "
            f"{len(primitives)} primitives"
        )
    if len(primitives) and metrics.leaks > MANY_LEAK:
        notes.append(
            f"{metrics.leaks:.0%} of the rays pass the set where the surface stops them: "
            "more primitives (max_primitives, preset fine) or max_leaks close it"
        )
    return (*notes, *_filled_seeds(primitives, settings))


def _filled_seeds(primitives: PrimitiveSet, settings: FitSettings) -> Iterable[str]:
    """Seeds of the air that the set has filled all the same."""
    for given in settings.air:
        seed = parse_seed(given) if isinstance(given, str) else given
        if isinstance(seed, str) or len(primitives) == 0:
            continue
        distance, index = union_distance(primitives, np.array([seed], np.float64))
        if distance[0] < 0:
            place = ",".join(f"{value:g}" for value in seed)
            yield f"air {place}: the point lies inside primitive {index[0]}: the space around it is filled"
