"""What a frame is made with: frozen dataclasses, lengths in metres, radiance in W/m2/sr, exposure in
stops."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from runtime.twins import color


class ToneCurve(StrEnum):
    """Scene light to display light."""

    LINEAR = "linear"
    REINHARD = "reinhard"
    ACES = "aces"

    @property
    def code(self) -> int:
        """The value that `lib/color.wgsl` knows it by."""
        return {
            ToneCurve.LINEAR: color.COLOR_TONE_LINEAR,
            ToneCurve.REINHARD: color.COLOR_TONE_REINHARD,
            ToneCurve.ACES: color.COLOR_TONE_ACES,
        }[self]


@dataclass(frozen=True)
class ShadowSettings:
    """Shadow maps and reflective shadow maps.

    map_size: texels along the side of a sun's map; spots have half. max_suns, max_spots: how many get a
    map, the others are shadowed by tracing the primitives. rsm_tolerance: how far, in metres, a reflective
    shadow map's sample may lie from a hit that takes its light; rsm_tolerance_share of the meshes' diagonal
    and half the hit primitive's thickness are further limits. rsm_normal_agreement: smallest cosine between
    the two normals.
    """

    map_size: int = 2048
    max_suns: int = 2
    max_spots: int = 8
    rsm_tolerance: float = 0.1
    rsm_tolerance_share: float = 3e-3
    rsm_normal_agreement: float = 0.5

    def __post_init__(self) -> None:
        rows = self.max_suns + (self.max_spots + 1) // 2 / 2
        if not 16 <= self.map_size * max(rows, 1) <= 8192:
            raise ValueError(
                f"shadow maps of {self.map_size} texels for {self.max_suns} suns and {self.max_spots} spots "
                "do not fit into 8192 rows: take a smaller map_size"
            )


@dataclass(frozen=True)
class RenderSettings:
    """Everything about a picture but the scene, its lighting and the camera.

    size: width and height in pixels. gi: name of the global illumination technique; technique: its own
    settings, or None for its defaults. glossy: smooth surfaces and metals reflect, else base colour is all
    diffuse, as in comparisons. exposure: stops (EV), never automatic. max_texture_size: wider
    textures are halved until they fit.
    """

    size: tuple[int, int] = (640, 360)
    gi: str = "sdfddgi"
    technique: Any = None
    glossy: bool = False
    exposure: float = 0.0
    tone_curve: ToneCurve = ToneCurve.ACES
    max_texture_size: int = 2048
    shadows: ShadowSettings = field(default_factory=ShadowSettings)

    def __post_init__(self) -> None:
        if not all(1 <= length <= 8192 for length in self.size):
            raise ValueError(f"a picture has 1 to 8192 pixels a side, not {self.size[0]} x {self.size[1]}")


PREVIEW = RenderSettings(size=(480, 270), max_texture_size=512, shadows=ShadowSettings(map_size=1024))
"""For software renderers."""
