"""The technique "none": no indirect light at all."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from runtime.device import Gpu
from runtime.encoder import Recorder
from runtime.resources import Texture
from runtime.scene_tracer import PrimitiveTracer
from runtime.technique import Drawing, FrameLight
from runtime.world import World


class NoGi:
    """Nothing to own and nothing to do; its lookup returns 0."""

    name = "none"
    shares_tests = False
    memory = 0
    volume = None

    def __init__(self, gpu: Gpu, world: World, settings: Any = None) -> None:
        if settings is not None:
            raise ValueError("the technique 'none' has no settings")
        self.tracer = PrimitiveTracer(world)

    def record(self, rec: Recorder, frame: FrameLight) -> None:
        return

    def lookup_bindings(self) -> Mapping[str, Any]:
        return {}

    def reset(self) -> None:
        return

    def views(self) -> Mapping[str, Texture]:
        return {}

    def drawings(self) -> Mapping[str, Drawing]:
        return {}
