"""What a fit may be asked for: budgets, presets, which space is air."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.build import STEPS
from fit.shapes import KINDS

BYTES_PER_PRIMITIVE = 64

COARSEST = 8
"""Cells along the diagonal, with which no air can be told any more."""


@dataclass(frozen=True)
class FitSettings:
    """What to fit. Without a budget the count follows the scene, up to 128, and so for each body that moves.

    max_primitives, max_bytes (64 a primitive): hard caps; preset: 'coarse' or 'fine' sets `max_primitives`
    and `skip_below` where they are not given; max_error: metres that 95 % of the seen surface must lie within
    of the set; max_leaks: share of the rays that may leak, above which growth goes on for smaller gains;
    skip_below: share of the projected area under which a part gets no primitive; air: seeds,
    'outside' or 'x,y,z'; resolution: cells of the air's grid along the bounding diagonal; kinds: those that
    may stand in the set; steps: those of the method's optional steps, `STEPS`, that are taken;
    instancing: what is drawn more than once is fitted once, by itself, and placed.
    """

    max_primitives: int | None = None
    max_bytes: int | None = None
    max_error: float | None = None
    max_leaks: float = 1.0
    preset: str | None = None
    air: tuple[str | tuple[float, float, float], ...] = ()
    seed: int = 0
    resolution: float = 180
    skip_below: float | None = None
    kinds: tuple[str, ...] = KINDS
    steps: tuple[str, ...] = STEPS
    instancing: bool = False

    def __post_init__(self) -> None:
        if self.preset is not None and self.preset not in PRESETS:
            raise ValueError(f"preset {self.preset!r}: expected one of {', '.join(PRESETS)}")
        for name, known in (("kinds", KINDS), ("steps", STEPS)):
            unknown = [item for item in getattr(self, name) if item not in known]
            if unknown:
                raise ValueError(f"{name} {', '.join(unknown)}: expected some of {', '.join(known)}")
        if not self.kinds or not np.isfinite(self.resolution) or self.resolution < COARSEST:
            raise ValueError(
                f"kinds {self.kinds}, resolution {self.resolution}: "
                f"expected a kind at least, and {COARSEST} cells at least"
            )
        bounds = {
            "max_primitives": 1,
            "max_bytes": BYTES_PER_PRIMITIVE,
            "max_error": 0,
            "max_leaks": 0,
            "skip_below": 0,
        }
        for name, least in bounds.items():
            value = getattr(self, name)
            if value is not None and not value >= least:
                raise ValueError(f"{name} {value}: expected at least {least}")
        if self.max_leaks > 1:
            raise ValueError(f"max_leaks {self.max_leaks}: expected a share of the rays, from 0 to 1")

    def limit(self) -> int:
        """Most primitives that any of the caps allows."""
        preset = PRESETS[self.preset][0] if self.preset else None
        free = MOST_FOR_ERROR if self.max_error is not None else MOST_BY_DEFAULT
        wanted = self.max_primitives or preset or free
        return min(wanted, self.max_bytes // BYTES_PER_PRIMITIVE) if self.max_bytes else wanted

    def least_share(self) -> float:
        """Projected area under which a part is skipped."""
        if self.skip_below is not None:
            return self.skip_below
        return PRESETS[self.preset][1] if self.preset else SKIP_BY_DEFAULT

    def least_gain(self) -> float:
        """Share of the empty set's error that one more primitive must take off."""
        return GAIN_WITH_BUDGET if self.has_budget or self.max_error is not None else GAIN_BY_DEFAULT

    @property
    def has_budget(self) -> bool:
        """Whether a number of primitives, or of bytes, was asked for."""
        return any(cap is not None for cap in (self.max_primitives, self.max_bytes, self.preset))


PRESETS = {"coarse": (48, 0.005), "fine": (192, 0.0005)}
"""Primitives at most, and the projected area under which a part is skipped."""

MOST_BY_DEFAULT, MOST_FOR_ERROR = 128, 512
SKIP_BY_DEFAULT = 0.001
GAIN_BY_DEFAULT, GAIN_WITH_BUDGET = 1e-4, 4e-6
"""Share of the empty set's error that one more primitive must take off, by default and with a budget."""

DEFAULT, COARSE, FINE = FitSettings(), FitSettings(preset="coarse"), FitSettings(preset="fine")
