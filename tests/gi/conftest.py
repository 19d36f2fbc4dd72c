"""The stage on which the shared tests play: a world of primitives, a sky, lights and one technique, without pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fit.primitives import PrimitiveSet
from runtime import technique
from runtime.device import Gpu, NoAdapter, open_device
from runtime.direct import LightMaps
from runtime.encoder import Recorder
from runtime.settings import ShadowSettings
from runtime.sky import Sky, SkyMap
from runtime.technique import FrameLight, Gather
from runtime.world import World, WorldSettings


class Stage:
    """Runs a technique frame by frame and asks it for irradiance; lights and primitives may change in between."""

    def __init__(
        self,
        gpu: Gpu,
        name: str,
        primitives: PrimitiveSet,
        settings: Any = None,
        sky: Sky | None = None,
        lights: tuple[Any, ...] = (),
        world: WorldSettings | None = None,
    ) -> None:
        self.gpu = gpu
        self.world = World(gpu, None, primitives, settings=world)
        self.technique = technique.create(name, gpu, self.world, settings)
        self._gather = Gather(gpu, self.world, self.technique)
        self._sky = SkyMap(gpu, sky or Sky())
        self._lights = LightMaps(gpu, self.world.origin, ShadowSettings(), None)
        self._lights.set(lights)
        self._light_version = 0
        self.frame = 0

    def run(self, frames: int = 1) -> Stage:
        for _ in range(frames):
            rec = Recorder(self.gpu)
            self.world.record(rec)
            bindings = {**self._sky.bindings(), **self._lights.bindings()}
            self.technique.record(rec, FrameLight(self.frame, bindings, self._light_version))
            rec.submit()
            self.frame += 1
        return self

    def set_lights(self, *lights: Any) -> None:
        self._lights.set(lights)
        self._light_version += 1

    def set_sky(self, sky: Sky) -> None:
        self._sky.set(sky)
        self._light_version += 1

    def irradiance(self, points: Any, normals: Any) -> np.ndarray:
        return self._gather.irradiance(points, normals)


@pytest.fixture(scope="session")
def gi_gpu() -> Gpu:
    try:
        return open_device()
    except NoAdapter as missing:
        pytest.skip(f"no GPU adapter: {missing}")


@pytest.fixture
def make_stage(gi_gpu: Gpu):
    def make(name: str, primitives: PrimitiveSet, settings: Any = None, **rest: Any) -> Stage:
        return Stage(gi_gpu, name, primitives, settings, **rest)

    return make
