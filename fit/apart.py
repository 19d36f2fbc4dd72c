"""Bodies that are fitted apart: each that an animation moves, and, where asked for, each that is drawn often.

Air and parts are found in a body alone, in its own space, so that its primitives are right wherever it goes.
Bodies of one shape are fitted once and placed many times.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fit.motion import movers
from fit.primitives import PrimitiveSet
from fit.scene import Float64, Instance, Scene
from fit.settings import FitSettings
from fit.surface import from_scene

STANDS = -1

SAME_DIGITS = 6
"""Decimals to which matrices of bodies of one shape agree."""


@dataclass(frozen=True)
class Body:
    """What is fitted by itself: a scene in the body's own space, and where it is placed.

    places: world_from_body (4, 4), rigid, of each copy at rest; nodes: the scene's node that each moves with,
    `STANDS` for none; instances: those of the whole scene that the first copy draws; area of its faces that
    stop light, m2.
    """

    name: str
    scene: Scene
    places: tuple[Float64, ...]
    nodes: tuple[int, ...]
    instances: tuple[int, ...]
    area: float

    @property
    def moves(self) -> bool:
        return self.nodes[0] != STANDS

    def place(self, primitives: PrimitiveSet) -> PrimitiveSet:
        """The body's primitives at each of its places, knowing the nodes that they move with."""
        return PrimitiveSet.concatenate(
            [
                replace(primitives.transformed(place), nodes=(node,) * len(primitives))
                for place, node in zip(self.places, self.nodes, strict=True)
            ]
        )


def find_bodies(scene: Scene, *, instancing: bool = False) -> tuple[Body, ...]:
    """The bodies of a scene, what stands as a whole last; none where the scene is best fitted as a whole.

    instancing: what stands and is drawn more than once, in one shape, is a body too. Bodies without a face
    that stops light are left out.
    """
    moved_by = movers(scene)
    shapes: dict[Hashable, list[tuple[int, Float64, list[int]]]] = {}
    rest: list[int] = []
    for node, members in _units(scene, moved_by, instancing):
        place = _rigid(
            scene.nodes[node].world_from_local if node >= 0 else scene.instances[members[0]].world_from_local
        )
        shapes.setdefault(_shape(scene, members, place, node >= 0), []).append((node, place, members))
    bodies = []
    for copies in shapes.values():
        node, place, members = copies[0]
        if node == STANDS and len(copies) == 1:
            rest += members
            continue
        bodies.append(_body(scene, members, place, tuple(c[1] for c in copies), tuple(c[0] for c in copies)))
    if not bodies:
        return ()
    if rest:
        bodies.append(_body(scene, sorted(rest), np.eye(4), (np.eye(4),), (STANDS,)))
    return tuple(body for body in bodies if body.area > 0)


def budgets(bodies: Sequence[Body], settings: FitSettings) -> list[int | None]:
    """Most primitives of one copy of each body, None without a budget; 0 for the smallest bodies where it has
    no room for all.

    Every copy has one at least; the rest goes by the square root of areas.
    """
    if not settings.has_budget:
        return [None] * len(bodies)
    counts = np.array([len(body.places) for body in bodies])
    areas = np.array([body.area for body in bodies])
    largest_first = np.argsort(-areas, kind="stable")
    has_room = np.zeros(len(bodies), bool)
    has_room[largest_first] = np.cumsum(counts[largest_first]) <= settings.limit()
    weights = np.where(has_room, np.sqrt(areas), 0.0)
    left = settings.limit() - int(counts[has_room].sum())
    shares = np.floor(left * weights / max(float(counts @ weights), 1e-300)).astype(int)
    for i in largest_first[has_room[largest_first]]:  # what rounding has left over
        shares[i] += (left - int(counts @ shares)) // counts[i]
    return [int(share) + 1 if room else 0 for share, room in zip(shares, has_room, strict=True)]


def settings_of(body: Body, limit: int | None, settings: FitSettings) -> FitSettings:
    """How a body is fitted: within its budget, and with the seeds of the air only for what stands."""
    stands_alone = not body.moves and len(body.places) == 1
    return replace(
        settings,
        max_primitives=limit,
        max_bytes=None,
        preset=None,
        skip_below=settings.least_share(),
        air=settings.air if stands_alone else (),
    )


def _units(scene: Scene, moved_by: np.ndarray, instancing: bool) -> Iterator[tuple[int, list[int]]]:
    """Instances that belong together, and the node that moves them: a node's meshes, and all below it."""
    units: dict[Hashable, list[int]] = {}
    for i, one in enumerate(scene.instances):
        follows = 0 <= one.node < len(moved_by) and one.node_from_local is not None
        node = int(moved_by[one.node]) if follows else STANDS
        copy = one.world_from_local.tobytes() if instancing and node == STANDS else b""
        own = one.node if instancing and node == STANDS else STANDS
        units.setdefault((node, own, copy), []).append(i)
    for (node, *_), members in units.items():  # type: ignore[misc]
        yield node, members


def _shape(scene: Scene, members: list[int], place: Float64, moves: bool) -> Hashable:
    """Equal for bodies that are congruent: the same meshes in the same places of their own spaces."""
    inverse = np.linalg.inv(place)
    key = [
        (scene.instances[i].mesh, np.round(inverse @ scene.instances[i].world_from_local, SAME_DIGITS) + 0.0)
        for i in members
    ]
    return (moves, *((mesh, matrix.tobytes()) for mesh, matrix in key))


def _rigid(matrix: Float64) -> Float64:
    """The move and the nearest rotation of an affine matrix."""
    left, _, right = np.linalg.svd(matrix[:3, :3])
    left[:, 2] *= np.sign(np.linalg.det(left @ right))
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = left @ right, matrix[:3, 3]
    return result


def _body(
    scene: Scene, members: list[int], place: Float64, places: tuple[Float64, ...], nodes: tuple[int, ...]
) -> Body:
    inverse = np.linalg.inv(place)
    drawn = [scene.instances[i] for i in members]
    alone = replace(
        scene,
        instances=tuple(Instance(one.mesh, one.node, inverse @ one.world_from_local) for one in drawn),
        animations=(),
    )
    surface = from_scene(alone)
    name = scene.nodes[nodes[0]].name if nodes[0] >= 0 else scene.meshes[drawn[0].mesh].name
    area = float(surface.areas[surface.is_wall].sum())
    return Body(name, alone, places, nodes, tuple(members), area)
