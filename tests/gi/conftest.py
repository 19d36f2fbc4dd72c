"""The stage on which the shared tests play: a world of primitives, a sky, lights and one technique, no
pictures.

Every test that takes the fixture `technique` runs for every technique that has indirect light.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from fit.primitives import PrimitiveSet, make_box
from fit.scene import Camera, Scene
from runtime import technique as techniques
from runtime.camera import clip_from_local
from runtime.ddgi import DdgiSettings
from runtime.device import Gpu
from runtime.direct import LightMaps
from runtime.encoder import Recorder
from runtime.probes import ProbeGrid
from runtime.sdfddgi import SdfddgiSettings
from runtime.settings import ShadowSettings
from runtime.sky import Sky, SkyMap
from runtime.technique import FrameLight, Gather
from runtime.tracer import Tracer
from runtime.world import World, WorldSettings

EIGHTH = "sdfddgi-eighth"
"""SDFDDGI that updates an eighth of its probes in a frame, and follows bounces with a quarter of the rays."""

WITH_LIGHT = [*(name for name in techniques.TECHNIQUES if name != "none"), EIGHTH]


def an_eighth(grid: ProbeGrid, **settings: Any) -> SdfddgiSettings:
    """Settings of `EIGHTH`."""
    given = {"probes_per_frame": -(-len(grid) // 8), "bounce_share": 0.25, **settings}
    return SdfddgiSettings(grid=grid, **given)


SETTINGS: dict[str, Callable[..., Any]] = {
    "sdfddgi": SdfddgiSettings,
    "ddgi": DdgiSettings,
    EIGHTH: an_eighth,
}
"""How each technique is told its probe grid (`grid`), rays (`rays_per_probe`), share of bounces
(`bounce`).
"""

FROM_BOTH_SIDES: dict[str, dict[str, Any]] = {"ddgi": {"lean_inward": False}}
"""Settings for rooms that are looked at from outside, too."""


MANY_RAYS: dict[str, dict[str, Any]] = {
    "sdfddgi": {"rays_per_probe": 1024, "settling_history": 1.0, "settling_growth": 0.0},
    "ddgi": {"rays_per_probe": 1024, "hysteresis": 0.0},
}
MANY_RAYS[EIGHTH] = {**MANY_RAYS["sdfddgi"], "probes_per_frame": None, "bounce_share": 1.0}
"""Settings of frames that stand for themselves; the mean of four is that of 4,096 rays a probe."""


LIMITS: dict[str, dict[str, str]] = {
    "ddgi": {
        "test_gradient_sky": "bilinear filtering of 8 x 8 texels is up to 6 % wrong",
        "test_closed_box_of_glowing_walls": "a hysteresis of 0.97 sums many bounces in thousands of frames",
        "test_sealed_room_is_black": "walls thinner than about half the probe spacing leak",
        "test_sealed_room_is_black_when_turned": "walls thinner than about half the probe spacing leak",
        "test_sealed_room_is_black_under_reflective_shadow_maps": "thin walls leak",
        "test_sealed_room_is_black_everywhere": "thin walls leak",
        "test_room_with_a_lamp_is_lit": "it leaks, and a lone probe has no neighbours to ask",
        "test_open_room_is_lit": "it leaks, and a lone probe has no neighbours to ask",
        "test_still": "a hysteresis of 0.97 averages about 65 frames, so that 0.7 % of noise stays",
        "test_a_lamp_that_comes_on_after_rest_arrives": "a hysteresis of 0.97 takes over 60 frames",
        "test_step_on": "a hysteresis of 0.97 takes over 40 frames",
        "test_step_off_ends_in_darkness": "a hysteresis of 0.97 takes over 60 frames",
        "test_a_moved_object_leaves_no_trail": "a hysteresis of 0.97 leaves one",
        "test_folds_behind_a_curtains_stand_in_take_the_light_of_their_own_side": "it has no start rule",
        "test_a_fold_deeper_than_the_limit_stays_on_its_side": "it leaks through the curtain",
        "test_sides_of_mouldings_look_out_through_the_nearest_face": "it has no start rule",
        "test_no_point_leaves_through_the_back_of_its_wall": "it has no start rule",
    },
    EIGHTH: {"test_still": "with an eighth of the samples, 1 % of noise is left after 256 frames"},
}
"""Shared tests that a technique, as its sources give it, cannot pass, and why."""


def _gi_of(technique: str) -> str:
    """The technique itself that a name of the fixture `technique` stands for."""
    return "sdfddgi" if technique == EIGHTH else technique


class Stage:
    """Runs a technique frame by frame and asks it for irradiance; lights and primitives may change in
    between.
    """

    def __init__(
        self,
        gpu: Gpu,
        name: str,
        primitives: PrimitiveSet,
        settings: Any = None,
        sky: Sky | None = None,
        lights: tuple[Any, ...] = (),
        world: WorldSettings | None = None,
        origin: Any = None,
        scene: Scene | None = None,
    ) -> None:
        self.world = World(gpu, scene, primitives, origin, world)
        self.technique = techniques.create(name, gpu, self.world, settings)
        self._gpu = gpu
        self._gather = Gather(gpu, self.world, self.technique)
        self._sky = SkyMap(gpu, sky or Sky())
        self._lights = LightMaps(gpu, self.world.origin, ShadowSettings(), None)
        self._lights.set(lights)
        self._light_version = 0
        self._frame = 0
        self.viewer: Any = None
        self.clip_from_local: Any = None

    def run(self, frames: int = 1) -> Stage:
        for _ in range(frames):
            rec = Recorder(self._gpu)
            self.world.record(rec)
            bindings = {**self._sky.bindings(), **self._lights.bindings()}
            frame = FrameLight(self._frame, bindings, self._light_version, self.viewer, self.clip_from_local)
            self.technique.record(rec, frame)
            rec.submit()
            self._frame += 1
        return self

    def look(self, camera: Camera, size: tuple[int, int] = (160, 90)) -> Stage:
        """Lets a camera see the following frames."""
        self.viewer = camera.world_from_local[:3, 3]
        self.clip_from_local = clip_from_local(camera, size, self.world.origin)
        return self

    def set_lights(self, *lights: Any) -> None:
        self._lights.set(lights)
        self._light_version += 1

    def set_sky(self, sky: Sky) -> None:
        self._sky.set(sky)
        self._light_version += 1

    def irradiance(self, points: Any, normals: Any) -> np.ndarray:
        return self._gather.irradiance(points, normals)


@pytest.fixture(
    params=[pytest.param(name, marks=pytest.mark.slow if name == EIGHTH else ()) for name in WITH_LIGHT]
)
def technique(request: pytest.FixtureRequest) -> str:
    """Name of each technique in turn, where it can pass."""
    limits = LIMITS.get(request.param, {})
    if request.node.originalname in limits:
        pytest.skip(f"{request.param}: {limits[request.node.originalname]}")
    return str(request.param)


@pytest.fixture
def many_rays() -> dict[str, dict[str, Any]]:
    return MANY_RAYS


@pytest.fixture
def gi_of() -> Callable[[str], str]:
    return _gi_of


@pytest.fixture
def settings_of() -> dict[str, Callable[..., Any]]:
    return SETTINGS


@pytest.fixture
def make_stage(gpu: Gpu):
    """Stage of a technique; keywords that are no argument of `Stage` are the technique's settings."""

    def make(
        name: str,
        primitives: PrimitiveSet,
        *,
        sky=None,
        lights=(),
        world=None,
        origin=None,
        scene=None,
        **settings: Any,
    ) -> Stage:
        given = SETTINGS[name](**{**FROM_BOTH_SIDES.get(name, {}), **settings})
        return Stage(gpu, _gi_of(name), primitives, given, sky, lights, world, origin, scene)

    return make


def _panels(walls: float, size: float, opening: bool) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Centres and sizes of a cubic room's walls; the opening is 2 m high and 1 m wide in the middle of +x."""
    half, outer = size / 2, size / 2 + walls
    panels = []
    for axis in range(3):
        for side in (1, -1):
            if opening and (axis, side) == (0, 1):
                continue
            centre, extent = [0.0] * 3, [2 * outer] * 3
            centre[axis], extent[axis] = side * (half + walls / 2), walls
            panels.append((tuple(centre), tuple(extent)))
    if opening:
        x, above, beside = half + walls / 2, outer - 1.0, outer - 0.5
        for side in (1, -1):
            panels.append(((x, side * (1.0 + above / 2), 0.0), (walls, above, 2 * outer)))
            panels.append(((x, 0.0, side * (0.5 + beside / 2)), (walls, 2.0, beside)))
    return panels


@pytest.fixture(scope="session")
def make_room():
    """A room, 3 m inside unless told, of boxes: `walls` metres thick, one albedo and emission, with an
    opening.
    """

    def make(
        walls: float, *, albedo: float = 0.5, emission: float = 0.0, opening: bool = False, size: float = 3.0
    ) -> PrimitiveSet:
        return PrimitiveSet.concatenate(
            [
                make_box(centre, extent, albedo=[albedo] * 3, emission=[emission] * 3)
                for centre, extent in _panels(walls, size, opening)
            ]
        )

    return make


@pytest.fixture(scope="session")
def inner_surface():
    """Points uniform by area on the inner surface of a cubic room, and their inward normals."""

    def sample(count: int, *, opening: bool = False, size: float = 3.0, seed: int = 0):
        rng = np.random.default_rng(seed)
        points = rng.uniform(-size / 2, size / 2, (count, 3))
        face = rng.integers(0, 6, count)
        axis, side = face // 2, np.where(face % 2, -1.0, 1.0)
        rows = np.arange(count)
        points[rows, axis] = side * size / 2
        normals = np.zeros((count, 3))
        normals[rows, axis] = -side
        in_opening = (face == 0) & (np.abs(points[:, 1]) < 1.0) & (np.abs(points[:, 2]) < 0.5)
        keep = ~in_opening if opening else np.ones(count, bool)
        return points[keep], normals[keep]

    return sample


@pytest.fixture(scope="session")
def grid_over():
    """Probes `spacing` metres apart over a cube of `size` metres about 0, moved by `offset` spacings."""

    def make(spacing: float, *, size: float = 3.4, offset: tuple[float, ...] = (0, 0, 0)) -> ProbeGrid:
        count = int(np.ceil(size / spacing)) + 2
        x, y, z = (spacing * (o - (count - 1) / 2) for o in offset)
        return ProbeGrid((x, y, z), spacing, (count, count, count))

    return make


@pytest.fixture(scope="session")
def surface_points(gpu: Gpu):
    """Points (n, 3) and normals (n, 3) where random rays through a box of a world's air meet its surfaces."""

    def sample(world: World, air: tuple[Any, Any], count: int) -> tuple[np.ndarray, np.ndarray]:
        rng = np.random.default_rng(0)
        starts, ways = rng.uniform(*air, (4 * count, 3)), rng.normal(size=(4 * count, 3))
        hits = Tracer(gpu, world).trace(starts, ways / np.linalg.norm(ways, axis=1, keepdims=True))
        rows = np.flatnonzero((hits.primitive >= 0) & (hits.t > 1e-3))[:count]
        return hits.position[rows], hits.normal[rows].astype(np.float64)

    return sample
