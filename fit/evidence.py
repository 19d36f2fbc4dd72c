"""What speaks for each space being air: the sides its surfaces show, and who and what is in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import trimesh
from numpy.typing import NDArray

from fit.bvh import column_extremes
from fit.sample import Samples, sample_surface
from fit.scene import Float64, Scene
from fit.spaces import OUTSIDE, Air

Bool = NDArray[np.bool_]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]

ROOM_FRONT = 0.85
"""A closed space is a room when at least this share of the surface around it shows its front to it.

Measured: rooms 0.98 to 1.00; hollows in and behind walls, furniture and statues 0.00 to 0.71."""

ROOM_SURFACE = 0.015
"""A room has at least this share of all the surface around it: cupboards stay shut."""

DOUBLE_SIDED = 0.5
"""From this double-sided share of the surface around it on, the fronts say little of a closed space."""

FLAT_WALLS = 0.5
"""Share of the hull in its six most frequent directions: rooms over 0.8, bodies and bulbs under 0.3."""

ROOM_CONTENTS = 0.003
"""Share of all surface that things must have which stand in a room and show it their fronts."""

STRAY = 0.01
"""Share of a piece's samples that may show elsewhere: rays at its seams."""

_SAMPLES = 40_000
WELD_DIGITS = 6

_DIRECTION_STEPS = 20
"""Normals are told apart to about three degrees."""


@dataclass(frozen=True)
class Space:
    """What is known of one space.

    front: share of the surface around it that shows its front to it; surface_share: of all surface;
    double_sided: share of that around it; contents, contents_outside: share of all surface on pieces wholly
    within it, and wholly within the outside; flat_walls: share of the hull in its six main directions.
    """

    number: int
    cells: int
    front: float
    surface_share: float
    double_sided: float
    cameras: tuple[str, ...]
    lights: int
    contents: float = 0.0
    contents_outside: float = 0.0
    flat_walls: float = 0.0

    def describe(self) -> str:
        """The evidence in words."""
        words = ["the outside" if self.number == OUTSIDE else "closed"]
        if self.surface_share > 0:
            words.append(f"{self.front:.0%} of the surface around it faces it")
            words.append(f"{self.surface_share:.1%} of all surface")
        if self.double_sided > DOUBLE_SIDED:
            words.append(f"{self.double_sided:.0%} of that is double-sided")
        words += [f"holds camera {name!r}" for name in self.cameras]
        if self.lights:
            words.append(f"holds {self.lights} of the lights")
        if self.contents > 0:
            words.append(f"things in it have {self.contents:.1%} of all surface")
        elif self.is_undecided:
            words.append("nothing is in it" if not self.lights else "nothing else is in it")
        return ", ".join(words)

    @property
    def shows_fronts(self) -> bool:
        """Whether the surface around a closed space of some size was made to be seen from it."""
        return self.front >= ROOM_FRONT and self.surface_share >= ROOM_SURFACE

    @property
    def is_undecided(self) -> bool:
        """Whether fronts can't tell a room from a solid: closed, and double-sided for the most part."""
        return (
            self.number != OUTSIDE
            and not self.shows_fronts
            and self.double_sided >= DOUBLE_SIDED
            and self.surface_share >= ROOM_SURFACE
        )

    def reason(self) -> str | None:
        """Why a closed space is a room, or None."""
        if self.shows_fronts:
            return "a room, seen from inside"
        if not self.is_undecided:
            return None
        is_furnished = self.contents >= max(ROOM_CONTENTS, self.contents_outside)
        if self.flat_walls >= FLAT_WALLS and self.lights:
            return "a room with a light in it"
        if self.flat_walls >= FLAT_WALLS and is_furnished:
            return "a room with things in it"
        return "a light and things are in it" if self.lights and is_furnished else None


def weigh_spaces(air: Air, scene: Scene | None) -> list[Space]:
    """All spaces with their evidence, largest first; `scene` tells of cameras and lights."""
    samples = sample_surface(air.walls, _SAMPLES, seed=0)
    front, back = (air.labels_seen(samples.points, sign * samples.normals) for sign in (1, -1))
    double_sided = air.walls.double_sided[samples.triangle]
    size = int(air.label.max()) + 1
    cells = np.bincount(air.label.ravel(), minlength=size)
    # A sheet with the same space on both sides tells nothing of it.
    one_sided = front != back
    facing, facing_away = (np.bincount(side[one_sided], minlength=size) for side in (front, back))
    around = facing + facing_away
    double = np.bincount(front[one_sided & double_sided], minlength=size)
    double += np.bincount(back[one_sided & double_sided], minlength=size)
    cameras, lights = inhabitants(air, scene)
    spaces = [
        Space(
            number,
            int(cells[number]),
            front=float(facing[number] / max(around[number], 1)),
            surface_share=float(around[number] / max(len(samples), 1)),
            double_sided=float(double[number] / max(around[number], 1)),
            cameras=tuple(name for name, place in cameras if place == number),
            lights=sum(place == number for place in lights),
        )
        for number in (np.argsort(-cells[1:], kind="stable") + 1).tolist()
    ]
    return _with_contents(spaces, air, samples, front, back)


def inhabitants(air: Air, scene: Scene | None) -> tuple[list[tuple[str, int]], list[int]]:
    """The space of each camera, with its name, and of each point or spot light."""
    if scene is None:
        return [], []
    names = [camera.name or str(i) for i, camera in enumerate(scene.cameras)]
    cameras = [camera.world_from_local[:3, 3] for camera in scene.cameras]
    lights = [light.world_from_local[:3, 3] for light in scene.lights if light.kind != "directional"]
    places = air.labels_at(np.array(cameras + lights).reshape(-1, 3)).tolist()
    return list(zip(names, places[: len(cameras)], strict=True)), places[len(cameras) :]


# ----------------------------------------------------------------------------------------------- contents


def _with_contents(spaces: list[Space], air: Air, samples: Samples, front: Int32, back: Int32) -> list[Space]:
    """The spaces that fronts can't judge, with what is in them. Only these need the mesh's connectivity."""
    if not any(space.is_undecided for space in spaces):
        return spaces
    piece = connected_pieces(air.walls.vertices)[samples.triangle]
    outside = _shown_to(OUTSIDE, piece, front)
    weighed = []
    for space in spaces:
        if space.is_undecided:
            inside = _shown_to(space.number, piece, front)
            is_hull = np.bincount(piece, weights=back == space.number)[piece] > 0
            space = replace(
                space,
                contents=float(inside.mean()),
                contents_outside=float((outside & ~is_hull).mean()),
                flat_walls=_flatness(samples.normals[(back == space.number) & ~inside]),
            )
        weighed.append(space)
    return weighed


def _shown_to(number: int, piece: Int64, front: Int32) -> Bool:
    """Samples (p,) on pieces (p,) that show their fronts (p,) to one space alone."""
    elsewhere = np.bincount(piece, weights=(front != number) & (front > 0))
    here = np.bincount(piece, weights=front == number)
    return ((here > 0) & (elsewhere <= STRAY * here))[piece]


def _flatness(normals: Float64) -> float:
    """Share of the normals (n, 3) in the six most frequent directions."""
    if len(normals) == 0:
        return 0.0
    counts = np.unique(np.rint(normals * _DIRECTION_STEPS), axis=0, return_counts=True)[1]
    return float(np.sort(counts)[-6:].sum() / len(normals))


def connected_pieces(vertices: Float64) -> Int64:
    """The connected piece (t,) of each triangle (t, 3, 3); corners nearer than 1e-6 of the size are one."""
    points = vertices.reshape(-1, 3)
    lower, upper = column_extremes(points)
    size = max(float((upper - lower).max()), np.finfo(float).tiny)
    corner = trimesh.grouping.unique_rows((points - lower) / size, digits=WELD_DIGITS)[1].reshape(-1, 3)
    links = np.concatenate([corner[:, [0, 1]], corner[:, [1, 2]]])
    of_corner = trimesh.graph.connected_component_labels(links, node_count=int(corner.max()) + 1)
    return of_corner[corner[:, 0]].astype(np.int64)
