"""What DDGI is told: its probes, its rays, and how it blends what they saw."""

from __future__ import annotations

from dataclasses import dataclass

from runtime.cascades import MOST_CASCADES
from runtime.probes import ProbeGrid, check_rays


@dataclass(frozen=True)
class DdgiSettings:
    """Lengths in metres, or shares of the probe spacing.

    tracer: what probe rays meet, "primitives" or "triangles", those of the scene's meshes.
    grid, probe_spacing, max_probes: as `SdfddgiSettings` has them.
    cascades: None for that one grid; else so many grids of 32 x 4 x 32 probes that follow the viewer, each
    twice as wide as the one before and updated half as often; probe_spacing is then the finest one's, and
    None makes the coarsest cover the scene.
    visible_cascades: so many of them, from the finest on, test what their probes see; the others keep no
    distances, and a broken number fades the last one's test.
    rays_per_probe: a multiple of 64.
    bounce: share of the light of the last frame's probes that is reflected on, 1 for all.
    max_ray_distance: rays end there and take the sky.
    gamma: irradiance is blended, compared and stored as its gamma-th root.
    hysteresis: share of a texel that a frame keeps. Where the root changed by more than `change_clear` of the
    larger of old and new it is less by `hysteresis_drop`; by more than `change_altogether`, nothing is kept.
    At gamma 5 the defaults stand for irradiance 4.2 and 3125 times as large, or as small.
    settling_growth: a new probe is the mean of this share of its frames until hysteresis stands for more.
    distance_exponent: a texel's distance is the mean over a cosine to this power.
    farthest: longer distances count as so many diagonals of a probe cell.
    normal_bias, view_bias: how far, in spacings, a point moves from its surface, along the normal and towards
    the viewer, before it asks which probes see it.
    lean_inward: a probe outside of the scene's bounds, half a spacing at most, begins inside of them. Laid
    over a room, it would stand right behind a wall and darken every corner; where a hollow building is seen
    from outside, its place is out there.
    relocation: how far, in spacings and along each axis, a probe may stand from its node.
    clearance: probes keep this many spacings from surfaces where they can.
    relocation_frames: for so many frames after the world changed, probes move; one that is then still inside
    something is off.
    sleep: a probe without a surface in its cells is not updated; points in the open then get no light of it.
    """

    tracer: str = "primitives"
    grid: ProbeGrid | None = None
    probe_spacing: float | None = None
    max_probes: int = 9856
    cascades: int | None = None
    visible_cascades: float = float(MOST_CASCADES)
    rays_per_probe: int = 192
    bounce: float = 1.0
    max_ray_distance: float = 1e30
    hysteresis: float = 0.97
    hysteresis_drop: float = 0.15
    settling_growth: float = 0.25
    change_clear: float = 0.25
    change_altogether: float = 0.8
    gamma: float = 5.0
    distance_exponent: float = 50.0
    farthest: float = 1.5
    normal_bias: float = 0.045
    view_bias: float = 0.18
    lean_inward: bool = True
    relocation: float = 0.45
    clearance: float = 0.2
    relocation_frames: int = 8
    sleep: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        check_rays(self.rays_per_probe)
        for name in ("bounce", "hysteresis"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} is {getattr(self, name)}; it must be between 0 and 1")
        if not self.visible_cascades >= 0:
            raise ValueError(f"visible_cascades is {self.visible_cascades}; it must be 0 or more")
