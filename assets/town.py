"""A town of a square kilometre to fly over: `python assets/town.py FOLDER` writes town.glb and town.npz.

Too large to be committed: 1,700 houses and 500 trees of seventeen meshes, 8,249 primitives.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from shapes import Shape, box, cylinder, join, sphere
from stage import Matter, Stage, Triple

from fit.primitives import make_box, make_cylinder, make_sphere

SIDE, BLOCK, STREET = 1000.0, 62.5, 12.0
"""Metres: of the town, from street to street, and of a street."""

STOREY = 3.0

ROOF = Matter("roof", (0.45, 0.16, 0.1))
PLASTERS = (
    Matter("ochre", (0.7, 0.52, 0.28)),
    Matter("cream", (0.76, 0.7, 0.58)),
    Matter("rose", (0.62, 0.38, 0.32)),
    Matter("stone", (0.5, 0.48, 0.44)),
)
LEAVES, WOOD, GROUND = (
    Matter("leaves", (0.09, 0.24, 0.06)),
    Matter("wood", (0.2, 0.12, 0.06)),
    Matter("ground", (0.32, 0.31, 0.29)),
)


def town(stage: Stage) -> None:
    """A square kilometre: 256 blocks of houses of sixteen kinds round yards with trees, a church, a tower."""
    half = SIDE / 2
    stage.box("ground", GROUND, (-half, -1.0, -half), (half, 0.0, half))
    rng = np.random.default_rng(7)
    houses: dict[int, list[tuple[Triple, float]]] = {kind: [] for kind in range(16)}
    trees: list[tuple[Triple, float]] = []
    blocks = int(SIDE / BLOCK)
    for row in range(blocks):
        for column in range(blocks):
            x, z = (float(-half + BLOCK * (k + 0.5)) for k in (column, row))
            if (row, column) == (blocks // 2, blocks // 2):
                _church(stage, x, z)
                continue
            for side in range(4):
                for place in (-1, 1):
                    if rng.random() < 0.12:
                        continue  # a gap between the houses, through which one sees the yard
                    along, out = 11.5 * place, (BLOCK - STREET) / 2 - 6.0
                    turn = np.array([[0, 1], [1, 0], [0, -1], [-1, 0]])[side]
                    across = np.array([-turn[1], turn[0]])
                    dx, dz = out * turn + along * across
                    kind = int(rng.integers(16))
                    houses[kind].append(((x + float(dx), 0.0, z + float(dz)), 90.0 * side))
            trees += [((x + float(dx), 0.0, z + float(dz)), 0.0) for dx, dz in rng.uniform(-11, 11, (2, 2))]
    for kind, places in houses.items():
        _house(stage, kind, places)
    crown = sphere((0, 4.6, 0), 2.2, 16)
    stage.many("tree", [(WOOD, cylinder((0, 0, 0), 0.25, 3.0, 10)), (LEAVES, crown)], trees)
    trunk = make_cylinder((0, 1.5, 0), 0.25, 3.0, albedo=WOOD.albedo)
    stage.many_solids(trees, [trunk, make_sphere((0, 4.6, 0), 2.2, LEAVES.albedo)])
    stage.glb.sun("sun", (0.5, 0.8, 0.35), 6.0)
    stage.glb.camera("roofs", (-470, 60, 470), (0, 0, 0), 55)
    stage.glb.camera("street", (-31.0 * 8 - 2.0, 1.8, 440), (-31.0 * 8 - 2.0, 4.0, 0), 65)


def _house(stage: Stage, kind: int, places: list[tuple[Triple, float]]) -> None:
    """A body of two to five storeys, a roof that stands over, a chimney, and with some a wing or a porch."""
    storeys = 2 + kind % 4
    plaster = PLASTERS[kind % len(PLASTERS)]
    height = storeys * STOREY
    boxes = [
        (plaster, (-10.5, 0.0, -5.5), (10.5, height, 5.5)),
        (ROOF, (-11.0, height, -6.0), (11.0, height + 0.8, 6.0)),
        (plaster, (-4.0, height + 0.8, -1.0), (-2.8, height + 2.4, 0.2)),
    ]
    if kind // 4 in (1, 3):
        boxes.append((plaster, (2.0, 0.0, -10.5), (9.0, height - STOREY, -5.5)))
    if kind // 4 in (2, 3):
        boxes.append((WOOD, (-3.0, 2.6, 5.5), (3.0, 2.8, 7.5)))
    by_matter: dict[Matter, list[Shape]] = {}
    for matter, lower, upper in boxes:
        by_matter.setdefault(matter, []).append(box(lower, upper))
    stage.many(f"house {kind}", [(matter, join(*parts)) for matter, parts in by_matter.items()], places)
    solids = [
        make_box((np.array(lower) + upper) / 2, np.array(upper) - lower, albedo=matter.albedo)
        for matter, lower, upper in boxes
    ]
    stage.many_solids(places, solids)


def _church(stage: Stage, x: float, z: float) -> None:
    stone = PLASTERS[3]
    stage.box("nave", stone, (x - 8, 0, z - 18), (x + 8, 14, z + 14))
    stage.box("nave roof", ROOF, (x - 8.6, 14, z - 18.6), (x + 8.6, 15.2, z + 14.6))
    stage.box("tower", stone, (x - 4, 0, z + 14), (x + 4, 34, z + 22))
    stage.cylinder("apse", stone, (x, 0.0, z - 18), 7.0, 12.0)


if __name__ == "__main__":
    stage = Stage("town")
    town(stage)
    for file in stage.write(Path(sys.argv[1] if len(sys.argv) > 1 else ".") / "town.glb"):
        print(file)
