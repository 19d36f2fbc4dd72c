"""A scene of solids that is written twice: as a mesh, and as the primitives that it is made of, exactly.

Where both are the same thing no error of a fit is left, and what is wrong in a picture is the light's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from glb import Glb
from numpy.typing import ArrayLike
from shapes import Array, Shape, box, cylinder, sphere

from fit.export import write
from fit.primitives import FACES, PrimitiveSet, make_box, make_cylinder, make_sphere
from fit.rotation import matrices_from_quaternions

Triple = tuple[float, float, float]
Triple4 = tuple[float, float, float, float]

BLACK: Triple = (0.0, 0.0, 0.0)

BALL_SEGMENTS, ROD_SEGMENTS = 24, 48


@dataclass(frozen=True)
class Matter:
    """What a solid is made of: linear albedo, and emitted radiance in W/m2/sr."""

    name: str
    albedo: Triple
    emission: Triple = BLACK


class Stage:
    """Solids in the order in which they are added, into a mesh (`glb`) and a primitive set at once."""

    def __init__(self, name: str) -> None:
        self.glb = Glb(name)
        self._solids: list[PrimitiveSet] = []
        self._materials: dict[Matter, int] = {}

    def box(
        self, name: str, matter: Matter, lower: ArrayLike, upper: ArrayLike, degrees: float = 0.0
    ) -> None:
        """Between two corners, turned by an angle about the upright through its middle."""
        middle, size = self.slab(name, matter, lower, upper, degrees)
        self._part(name, matter, box(-size / 2, size / 2).turned(degrees).moved(middle))

    def slab(
        self, name: str, matter: Matter, lower: ArrayLike, upper: ArrayLike, degrees: float = 0.0
    ) -> tuple[Array, Array]:
        """A box of the set alone, for a mesh that is drawn elsewhere; returns its middle and its size."""
        low, high = np.asarray(lower, float), np.asarray(upper, float)
        middle, size = (low + high) / 2, high - low
        self._solids.append(make_box(middle, size, _upright(degrees), matter.albedo, matter.emission, name))
        return middle, size

    def panel(self, name: str, matter: Matter, lower: ArrayLike, upper: ArrayLike) -> None:
        """A lamp of the set alone that hangs under something and shines down, from its lower face."""
        low, high = np.asarray(lower, float), np.asarray(upper, float)
        emission = np.zeros((6, 3))
        emission[FACES.index("-y")] = matter.emission
        albedo = [matter.albedo] * 6
        self._solids.append(
            make_box((low + high) / 2, high - low, albedo=albedo, emission=emission, name=name)
        )

    def cylinder(self, name: str, matter: Matter, foot: Triple, radius: float, height: float) -> None:
        """Upright, standing on `foot`."""
        self._part(name, matter, cylinder(foot, radius, height, ROD_SEGMENTS))
        middle = np.asarray(foot) + np.array([0.0, height / 2, 0.0])
        self._solids.append(
            make_cylinder(middle, radius, height, albedo=matter.albedo, emission=matter.emission, name=name)
        )

    def balls(self, name: str, matter: Matter, centers: Sequence[Triple], radius: float) -> None:
        """Balls of one size: one mesh, drawn many times."""
        self.glb.part(name, self._material(matter), sphere(BLACK, radius, BALL_SEGMENTS), places=centers)
        for number, center in enumerate(centers):
            self._solids.append(
                make_sphere(center, radius, matter.albedo, matter.emission, f"{name} {number}")
            )

    def ball_mesh(self, name: str, matter: Matter, radius: float) -> int:
        """The mesh of a ball about 0 that nothing draws yet."""
        return self.glb.mesh(name, [(self._material(matter), sphere(BLACK, radius, BALL_SEGMENTS))])

    def moving_ball(
        self, name: str, matter: Matter, mesh: int, place: Triple, radius: float, times: Array, keys: Array
    ) -> None:
        """A ball that moves about `place` along a spline as `Glb.spline` has it, from the first key on."""
        rest = keys[0, 1]
        node = self.glb.carried(name, mesh, place, rest)
        self.glb.spline(node, times, keys)
        ball = make_sphere(np.asarray(place) + rest, radius, matter.albedo, matter.emission, name)
        self._solids.append(replace(ball, nodes=(node,)))

    def many(
        self, name: str, parts: Sequence[tuple[Matter, Shape]], places: Sequence[tuple[Triple, float]]
    ) -> None:
        """One mesh of several matters, at many places and turned about the upright by as many degrees."""
        mesh = self.glb.mesh(name, [(self._material(matter), shape) for matter, shape in parts])
        self.glb.instances(name, mesh, [p for p, _ in places], [_upright(degrees) for _, degrees in places])

    def many_solids(self, places: Sequence[tuple[Triple, float]], solids: Sequence[PrimitiveSet]) -> None:
        """The set of one of `many` meshes, at each of its places."""
        one = PrimitiveSet.concatenate(solids)
        for place, degrees in places:
            matrix = np.eye(4)
            matrix[:3, :3] = matrices_from_quaternions(_upright(degrees))
            matrix[:3, 3] = place
            self._solids.append(one.transformed(matrix))

    @property
    def primitives(self) -> PrimitiveSet:
        return PrimitiveSet.concatenate(self._solids)

    def write(self, path: Path) -> list[Path]:
        """Writes the mesh to `path` and the set beside it, as .npz."""
        self.glb.write(path)
        write(self.primitives, path.with_suffix(".npz"))
        return [path, path.with_suffix(".npz")]

    def _part(self, name: str, matter: Matter, shape: Shape) -> None:
        self.glb.part(name, self._material(matter), shape)

    def _material(self, matter: Matter) -> int:
        if matter not in self._materials:
            emission = matter.emission if any(matter.emission) else None
            self._materials[matter] = self.glb.material(matter.name, matter.albedo, emission=emission)
        return self._materials[matter]


def _upright(degrees: float) -> Triple4:
    """The quaternion xyzw of a turn about +Y."""
    half = np.radians(degrees) / 2
    return (0.0, float(np.sin(half)), 0.0, float(np.cos(half)))
