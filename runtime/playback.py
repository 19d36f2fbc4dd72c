"""What of a scene an animation moves: drawn instances, the file's lights, and primitives with their nodes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fit import motion
from fit.primitives import PrimitiveSet
from fit.scene import Float64, Scene
from runtime.lights import AnyLight, file_lights


class Playback:
    """One scene's animations, asked by seconds; `fit.motion` says how they play."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        movers = motion.movers(scene)
        self._moving = [
            i
            for i, one in enumerate(scene.instances)
            if one.node_from_local is not None and 0 <= one.node < len(movers) and movers[one.node] >= 0
        ]
        self._lights = file_lights(scene)

    @property
    def moves(self) -> bool:
        """Whether anything does."""
        return bool(self.scene.animations)

    def instances(self, seconds: float) -> dict[int, Float64]:
        """world_from_local of the drawn instances that ever move, by their index."""
        world = motion.node_matrices(self.scene, seconds)
        there = self.scene.instances
        return {i: world[there[i].node] @ _copy(there[i].node_from_local) for i in self._moving}

    def primitives(self, rest: PrimitiveSet, seconds: float) -> PrimitiveSet:
        """A set that was fitted to the scene at rest.

        Raises:
            ValueError: the set belongs to another scene.
        """
        return motion.posed_primitives(rest, self.scene, seconds)

    def lights(self, lights: Sequence[AnyLight], seconds: float) -> tuple[AnyLight, ...]:
        """`lights`, those of the file where they are at that time; others stay. To be asked in turn, each
        time with the last answer."""
        now = file_lights(motion.posed(self.scene, seconds)) if self._lights else ()
        taken = list(self._lights)
        moved: list[AnyLight] = []
        for light in lights:
            index = taken.index(light) if light in taken else None
            moved.append(light if index is None else now[index])
            if index is not None:
                taken[index] = None  # type: ignore[call-overload]  # of two equal lights, each once
        self._lights = now
        return tuple(moved)


def _copy(node_from_local: Float64 | None) -> Float64:
    return np.eye(4) if node_from_local is None else node_from_local
