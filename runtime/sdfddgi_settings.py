"""What SDFDDGI is told: where its probes stand, how they look around, and how they blend what they saw."""

from __future__ import annotations

from dataclasses import dataclass

from runtime.probe_choice import ChoiceRules
from runtime.probes import ProbeGrid, check_rays

PAPER_VOLUME = (22, 14, 32)
"""Probes on each axis of the volume that the paper measures with."""

BOUNCE_SHARES = (1.0, 0.5, 0.25)


@dataclass(frozen=True)
class SdfddgiSettings:
    """Lengths in metres, or shares of the probe spacing.

    grid: where the probes stand; None lays them over the primitives.
    probe_spacing: None makes it as fine as `max_probes` allows over the primitives.
    volume: where they need more than `max_probes` at this `probe_spacing`, so many probes stand around the
    viewer and follow him; None makes the spacing coarser instead.
    probes_per_frame: so many probes are updated in a frame, at most; None updates all. They are chosen at
    random, those near the viewer and before him more often, so that every probe has its turn within
    `longest_wait_seen` frames if the camera sees it, else `longest_wait_unseen`, if the budget allows.
    half_distance: spacings from the viewer at which a probe weighs half as much in the choice; behind: weight
    of one right behind him.
    rays_per_probe: a multiple of 64; a probe without history takes up to `fresh_factor` times as many.
    bounce: share of the light of the last frame's probes that is reflected on, 1 for all.
    bounce_share: share of the rays that look for it, 1, 1/2 or 1/4.
    max_ray_distance: rays end there and take the sky.
    history_frames: a still probe is the mean of about so many updates.
    settling_frames, settling_history, settling_growth: for so many frames after a change it is the mean of
    the updates in so few frames, or in this share of the frames since.
    clearance: probes keep this share of the spacing, at most `clearance_limit` metres, from all primitives
    where they can; `smallest_clearance`, metres (None: twice the world's start margin), everywhere.
    relocation: how far, in spacings, a probe may climb away from a primitive.
    attraction: how far, in spacings, it may come down to one.
    jump: a move by more spacings than this drops the history.
    softness: radians; a probe that is seen past an edge within this angle counts less.
    """

    grid: ProbeGrid | None = None
    probe_spacing: float | None = None
    max_probes: int = 9856
    volume: tuple[int, int, int] | None = PAPER_VOLUME
    probes_per_frame: int | None = None
    longest_wait_seen: int = 8
    longest_wait_unseen: int = 16
    half_distance: float = 8.0
    behind: float = 0.25
    rays_per_probe: int = 64
    fresh_factor: int = 4
    bounce: float = 1.0
    bounce_share: float = 1.0
    max_ray_distance: float = 1e30
    history_frames: float = 256.0
    settling_frames: int = 64
    settling_history: float = 4.0
    settling_growth: float = 0.125
    clearance: float = 0.06
    clearance_limit: float = 0.25
    smallest_clearance: float | None = None
    relocation: float = 0.45
    attraction: float = 0.7
    jump: float = 0.1
    softness: float = 0.02
    seed: int = 0

    def __post_init__(self) -> None:
        check_rays(self.rays_per_probe)
        if self.volume is not None and min(self.volume) < 2:
            raise ValueError(f"volume is {self.volume}; it needs two probes on each axis")
        if not 0 <= self.bounce <= 1:
            raise ValueError(f"bounce is {self.bounce}; it must be between 0 and 1")
        if self.bounce_share not in BOUNCE_SHARES:
            raise ValueError(f"bounce_share is {self.bounce_share}; it must be one of {BOUNCE_SHARES}")
        if not 1 <= self.longest_wait_seen <= self.longest_wait_unseen:
            raise ValueError("longest_wait_seen must be at least 1, longest_wait_unseen no less than that")
        if self.half_distance <= 0 or not 0 <= self.behind <= 1:
            raise ValueError("half_distance must be above 0, behind between 0 and 1")
        if min(self.history_frames, self.settling_history) < 1 or self.fresh_factor < 1:
            raise ValueError("history_frames, settling_history and fresh_factor must be at least 1")

    def choice_rules(self, spacing: float) -> ChoiceRules | None:
        """How the probes of a frame are chosen, at this spacing in metres; None where all are updated."""
        if self.probes_per_frame is None:
            return None
        return ChoiceRules(
            self.probes_per_frame,
            self.longest_wait_seen,
            self.longest_wait_unseen,
            self.half_distance * spacing,
            self.behind,
            self.seed,
        )


BALANCED = SdfddgiSettings(probes_per_frame=1240, bounce_share=0.25)
"""The paper's number of probes, an eighth of them in a frame: 1,232 at least, since of probes whose turn is
equally near the choice may leave out some."""
