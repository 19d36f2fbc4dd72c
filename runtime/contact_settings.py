"""How far and how finely contact light is looked for."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from fit.scene import Scene


class ContactForm(StrEnum):
    """How the near field and the probes make one irradiance."""

    CONSERVING = "conserving"
    """What is near replaces the share of the hemisphere that it covers."""

    PRINTED = "paper"
    """SDFDDGI's eq. 5 and its interpolation by ambient occlusion, which lose energy."""


@dataclass(frozen=True)
class ContactSettings:
    """Contact GI.

    radius: metres within which surfaces count; None takes `radius_share` of the scene's bounding diagonal.
    falloff: share of the radius, at its end, over which they fade out. thickness: what lies this share of the
    radius behind a visible surface, along the view, is taken for solid. longest: no walk is longer than this
    share of the picture's height.
    scale: one walk for each block of so many pixels a side, 1 or 2; None takes 2 for pictures of at least
    `half_from` rows. slices, steps: of a walk, and of each of
    a slice's two sides. step_exponent: steps are denser near the centre above 1.
    history_frames: a still texel is the mean of so many frames. clip_width: standard deviations of its
    surroundings beyond which the past is forgotten.
    """

    form: ContactForm = ContactForm.CONSERVING
    radius: float | None = None
    radius_share: float = 0.03
    falloff: float = 0.3
    thickness: float = 1.0
    longest: float = 0.25
    scale: int | None = None
    half_from: int = 360
    slices: int = 1
    steps: int = 6
    step_exponent: float = 1.5
    history_frames: float = 16.0
    clip_width: float = 0.75
    seed: int = 0

    def __post_init__(self) -> None:
        if self.scale not in (None, 1, 2):
            raise ValueError(f"contact light has a scale of 1 or 2 pixels a texel, not {self.scale}")
        if self.radius is not None and not 0 < self.radius < float("inf"):
            raise ValueError(f"contact light has a radius above 0 metres, not {self.radius}")
        if not 1 <= self.slices <= 16 or not 1 <= self.steps <= 64:
            raise ValueError(
                f"contact light takes 1 to 16 slices of 1 to 64 steps, not {self.slices} of {self.steps}"
            )
        if self.history_frames < 1 or self.clip_width < 0:
            raise ValueError("contact light has history_frames of at least 1 and a clip_width of at least 0")
        shares = {
            name: getattr(self, name)
            for name in ("radius_share", "falloff", "thickness", "longest", "step_exponent")
        }
        for name, value in shares.items():
            if not 0 < value < float("inf"):
                raise ValueError(f"contact light has a {name} above 0, not {value}")

    def radius_within(self, scene: Scene) -> float:
        """The radius, metres, in a scene."""
        if self.radius is not None:
            return self.radius
        lower, upper = scene.bounds()
        return max(self.radius_share * float(np.linalg.norm(upper - lower)), 1e-6)

    def scale_of(self, size: tuple[int, int]) -> int:
        """Pixels a side of a block in a picture of so many."""
        return self.scale or (2 if size[1] >= self.half_from else 1)
