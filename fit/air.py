"""Which spaces are air, where light travels and no primitive may stick out: decided on evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fit.bvh import TriangleTree
from fit.evidence import Space, inhabitants, weigh_spaces
from fit.grid import Grid, solid_cells
from fit.passages import find_passages
from fit.rays import RayCaster
from fit.scene import Float64, Scene
from fit.spaces import OUTSIDE, Air, AirSpace
from fit.surface import Surface

Bool = NDArray[np.bool_]
Int32 = NDArray[np.int32]

RESOLUTION = 180
"""Cells along the bounds' diagonal."""

OUTSIDE_FRONT = 0.4
"""Where rooms are found, the outside is air too when it sees this share of fronts.

Measured: objects, courtyards and houses 0.68 to 1.00; the far side of a room's walls 0.01 to 0.07."""

ROOMS_VOLUME = 0.1
"""Rooms of less than this share of the grid never shut the outside out."""

POCKET_BACK = 0.7
"""From this share of directions that end on the back of a face, a point counts as inside something."""

_POCKET_SEEDS = 12_000
_POCKET_DIRECTIONS = 32
_MIN_POCKET_CELLS = 300
_MIN_REPORTED_CELLS = 64

Seed = str | tuple[float, float, float]


class LostSeed(ValueError):
    """A seed of the air lies in no free space but within `room` of a surface; `nearest` is a free point."""

    def __init__(
        self, seed: tuple[float, float, float], nearest: tuple[float, float, float], room: float
    ) -> None:
        place = ",".join(f"{value:g}" for value in seed)
        x, y, z = nearest
        super().__init__(
            f"air {place}: the point lies in no free space, within {room:.3g} m of a surface; "
            f"the nearest free point is {x:.6g},{y:.6g},{z:.6g}"
        )
        self.seed, self.nearest, self.room = seed, nearest, room


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
    air = Air(grid, label, label > 0, (), (), (), (), walls, tree, RayCaster(walls.vertices, tree))
    spaces = weigh_spaces(air, scene)
    if seeds:
        pockets = _split_pockets(air, tuple(space.number for space in spaces))
        taken = _spaces_of_seeds(air, seeds)
    else:
        taken = _spaces_with_evidence(spaces, air.label.size)
        pockets = _split_pockets(air, tuple(taken))
        taken |= {place: "a camera is in it" for _, place in inhabitants(air, scene)[0] if place in pockets}
    return _with_decision(air, spaces, pockets, taken)


def _with_decision(air: Air, spaces: list[Space], pockets: list[int], taken: dict[int, str]) -> Air:
    descriptions = {space.number: space.describe() for space in spaces}
    descriptions |= dict.fromkeys(pockets, "open only through a hole, backs of faces all around")
    cells = np.bincount(air.label.ravel())
    described: tuple[list[AirSpace], list[AirSpace]] = ([], [])
    for number in sorted(descriptions, key=lambda k: -cells[k]):
        if number in taken or cells[number] >= _MIN_REPORTED_CELLS:
            evidence = f"{taken.get(number, 'not taken')}: {descriptions[number]}"
            entry = AirSpace(_deepest_point(air, number), float(cells[number]) * air.cell**3, evidence)
            described[number not in taken].append(entry)
    air_labels = tuple(sorted(taken))
    return replace(
        air,
        free=np.isin(air.label, air_labels),
        air_labels=air_labels,
        passages=tuple(find_passages(air.grid, air.label, air_labels, air.tree, air.rays)),
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


def _spaces_with_evidence(spaces: list[Space], grid_cells: int) -> dict[int, str]:
    """Numbers of the spaces that are air, with the reason."""
    taken: dict[int, str] = {}
    for space in spaces:
        if space.cameras:
            taken[space.number] = "a camera is in it"
        elif space.number != OUTSIDE and (reason := space.reason()):
            taken[space.number] = reason
    outside = next(space for space in spaces if space.number == OUTSIDE)
    if OUTSIDE in taken:
        return taken
    found = sum(space.cells for space in spaces if space.number in taken)
    if outside.front >= OUTSIDE_FRONT:
        taken[OUTSIDE] = "surfaces face it"
    elif found < ROOMS_VOLUME * grid_cells:
        taken[OUTSIDE] = "nothing of size speaks for another space"
    return taken


def _spaces_of_seeds(air: Air, seeds: Sequence[Seed]) -> dict[int, str]:
    taken: dict[int, str] = {}
    for given in seeds:
        seed = parse_seed(given) if isinstance(given, str) else given
        if isinstance(seed, str):
            taken[OUTSIDE] = "asked for"
            continue
        (number,) = air.labels_at(np.array([seed], float)).tolist()
        if number == 0:
            x, y, z = _nearest_free_center(air, np.array(seed, float)).tolist()
            raise LostSeed(seed, (x, y, z), air.cell / 2)
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
