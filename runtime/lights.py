"""Suns, spots and points: where they come from, and what the shaders read of them.

glTF's lux and candela are read as W/m2 and W/sr.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fit import scene as model
from fit.scene import Float64, Scene
from runtime.camera import Projection, orthographic, perspective, world_from_view
from runtime.settings import ShadowSettings
from runtime.sky import Sky
from runtime.structs import GpuStruct, f32, mat4x4f, u32, vec2f, vec3f
from runtime.twins.punctual import PUNCTUAL_POINT, PUNCTUAL_SPOT, PUNCTUAL_SUN

Triple = tuple[float, float, float]

WIDEST_MAPPED_CONE = np.radians(80)
"""A spot whose half angle is wider gets no shadow map: its perspective would be all stretch."""

DEFAULT_SUN_DIRECTION = (0.35, 1.0, 0.25)
DEFAULT_SUN_IRRADIANCE = 4.0
DEFAULT_SKY = (0.5, 0.5, 0.5)


class Light(GpuStruct):
    clip_from_local: mat4x4f
    local_from_light: mat4x4f
    color: vec3f
    kind: u32
    position: vec3f
    range: f32
    axis: vec3f
    has_tile: u32
    tile_corner: vec2f
    extent: vec2f
    depth_map: vec2f
    tile_size: f32
    texel_size: f32
    angle_scale: f32
    angle_offset: f32


class Lighting(GpuStruct):
    atlas_size: vec2f
    count: u32
    rsm_tolerance: f32
    rsm_normal_agreement: f32


@dataclass(frozen=True)
class Sun:
    """Parallel light of no angular size. direction: towards the sun, of any length; irradiance: W/m2 on a
    surface that faces it."""

    direction: Triple
    irradiance: Triple | float = DEFAULT_SUN_IRRADIANCE

    def __post_init__(self) -> None:
        if not np.linalg.norm(self.direction) > 0:
            raise ValueError("a sun needs a direction towards it that is not 0,0,0")

    @property
    def color(self) -> Triple:
        return _triple(self.irradiance)

    def describe(self) -> str:
        return f"sun from {_short(self.direction)}, {_short(self.color)} W/m2"


@dataclass(frozen=True)
class Point:
    """A lamp without size: intensity in W/sr; light ends at `range` metres (inf: never)."""

    position: Triple
    intensity: Triple | float
    range: float = float("inf")

    @property
    def color(self) -> Triple:
        return _triple(self.intensity)

    def describe(self) -> str:
        return f"point at {_short(self.position)}, {_short(self.color)} W/sr"


@dataclass(frozen=True)
class Spot:
    """A cone of light along `axis`; half angles in radians, full strength inside the inner one."""

    position: Triple
    axis: Triple
    intensity: Triple | float
    inner_cone_angle: float = 0.0
    outer_cone_angle: float = float(np.pi / 4)
    range: float = float("inf")

    @property
    def color(self) -> Triple:
        return _triple(self.intensity)

    def describe(self) -> str:
        return f"spot at {_short(self.position)}, {_short(self.color)} W/sr"


AnyLight = Sun | Spot | Point


@dataclass(frozen=True)
class Illumination:
    """The lights and the sky that are on, and notes on how they were chosen."""

    lights: tuple[AnyLight, ...] = ()
    sky: Sky = field(default_factory=Sky)
    notes: tuple[str, ...] = ()

    def describe(self) -> tuple[str, ...]:
        """One line for each light and the sky."""
        return (*(light.describe() for light in self.lights), self.sky.describe())


def file_lights(scene: Scene) -> tuple[AnyLight, ...]:
    """The scene's own punctual lights."""
    return tuple(_file_light(light) for light in scene.lights)


def choose_illumination(
    scene: Scene, sun: Sun | None = None, sky: Sky | None = None, *, keep_file_lights: bool = False
) -> Illumination:
    """What is on: a given sun or sky switches the file's lights off unless they are asked for.

    A scene with no light of its own, neither lamps nor emission, gets a default sun and a white sky, and a
    note.
    """
    given = sun is not None or sky is not None
    from_file = file_lights(scene) if keep_file_lights or not given else ()
    lights = (*(() if sun is None else (sun,)), *from_file)
    notes: list[str] = []
    if scene.lights and not from_file:
        notes.append(f"{len(scene.lights)} lights of the file are off")
    emits = any(any(material.emission) for material in scene.materials)
    if not given and not lights and not emits:
        notes.append("the file has no light: a default sun and sky are on")
        return Illumination(
            (Sun(DEFAULT_SUN_DIRECTION, DEFAULT_SUN_IRRADIANCE),), Sky.constant(DEFAULT_SKY), tuple(notes)
        )
    return Illumination(lights, sky or Sky(), tuple(notes))


@dataclass(frozen=True)
class Tile:
    """A light's square in the shadow atlas, in texels, and the view that is drawn into it."""

    light: int
    corner: tuple[int, int]
    size: int
    local_from_light: Float64
    projection: Projection

    @property
    def clip_from_local(self) -> Float64:
        return self.projection.clip_from_view @ np.linalg.inv(self.local_from_light)

    @property
    def texel_size(self) -> float:
        """Metres of a texel's longer side: of a sun anywhere, of a spot one metre away."""
        return 2 * max(self.projection.extent) / self.size


def plan_tiles(
    lights: Sequence[AnyLight],
    bounds: tuple[Float64, Float64] | None,
    origin: Float64,
    settings: ShadowSettings,
) -> tuple[tuple[Tile, ...], tuple[int, int]]:
    """A tile for each sun and spot that gets one, and the atlas size (width, height).

    bounds: world-space box around what casts shadows, None when nothing does; then nobody needs a tile.
    Suns stand in a column of full tiles, spots below them in pairs of half ones.
    """
    tiles: list[Tile] = []
    size, half = settings.map_size, settings.map_size // 2
    suns = [i for i, light in enumerate(lights) if isinstance(light, Sun)][: settings.max_suns]
    spots = [i for i, light in enumerate(lights) if isinstance(light, Spot) and _is_narrow(light)]
    spots = spots[: settings.max_spots]
    if bounds is None:
        return (), (1, 1)
    for row, i in enumerate(suns):
        tiles.append(_sun_tile(lights[i], i, (0, row * size), size, bounds, origin))  # type: ignore[arg-type]
    for k, i in enumerate(spots):
        corner = (k % 2 * half, len(suns) * size + k // 2 * half)
        tiles.append(_spot_tile(lights[i], i, corner, half, bounds, origin))  # type: ignore[arg-type]
    if not tiles:
        return (), (1, 1)
    width = size if suns or len(spots) > 1 else half
    return tuple(tiles), (width, len(suns) * size + (len(spots) + 1) // 2 * half)


def untiled_notes(lights: Sequence[AnyLight], tiles: Sequence[Tile]) -> tuple[str, ...]:
    """What to tell about suns and spots that got no shadow map."""
    mapped = {tile.light for tile in tiles}
    count = sum(i not in mapped and not isinstance(light, Point) for i, light in enumerate(lights))
    return (f"{count} suns or spots have no shadow map and are shadowed by tracing the primitives",) * (
        count > 0
    )


def light_records(lights: Sequence[AnyLight], tiles: Sequence[Tile], origin: Float64) -> np.ndarray:
    """(n,) records of `Light`, at least one (of no strength) because an empty buffer cannot be bound."""
    records = np.zeros(max(len(lights), 1), Light.dtype)
    by_light = {tile.light: tile for tile in tiles}
    for i, light in enumerate(lights):
        records[i] = _record(light, by_light.get(i), origin)
    return records


def _record(light: AnyLight, tile: Tile | None, origin: Float64) -> np.ndarray:
    values = {
        "clip_from_local": np.eye(4) if tile is None else tile.clip_from_local,
        "local_from_light": np.eye(4) if tile is None else tile.local_from_light,
        "color": light.color,
        "has_tile": int(tile is not None),
        "tile_corner": (0.0, 0.0) if tile is None else tile.corner,
        "tile_size": 1.0 if tile is None else tile.size,
        "texel_size": 0.0 if tile is None else tile.texel_size,
        "extent": (1.0, 1.0) if tile is None else tile.projection.extent,
        "depth_map": (0.0, 1.0) if tile is None else tile.projection.depth_map,
        "kind": {Sun: PUNCTUAL_SUN, Spot: PUNCTUAL_SPOT, Point: PUNCTUAL_POINT}[type(light)],
        "position": np.zeros(3),
        "axis": (0.0, -1.0, 0.0),
        "range": 0.0,
        "angle_scale": 0.0,
        "angle_offset": 1.0,
    }
    if isinstance(light, Sun):
        values["axis"] = -_unit(light.direction)
        return Light.pack(**values)
    values["position"] = np.asarray(light.position, np.float64) - origin
    values["range"] = light.range if np.isfinite(light.range) else 0.0
    if isinstance(light, Spot):
        values["axis"] = _unit(light.axis)
        spread = max(np.cos(light.inner_cone_angle) - np.cos(light.outer_cone_angle), 1e-3)
        values["angle_scale"] = 1 / spread
        values["angle_offset"] = -np.cos(light.outer_cone_angle) / spread
    return Light.pack(**values)


def _sun_tile(
    sun: Sun, light: int, corner: tuple[int, int], size: int, bounds: tuple[Float64, Float64], origin: Float64
) -> Tile:
    """The tightest parallel view of the bounds along the sun's rays."""
    towards = _unit(sun.direction)
    corners = _corners(bounds) - origin
    turned = world_from_view(towards, np.zeros(3))
    turned[:3, 3] = 0.0
    seen = corners @ turned[:3, :3]
    lower, upper = seen.min(axis=0), seen.max(axis=0)
    margin = max(1e-3 * float(np.linalg.norm(upper - lower)), 1e-6)
    lower, upper = lower - margin, upper + margin
    center = np.array([(lower[0] + upper[0]) / 2, (lower[1] + upper[1]) / 2, upper[2]])
    turned[:3, 3] = turned[:3, :3] @ center
    half_width, half_height = (upper[:2] - lower[:2]) / 2
    lens = orthographic(float(half_width), float(half_height), 0.0, float(upper[2] - lower[2]))
    return Tile(light, corner, size, turned, lens)


def _spot_tile(
    spot: Spot,
    light: int,
    corner: tuple[int, int],
    size: int,
    bounds: tuple[Float64, Float64],
    origin: Float64,
) -> Tile:
    """The perspective view down the cone. What is nearer than the near plane casts no shadow."""
    position = np.asarray(spot.position, np.float64) - origin
    view = world_from_view(position, position + _unit(spot.axis))
    reach = float(np.linalg.norm(_corners(bounds) - origin - position, axis=1).max())
    lens = perspective(2 * spot.outer_cone_angle, 1.0, max(1e-4 * reach, 1e-6))
    return Tile(light, corner, size, view, lens)


def _corners(bounds: tuple[Float64, Float64]) -> Float64:
    return np.array([[bounds[(k >> axis) & 1][axis] for axis in range(3)] for k in range(8)])


def _is_narrow(light: Spot) -> bool:
    return light.outer_cone_angle <= WIDEST_MAPPED_CONE


def _file_light(light: model.Light) -> AnyLight:
    axis = _triple(-_unit(light.world_from_local[:3, 2]))
    position = _triple(light.world_from_local[:3, 3])
    strength = _triple(np.asarray(light.color, np.float64) * light.intensity)
    if light.kind is model.LightKind.DIRECTIONAL:
        return Sun(_triple(-np.asarray(axis)), strength)
    if light.kind is model.LightKind.POINT:
        return Point(position, strength, light.range)
    return Spot(position, axis, strength, light.inner_cone_angle, light.outer_cone_angle, light.range)


def _unit(vector: Triple | Float64) -> Float64:
    values = np.asarray(vector, np.float64)
    return values / np.linalg.norm(values)


def _triple(value: float | Sequence[float] | Float64) -> Triple:
    r, g, b = np.broadcast_to(np.asarray(value, np.float64), 3).tolist()
    return r, g, b


def _short(values: Sequence[float]) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in values) + ")"
