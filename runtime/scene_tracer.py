"""What the rays of a technique meet: the world's primitives, or the scene's triangles.

A tracer is a folder of shaders with three modules, chosen by the import alias `tracer`, and group 1 of the
kernels that import them:
    `package::tracer::sights`      sight_along(origin, direction, reach) -> Sight
                                   sight_is_free(origin, direction, reach) -> bool
                                   sight_start(position, normal) -> vec4f, w = 0 where there is no start
    `package::tracer::reflections` reflected_radiance(Sight) -> vec3f, of direct light
    `package::tracer::clearances`  signed_clearance(origin, direction, reach) -> f32, below 0 from inside
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

from fit.scene import Float64, Scene
from runtime.device import Gpu
from runtime.triangles import Triangles
from runtime.world import World

TRACERS = ("primitives", "triangles")


class SceneTracer(Protocol):
    """One way to trace the scene. `folder`: of its shaders. `notes`: what its user should know."""

    folder: str

    @property
    def version(self) -> int:
        """A number that changes with what it traces."""

    @property
    def notes(self) -> tuple[str, ...]: ...

    @property
    def memory(self) -> int:
        """Bytes on the GPU that it adds to the world's own."""

    def bindings(self) -> Mapping[str, Any]:
        """Group 1 of every kernel that imports it."""

    def move(self, instances: Mapping[int, Float64]) -> None:
        """Takes notice of instances of the scene that stand elsewhere (index -> world_from_local)."""


class PrimitiveTracer:
    """Sphere tracing through the primitives."""

    folder = "world"
    notes = ()
    memory = 0

    def __init__(self, world: World) -> None:
        self._world = world

    @property
    def version(self) -> int:
        return self._world.version

    def bindings(self) -> Mapping[str, Any]:
        return self._world.bindings()

    def move(self, instances: Mapping[int, Float64]) -> None:
        """Meshes move without their primitives, which `World.update` replaces."""


class TriangleTracer:
    """Rays down a tree of boxes over the scene's triangles, as ray tracing hardware has it."""

    folder = "triangles"

    def __init__(self, gpu: Gpu, scene: Scene, origin: Float64) -> None:
        self._gpu, self._scene, self._origin = gpu, scene, origin
        self._triangles = Triangles(gpu, scene, origin)
        self.version = 0

    @property
    def notes(self) -> tuple[str, ...]:
        return self._triangles.notes

    @property
    def memory(self) -> int:
        return self._triangles.memory

    def bindings(self) -> Mapping[str, Any]:
        return self._triangles.bindings()

    def move(self, instances: Mapping[int, Float64]) -> None:
        """Builds the tree anew, which takes a second or more for a large scene."""
        placed = list(self._scene.instances)
        for index, matrix in instances.items():
            placed[index] = replace(placed[index], world_from_local=matrix)
        self._scene = replace(self._scene, instances=tuple(placed))
        self._triangles = Triangles(self._gpu, self._scene, self._origin)
        self.version += 1


def open_tracer(name: str, gpu: Gpu, world: World) -> SceneTracer:
    """The tracer called `name`, one of `TRACERS`.

    Raises:
        ValueError: there is none of that name, or it needs the meshes of a scene and the world has none.
    """
    if name == "primitives":
        return PrimitiveTracer(world)
    if name != "triangles":
        raise ValueError(f"no tracer {name!r}; there are {', '.join(TRACERS)}")
    if world.scene is None:
        raise ValueError("the tracer 'triangles' needs a scene's meshes; this world has primitives alone")
    return TriangleTracer(gpu, world.scene, world.origin)
