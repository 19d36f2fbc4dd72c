"""Which spaces are air, where light travels and no primitive may stick out: decided on evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fit.bvh import TriangleTree
from fit.grid import Grid, solid_cells
from fit.rays import RayCaster
from fit.sample import sample_surface
from fit.scene import Float64, Scene
from fit.spaces import OUTSIDE, Air, AirSpace
from fit.surface import Surface

Bool = NDArray[np.bool_]
Int32 = NDArray[np.int32]

RESOLUTION = 180
"""Cells along the bounds' diagonal."""

ROOM_FRONT = 0.85
"""A closed space is a room when at least this share of the surface around it shows its front to it.

Measured: rooms 0.98 to 1.00; hollows in and behind walls, furniture and statues 0.00 to 0.71."""

ROOM_SURFACE = 0.015
"""A room has at least this share of all the surface around it: cupboards stay shut."""

OUTSIDE_FRONT = 0.4
"""Where rooms are found, the outside is air too when it sees this share of fronts.

Measured: objects, courtyards and houses 0.68 to 1.00; the far side of a room's walls 0.01 to 0.07."""

ROOMS_VOLUME = 0.1
"""Rooms of less than this share of the grid never shut the outside out."""

POCKET_BACK = 0.7
"""From this share of directions that end on the back of a face, a point counts as inside something."""

_EVIDENCE_SAMPLES = 40_000
_POCKET_SEEDS = 12_000
_POCKET_DIRECTIONS = 32
_MIN_POCKET_CELLS = 300
_MIN_REPORTED_CELLS = 64

Seed = str | tuple[float, float, float]


@dataclass(frozen=True)
class _Space:
    """What is known of one space; `front` is the share of the surface around it that faces it."""

    number: int
    cells: int
    front: float
    surface_share: float
    double_sided: float
    cameras: tuple[str, ...]
    lights: int

    def describe(self) -> str:
        words = ["the outside" if self.number == OUTSIDE else "closed"]
        if self.surface_share > 0:
            words.append(f"{self.front:.0%} of the surface around it faces it")
            words.append(f"{self.surface_share:.1%} of all surface")
        if self.double_sided > 0.5:
            words.append(f"{self.double_sided:.0%} of that is double-sided")
        words += [f"holds camera {name!r}" for name in self.cameras]
        if self.lights:
            words.append(f"holds {self.lights} of the lights")
        return ", ".join(words)


def parse_seed(text: str) -> Seed:
    """`outside`, or `x,y,z` in metres.

    Raises:
        ValueError: neither of the two.
    """
    if text.strip().lower() == "outside":
        return "outside"
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        x = y = z = np.nan
    if not np.isfinite([x, y, z]).all():
        raise ValueError(f"air {text!r}: expected 'outside' or three numbers in metres, such as -1,0,2")
    return (x, y, z)


def find_air(
    surface: Surface,
    scene: Scene | None = None,
    *,
    resolution: float = RESOLUTION,
    seeds: Sequence[Seed] = (),
) -> Air:
    """The spaces around the surface's walls; those of the seeds are air or, without any, those with evidence.

    seeds: points, 'outside', or texts that `parse_seed` reads. `scene` gives cameras and lights as evidence.

    Raises:
        ValueError: no face stops light; or a seed lies in no space.
    """
    walls = surface.walls()
    if len(walls) == 0:
        raise ValueError(
            "no face stops light (all are see-through, or there is none), so there is nothing to fit"
        )
    tree = TriangleTree(walls.vertices)
    grid = Grid.around(*walls.bounds, resolution)
    label = ndimage.label(~solid_cells(grid, walls.vertices))[0].astype(np.int32)
    air = Air(grid, label, label > 0, (), (), (), walls, tree, RayCaster(walls.vertices, tree))
    spaces = _spaces(air, scene)
    if seeds:
        pockets = _split_pockets(air, tuple(space.number for space in spaces))
        taken = _spaces_of_seeds(air, seeds)
    else:
        taken = _spaces_with_evidence(spaces, air.label.size)
        pockets = _split_pockets(air, tuple(taken))
        taken |= {place: "a camera is in it" for _, place in _inhabitants(air, scene)[0] if place in pockets}
    return _with_decision(air, spaces, pockets, taken)


def _with_decision(air: Air, spaces: list[_Space], pockets: list[int], taken: dict[int, str]) -> Air:
    descriptions = {space.number: space.describe() for space in spaces}
    descriptions |= dict.fromkeys(pockets, "open only through a hole, backs of faces all around")
    cells = np.bincount(air.label.ravel())
    described: tuple[list[AirSpace], list[AirSpace]] = ([], [])
    for number in sorted(descriptions, key=lambda k: -cells[k]):
        if number in taken or cells[number] >= _MIN_REPORTED_CELLS:
            evidence = f"{taken.get(number, 'not taken')}: {descriptions[number]}"
            entry = AirSpace(_deepest_point(air, number), float(cells[number]) * air.cell**3, evidence)
            described[number not in taken].append(entry)
    return replace(
        air,
        free=np.isin(air.label, list(taken)),
        air_labels=tuple(sorted(taken)),
        spaces=tuple(described[0]),
        rejected=tuple(described[1]),
    )


def _deepest_point(air: Air, number: int) -> tuple[float, float, float]:
    """Centre of the cell of a space that is farthest from all others."""
    inside = air.label == number
    (box,) = ndimage.find_objects(inside.astype(np.int8))
    depth = ndimage.distance_transform_edt(np.pad(inside[box], 1))[1:-1, 1:-1, 1:-1]
    cell = np.array(np.unravel_index(int(depth.argmax()), depth.shape)) + [side.start for side in box]
    x, y, z = air.grid.centers(cell[None])[0]
    return float(x), float(y), float(z)


# ---------------------------------------------------------------------------------------------- evidence


def _spaces(air: Air, scene: Scene | None) -> list[_Space]:
    """All spaces, largest first."""
    samples = sample_surface(air.walls, _EVIDENCE_SAMPLES, seed=0)
    front, back = (
        air.labels_seen(samples.points, samples.normals),
        air.labels_seen(samples.points, -samples.normals),
    )
    double_sided = air.walls.double_sided[samples.triangle]
    size = int(air.label.max()) + 1
    cells = np.bincount(air.label.ravel(), minlength=size)
    # A sheet with the same space on both sides tells nothing of it.
    one_sided = front != back
    facing, facing_away = (np.bincount(side[one_sided], minlength=size) for side in (front, back))
    around = facing + facing_away
    double = np.bincount(front[one_sided & double_sided], minlength=size)
    double += np.bincount(back[one_sided & double_sided], minlength=size)
    cameras, lights = _inhabitants(air, scene)
    return [
        _Space(
            number,
            int(cells[number]),
            front=float(facing[number] / max(around[number], 1)),
            surface_share=float(around[number] / len(samples)),
            double_sided=float(double[number] / max(around[number], 1)),
            cameras=tuple(name for name, place in cameras if place == number),
            lights=sum(place == number for place in lights),
        )
        for number in (np.argsort(-cells[1:], kind="stable") + 1).tolist()
    ]


def _inhabitants(air: Air, scene: Scene | None) -> tuple[list[tuple[str, int]], list[int]]:
    """The space of each camera, with its name, and of each point or spot light."""
    if scene is None:
        return [], []
    names = [camera.name or str(i) for i, camera in enumerate(scene.cameras)]
    cameras = [camera.world_from_local[:3, 3] for camera in scene.cameras]
    lights = [light.world_from_local[:3, 3] for light in scene.lights if light.kind != "directional"]
    places = air.labels_at(np.array(cameras + lights).reshape(-1, 3)).tolist()
    return list(zip(names, places[: len(cameras)], strict=True)), places[len(cameras) :]


def _spaces_with_evidence(spaces: list[_Space], grid_cells: int) -> dict[int, str]:
    """Numbers of the spaces that are air, with the reason."""
    taken: dict[int, str] = {}
    for space in spaces:
        if space.cameras:
            taken[space.number] = "a camera is in it"
        elif space.number != OUTSIDE and _is_room(space):
            taken[space.number] = "a room, seen from inside"
    outside = next(space for space in spaces if space.number == OUTSIDE)
    if OUTSIDE in taken:
        return taken
    found = sum(space.cells for space in spaces if space.number in taken)
    if outside.front >= OUTSIDE_FRONT:
        taken[OUTSIDE] = "surfaces face it"
    elif found < ROOMS_VOLUME * grid_cells:
        taken[OUTSIDE] = "nothing of size speaks for another space"
    return taken


def _is_room(space: _Space) -> bool:
    return space.front >= ROOM_FRONT and space.surface_share >= ROOM_SURFACE


def _spaces_of_seeds(air: Air, seeds: Sequence[Seed]) -> dict[int, str]:
    taken: dict[int, str] = {}
    for given in seeds:
        seed = parse_seed(given) if isinstance(given, str) else given
        if isinstance(seed, str):
            taken[OUTSIDE] = "asked for"
            continue
        (number,) = air.labels_at(np.array([seed], float)).tolist()
        if number == 0:
            x, y, z = _nearest_free_center(air, np.array(seed, float))
            place = ",".join(f"{value:g}" for value in seed)
            raise ValueError(
                f"air {place}: the point lies in no free space, within {air.cell / 2:.3g} m of a surface; "
                f"the nearest free point is {x:.6g},{y:.6g},{z:.6g}"
            )
        taken[number] = "asked for"
    return taken


def _nearest_free_center(air: Air, point: Float64) -> Float64:
    centers = air.grid.centers(np.argwhere(air.label > 0))
    return centers[((centers - point) ** 2).sum(axis=1).argmin()]


# ----------------------------------------------------------------------------------------------- pockets


def _split_pockets(air: Air, within: tuple[int, ...]) -> list[int]:
    """Gives numbers of their own to insides that a hole joins to a space of `within`: an open-bottomed scan.

    From inside, nearly every direction ends on the back of a single-sided face.
    """
    free = np.isin(air.label, within)
    stride = max(2, int(np.ceil((free.sum() / _POCKET_SEEDS) ** (1 / 3))))
    lattice = np.zeros(air.grid.shape, bool)
    lattice[stride // 2 :: stride, stride // 2 :: stride, stride // 2 :: stride] = True
    seeds = np.argwhere(lattice & free)
    inside = _back_share(air, air.grid.centers(seeds)) >= POCKET_BACK
    if not inside.any():
        return []
    pieces = ndimage.label(_spread(free, seeds, inside, steps=3 * stride))[0]
    sizes, whole = np.bincount(pieces.ravel()), np.bincount(air.label.ravel())
    added: list[int] = []
    for piece in np.flatnonzero(sizes[1:] >= _MIN_POCKET_CELLS) + 1:
        cells = pieces == piece
        if sizes[piece] < whole[air.label[cells][0]]:
            added.append(len(whole) + len(added))
            air.label[cells] = added[-1]
    return added


def _back_share(air: Air, points: Float64) -> Float64:
    """Share of the directions from each point (p, 3) that end on the back of a single-sided face."""
    directions = _fibonacci_sphere(_POCKET_DIRECTIONS)
    backs = np.zeros(len(points))
    for direction in directions:
        _, triangle = air.rays.first_hit(points, np.broadcast_to(direction, points.shape))
        from_behind = air.walls.normals[triangle] @ direction > 0
        backs += (triangle >= 0) & from_behind & ~air.walls.double_sided[triangle]
    return backs / len(directions)


def _fibonacci_sphere(count: int) -> Float64:
    """Evenly spread unit vectors (count, 3)."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)


def _spread(free: Bool, seeds: NDArray[np.int64], flags: Bool, steps: int) -> Bool:
    """Free cells whose nearest seed, walking through free cells only, carries a flag."""
    state = np.zeros(free.shape, np.int8)  # 0 unknown, 1 flagged, 2 not
    state[tuple(seeds.T)] = np.where(flags, 1, 2)
    for _ in range(steps):
        previous = state.copy()
        for axis in range(3):
            for side in (slice(1, None), slice(None, -1)):
                here = tuple(side if k == axis else slice(None) for k in range(3))
                other = slice(None, -1) if side == slice(1, None) else slice(1, None)
                there = tuple(other if k == axis else slice(None) for k in range(3))
                target = state[here]
                np.copyto(target, previous[there], where=(target == 0) & free[here])
    return state == 1
