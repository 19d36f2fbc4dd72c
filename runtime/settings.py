"""What a frame is made with: frozen dataclasses, lengths in metres, radiance in W/m2/sr, exposure in
stops."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from runtime.contact_settings import ContactSettings
from runtime.twins import color

CULLINGS = ("grid", "clusters", "none")
"""How a query finds the nearest primitive: exact lists on a grid, K-means clusters, or by asking all. All
three give the same hits. In the order of `world/bindings.wgsl`."""


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


class ShadingMode(StrEnum):
    """How pixels ask the technique for irradiance."""

    FULL = "full"
    SHARED = "shared"


@dataclass(frozen=True)
class ShadingSettings:
    """How indirect light comes to the pixels (SDFDDGI, section 3.4).

    mode: `full` asks for every pixel, `shared` for one of 4 x 4 and fills in the rest from those and from the
    last frame. The rest is about `shared`:

    unit: samples along the side of a square that share tests of visibility, 2 or 4. share_distance: in probe
    spacings, how near to each other they must be.
    normal_agreement: smallest cosine between the normals of two points of one surface; slope: how steeply the
    way between them may leave it, and slack: by how many of the world's start margins at least.
    filter_width: standard deviation in pixels of the weights of samples around a pixel; normal_exponent: how
    fast these fall with the cosine between the normals.
    history_weight: a still pixel is the mean of about so many samples of its own. guess_weight: what an
    estimate from its neighbours counts among those. clip_margin: how far history may leave the range of the
    samples around it, in shares of that range.
    is_counted: tests of visibility are counted on the GPU (`SharedShading.counts`).
    """

    mode: ShadingMode = ShadingMode.FULL
    unit: int = 2
    share_distance: float = 0.25
    normal_agreement: float = 0.9
    slope: float = 0.2
    slack: float = 1.0
    filter_width: float = 2.0
    normal_exponent: float = 8.0
    history_weight: float = 4.0
    guess_weight: float = 1 / 256
    clip_margin: float = 0.25
    is_counted: bool = False

    def __post_init__(self) -> None:
        if self.unit not in (2, 4):
            raise ValueError(
                f"a unit of samples that share has 2 or 4 of them along its side, not {self.unit}"
            )
        if not (self.history_weight >= 1 and 0 < self.guess_weight <= 1 and self.filter_width > 0):
            raise ValueError(
                "history_weight is 1 or more, guess_weight in (0, 1], filter_width above 0; not "
                f"{self.history_weight}, {self.guess_weight} and {self.filter_width}"
            )


@dataclass(frozen=True)
class WorldSettings:
    """How the world is searched. Shares are of the bounding diagonal of the finite primitives.

    culling: one of `CULLINGS`.
    cells: about how many cells the grid has; None follows the number of primitives.
    list_length: room for a list of that mean length at first; it grows.
    clusters: how many K-means makes; None follows the number of primitives. seed: of its first choice.
    culled_share: how much of pi times the largest radiance the irradiance of any point in the volume of the
    probes may change by leaving out primitives that are far and small (`runtime.culling`); 0 leaves out none.
    hit_distance_share: a ray this near to a surface has met it.
    start_margin: free distance, metres, that a look from a surface starts with (None: `start_margin_share`).
    start_limit: how far, metres, a point that lies inside a primitive may be moved out, about twice the
    fit's error (None: `start_limit_share`).
    """

    culling: str = "grid"
    cells: int | None = None
    list_length: int = 16
    clusters: int | None = None
    seed: int = 0
    culled_share: float = 0.0
    hit_distance_share: float = 1e-5
    start_margin: float | None = None
    start_margin_share: float = 5e-4
    start_limit: float | None = None
    start_limit_share: float = 1e-2

    def __post_init__(self) -> None:
        if self.culling not in CULLINGS:
            raise ValueError(f"culling {self.culling!r} is not known; use {', '.join(CULLINGS)}")
        if self.list_length < 1 or (self.cells is not None and self.cells < 1):
            raise ValueError("cells and list_length must be at least 1")
        if self.clusters is not None and self.clusters < 1:
            raise ValueError(f"{self.clusters} clusters; there must be at least 1")
        if not 0 <= self.culled_share < 1:
            raise ValueError(f"culled_share is {self.culled_share}; it must be at least 0 and below 1")


@dataclass(frozen=True)
class RenderSettings:
    """Everything about a picture but the scene, its lighting and the camera.

    size: width and height in pixels. gi: name of the global illumination technique; technique: its own
    settings, or None for its defaults. shading: how indirect light comes to the pixels. glossy: smooth
    surfaces and metals reflect, else base colour is all diffuse, as in comparisons. contact: light from what
    is near on the screen, or None. exposure: stops (EV), never automatic. max_texture_size: wider textures
    are halved until they fit. world: how the primitives are searched.
    """

    size: tuple[int, int] = (640, 360)
    gi: str = "sdfddgi"
    technique: Any = None
    glossy: bool = False
    contact: ContactSettings | None = None
    exposure: float = 0.0
    tone_curve: ToneCurve = ToneCurve.ACES
    max_texture_size: int = 2048
    shadows: ShadowSettings = field(default_factory=ShadowSettings)
    world: WorldSettings = field(default_factory=WorldSettings)
    shading: ShadingSettings = field(default_factory=ShadingSettings)

    def __post_init__(self) -> None:
        if not all(1 <= length <= 8192 for length in self.size):
            raise ValueError(f"a picture has 1 to 8192 pixels a side, not {self.size[0]} x {self.size[1]}")


PREVIEW = RenderSettings(size=(480, 270), max_texture_size=512, shadows=ShadowSettings(map_size=1024))
"""For software renderers."""
