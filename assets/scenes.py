"""The bundled scenes, each a function that fills a `Glb`. Lengths in metres, colours linear."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from glb import Glb
from shapes import Shape, arch, box, box_at, curtain, cylinder, join, quad, sphere
from textures import checker, masonry, ramp

WHITE, RED, GREEN = (0.73, 0.73, 0.73), (0.63, 0.06, 0.05), (0.14, 0.45, 0.09)
NEUTRAL = (0.5, 0.5, 0.5)


def cornell(scene: Glb) -> None:
    """The Cornell box, 2 m wide, as open sheets: a red and a green wall, two blocks, an emissive panel."""
    white, red, green = (scene.material(n, c) for n, c in (("white", WHITE), ("red", RED), ("green", GREEN)))
    lamp = scene.material("lamp", (0.0, 0.0, 0.0), emission=(17.0, 12.0, 4.0))
    scene.part("floor", white, quad((-1, 0, 1), (2, 0, 0), (0, 0, -2)))
    scene.part("ceiling", white, quad((-1, 2, -1), (2, 0, 0), (0, 0, 2)))
    scene.part("back wall", white, quad((-1, 0, -1), (2, 0, 0), (0, 2, 0)))
    scene.part("left wall", red, quad((-1, 0, 1), (0, 0, -2), (0, 2, 0)))
    scene.part("right wall", green, quad((1, 0, -1), (0, 0, 2), (0, 2, 0)))
    scene.part("short block", white, box_at((0, 0.3, 0), (0.6, 0.6, 0.6)).turned(-17).moved((0.34, 0, 0.37)))
    scene.part("tall block", white, box_at((0, 0.6, 0), (0.6, 1.2, 0.6)).turned(18).moved((-0.34, 0, -0.31)))
    scene.part("panel", lamp, quad((-0.24, 1.995, -0.2), (0.48, 0, 0), (0, 0, 0.4)))
    scene.camera("front", (0, 1, 3.9), (0, 1, 0), 40)


def _room(lower: tuple[float, float, float], upper: tuple[float, float, float], wall: float) -> list[Shape]:
    """Six slabs of thickness `wall` round the air between two corners; they meet and do not overlap."""
    (x0, y0, z0), (x1, y1, z1) = lower, upper
    return [
        box((x0 - wall, y0 - wall, z0 - wall), (x1 + wall, y0, z1 + wall)),
        box((x0 - wall, y1, z0 - wall), (x1 + wall, y1 + wall, z1 + wall)),
        box((x0 - wall, y0, z0 - wall), (x0, y1, z1 + wall)),
        box((x1, y0, z0 - wall), (x1 + wall, y1, z1 + wall)),
        box((x0, y0, z0 - wall), (x1, y1, z0)),
        box((x0, y0, z1), (x1, y1, z1 + wall)),
    ]


SLABS = ("floor", "ceiling", "west wall", "east wall", "north wall", "south wall")


def sealed_room(scene: Glb) -> None:
    """A closed room of 3 m with 4 cm walls under a sun: its inside must stay black."""
    grey = scene.material("grey", NEUTRAL)
    for name, slab in zip(SLABS, _room((-1.5, 0, -1.5), (1.5, 3, 1.5), 0.04), strict=True):
        scene.part(name, grey, slab)
    scene.sun("sun", (0.3, 1.0, 0.2), 10.0)
    scene.camera("inside", (1.3, 1.5, 1.3), (-1, 1.2, -1), 75)
    scene.camera("outside", (5, 4, 6), (0, 1.5, 0), 45)


def two_colour_wall(scene: Glb) -> None:
    """A wall of 6 cm, red to the west and white to the east, on a grey floor under the noon sun."""
    grey, red, white = (scene.material(n, c) for n, c in (("grey", NEUTRAL), ("red", RED), ("white", WHITE)))
    scene.part("floor", grey, box((-3, -0.2, -2), (3, 0, 2)))
    half, height, length = 0.03, 2.0, 3.0
    z = length / 2
    scene.part("wall, west face", red, quad((-half, 0, -z), (0, 0, length), (0, height, 0)))
    edges = join(
        quad((half, 0, z), (0, 0, -length), (0, height, 0)),
        quad((-half, height, z), (2 * half, 0, 0), (0, 0, -length)),
        quad((-half, 0, z), (2 * half, 0, 0), (0, height, 0)),
        quad((half, 0, -z), (-2 * half, 0, 0), (0, height, 0)),
        quad((-half, 0, -z), (2 * half, 0, 0), (0, 0, length)),
    )
    scene.part("wall, other faces", white, edges)
    scene.sun("sun", (0.0, 1.0, 0.0), 4.0)
    scene.camera("west", (-3.2, 1.6, 2.4), (-0.3, 0.5, 0), 50)
    scene.camera("east", (3.2, 1.6, 2.4), (0.3, 0.5, 0), 50)


SPAN = 2.4
"""Width of a bay of the cloister: from column to column."""

SPRING, GALLERY, TOP = 2.1, 3.5, 6.2
"""Heights: where the arches begin, the gallery's floor, the upper edge of the walls."""

COURT = (6.0, 2.4)
"""Half extents of the court along x and z, to the columns' axes."""

DEPTH = 2.2
"""How deep the arcade is behind its columns."""


def atrium(scene: Glb) -> None:
    """A cloister of two storeys round an open court, with curtains, a plinth of spheres and four lanterns."""
    materials = _atrium_materials(scene)
    _atrium_shell(scene, materials)
    _atrium_arcade(scene, materials)
    _atrium_court(scene, materials)
    scene.sun("sun", (0.30, 1.0, 0.50), 9.0)
    scene.camera("court", (5.55, 1.75, 1.35), (-3.6, 2.2, -0.95), 62)
    scene.camera("arcade", (6.9, 1.7, 3.55), (-1.5, 1.5, 1.0), 62)
    scene.camera("gallery", (5.4, 5.0, 1.9), (-2.4, 0.9, -0.9), 58)


def _atrium_materials(scene: Glb) -> dict[str, int]:
    marble = ramp((222, 208, 184), (246, 238, 222), (120, 66, 50))
    sandstone = ramp((206, 186, 152), (238, 222, 192), (150, 130, 104))
    tiles = scene.texture("floor tiles", checker(), marble)
    blocks = scene.texture("stone blocks", masonry(), sandstone)
    return {
        "floor": scene.material("floor", (0.8, 0.8, 0.8), texture=tiles),
        "wall": scene.material("wall", (0.92, 0.9, 0.86), texture=blocks),
        "stone": scene.material("stone", (0.66, 0.6, 0.5)),
        "plaster": scene.material("plaster", (0.72, 0.66, 0.56)),
        "white": scene.material("white", (0.8, 0.8, 0.78)),
        "wood": scene.material("wood", (0.2, 0.1, 0.05)),
        "leaves": scene.material("leaves", (0.07, 0.22, 0.05)),
        "clay": scene.material("clay", (0.55, 0.19, 0.1)),
        "teal": scene.material("teal", (0.04, 0.3, 0.33)),
        "ochre": scene.material("ochre", (0.75, 0.42, 0.06)),
        "red cloth": scene.material("red cloth", (0.62, 0.035, 0.03), double_sided=True),
        "green cloth": scene.material("green cloth", (0.06, 0.3, 0.09), double_sided=True),
        "blue cloth": scene.material("blue cloth", (0.05, 0.13, 0.5), double_sided=True),
        "lantern": scene.material("lantern", (0.0, 0.0, 0.0), emission=(14.0, 8.4, 3.4)),
    }


def _atrium_shell(scene: Glb, materials: dict[str, int]) -> None:
    """Floor, outer walls, and the two rings over the arcade: the gallery's floor and the roof."""
    x, z = COURT[0] + DEPTH, COURT[1] + DEPTH
    wall = 0.3
    scene.part(
        "floor", materials["floor"], box((-x - wall, -0.3, -z - wall), (x + wall, 0, z + wall)), tile=1.2
    )
    for name, lower, upper in (
        ("north wall", (-x, 0, -z - wall), (x, TOP, -z)),
        ("south wall", (-x, 0, z), (x, TOP, z + wall)),
        ("west wall", (-x - wall, 0, -z - wall), (-x, TOP, z + wall)),
        ("east wall", (x, 0, -z - wall), (x + wall, TOP, z + wall)),
    ):
        scene.part(name, materials["wall"], box(lower, upper), tile=1.6)
    inner = 0.15
    for name, material, low, high in (
        ("gallery", "plaster", GALLERY - 0.2, GALLERY),
        ("roof", "plaster", TOP, TOP + 0.2),
    ):
        a, b = COURT[0] + inner, COURT[1] + inner
        shift = wall if name == "roof" else 0.0
        for side, lower, upper in (
            ("north", (-x - shift, low, -z - shift), (x + shift, high, -b)),
            ("south", (-x - shift, low, b), (x + shift, high, z + shift)),
            ("west", (-x - shift, low, -b), (-a, high, b)),
            ("east", (a, low, -b), (x + shift, high, b)),
        ):
            scene.part(f"{name}, {side}", materials[material], box(lower, upper))


def _atrium_arcade(scene: Glb, materials: dict[str, int]) -> None:
    """Columns, and over them a bay for each gap: an arch, a parapet, an opening of the gallery, a lintel."""
    half_x, half_z = COURT
    along_x = np.arange(-half_x, half_x + 0.01, SPAN)
    along_z = np.arange(-half_z, half_z + 0.01, SPAN)
    corners = [(x, z) for z in (-half_z, half_z) for x in along_x]
    corners += [(x, z) for x in (-half_x, half_x) for z in along_z[1:-1]]
    for number, (x, z) in enumerate(corners):
        column = join(
            box_at((x, 0.1, z), (0.62, 0.2, 0.62)),
            cylinder((x, 0.2, z), 0.21, SPRING - 0.4),
            box_at((x, SPRING - 0.1, z), (0.56, 0.2, 0.56)),
        )
        scene.part(f"column {number}", materials["stone"], column)
    bays = [((x + SPAN / 2, z), 0.0) for z in (-half_z, half_z) for x in along_x[:-1]]
    bays += [((x, z + SPAN / 2), 90.0) for x in (-half_x, half_x) for z in along_z[:-1]]
    for number, ((x, z), degrees) in enumerate(bays):
        wall = join(*_bay()).turned(degrees).moved((x, 0, z))
        scene.part(f"bay {number}", materials["wall"], wall, tile=1.6)
    for name, bay, height in (
        ("red cloth", 1, SPRING + 0.62),
        ("green cloth", 3, SPRING + 0.62),
        ("blue cloth", 6, SPRING + 0.62),
        ("red cloth", 8, SPRING + 0.62),
    ):
        (x, z), _ = bays[bay]
        scene.part(f"{name}, bay {bay}", materials[name], curtain(1.75, 2.25, 5, 0.12).moved((x, height, z)))
        rod = box_at((x, height + 0.02, z), (2.0, 0.05, 0.05))
        scene.part(f"rod, bay {bay}", materials["wood"], rod)


def _bay() -> list[Shape]:
    thickness, rise = 0.3, GALLERY - SPRING
    upper = TOP - GALLERY
    pier = 0.35
    offset = (SPAN - pier) / 2
    return [
        arch(SPAN, 0.92, rise, thickness).moved((0, SPRING, 0)),
        box((-SPAN / 2, GALLERY, -thickness / 2), (SPAN / 2, GALLERY + 0.75, thickness / 2)),
        *(box_at((x, GALLERY + 1.35, 0), (pier, 1.2, thickness)) for x in (-offset, offset)),
        box((-SPAN / 2, GALLERY + 1.95, -thickness / 2), (SPAN / 2, GALLERY + upper, thickness / 2)),
        box((-SPAN / 2, GALLERY + 0.75, -0.22), (SPAN / 2, GALLERY + 0.83, 0.22)),
    ]


def _atrium_court(scene: Glb, materials: dict[str, int]) -> None:
    """What stands in the court: a plinth with three spheres, benches, potted trees; and the lanterns."""
    steps = (cylinder((-0.6, 0, -0.2), 1.15, 0.16, 48), cylinder((-0.6, 0.16, -0.2), 0.95, 0.2, 48))
    scene.part("plinth", materials["stone"], join(*steps))
    for name, center, radius in (
        ("white", (-0.85, 0.36 + 0.5, -0.3), 0.5),
        ("teal", (-0.05, 0.36 + 0.26, 0.1), 0.26),
        ("ochre", (-0.55, 0.36 + 0.17, 0.42), 0.17),
    ):
        scene.part(f"{name} sphere", materials[name], sphere(center, radius))
    for x in (-3.8, 3.1):
        bench = join(
            box((x - 0.7, 0.38, 1.35), (x + 0.7, 0.46, 1.8)),
            box((x - 0.6, 0, 1.42), (x - 0.5, 0.38, 1.73)),
            box((x + 0.5, 0, 1.42), (x + 0.6, 0.38, 1.73)),
        )
        scene.part(f"bench at {x}", materials["wood"], bench)
    for x, z in ((-4.7, -1.35), (-4.7, 1.2), (2.4, -1.4)):
        scene.part(f"pot at {x}, {z}", materials["clay"], cylinder((x, 0, z), 0.26, 0.45))
        scene.part(f"tree at {x}, {z}", materials["leaves"], sphere((x, 1.15, z), 0.42, 24))
        scene.part(f"trunk at {x}, {z}", materials["wood"], cylinder((x, 0.45, z), 0.05, 0.4, 12))
    for x, z in ((-7.0, -3.5), (-7.0, 3.5), (7.0, -3.5), (2.4, 3.5)):
        scene.part(f"lantern at {x}, {z}", materials["lantern"], sphere((x, 2.55, z), 0.16, 20))
        chain = cylinder((x, 2.7, z), 0.012, GALLERY - 0.2 - 2.7, 8)
        scene.part(f"chain at {x}, {z}", materials["wood"], chain)


def table(scene: Glb) -> None:
    """A table of five boxes, as separate shells of one mesh; its legs run up into the top."""
    wood = scene.material("wood", (0.32, 0.19, 0.1))
    legs = [box_at((x, 0.37, z), (0.07, 0.74, 0.07)) for x in (-0.7, 0.7) for z in (-0.35, 0.35)]
    scene.part("table", wood, join(box_at((0, 0.735, 0), (1.6, 0.05, 0.9)), *legs))
    scene.camera("front", (1.6, 1.5, 2.2), (0, 0.4, 0), 40)


def six_solids(scene: Glb) -> None:
    """Two boxes, two spheres and two cylinders that overlap, as separate shells of one mesh."""
    grey = scene.material("grey", NEUTRAL)
    solids = join(
        box_at((0, 0.25, 0), (1.2, 0.5, 0.8)),
        box_at((0.1, 0.6, 0.05), (0.5, 0.9, 0.4)).turned(28),
        sphere((-0.5, 0.6, 0.15), 0.35, 64),
        sphere((0.62, 0.42, -0.2), 0.3, 64),
        cylinder((-0.2, 0.1, -0.35), 0.18, 1.2, 64),
        cylinder((0.55, 0.2, 0.4), 0.22, 0.6, 64),
    )
    scene.part("solids", grey, solids)
    scene.camera("front", (1.8, 1.4, 2.4), (0, 0.5, 0), 40)


def colonnade(scene: Glb) -> None:
    """Six columns of a base, a shaft and a capital between a floor and a beam: 20 primitives in one mesh."""
    stone = scene.material("stone", (0.6, 0.57, 0.5))
    parts = [box((-4.0, 0, -0.6), (4.0, 0.2, 0.6)), box((-3.8, 3.2, -0.4), (3.8, 3.6, 0.4))]
    for x in np.linspace(-3.25, 3.25, 6):
        parts.append(box_at((x, 0.3, 0), (0.7, 0.3, 0.7)))
        parts.append(cylinder((x, 0.4, 0), 0.25, 2.7, 64))
        parts.append(box_at((x, 3.1, 0), (0.62, 0.3, 0.62)))
    scene.part("colonnade", stone, join(*parts))
    scene.camera("front", (5, 2.4, 8), (0, 1.7, 0), 45)


SCENES: dict[str, Callable[[Glb], None]] = {
    "atrium": atrium,
    "colonnade": colonnade,
    "sealed_room": sealed_room,
    "six_solids": six_solids,
    "table": table,
    "two_colour_wall": two_colour_wall,
}
