"""The scenes that light is measured in, each a function that fills a `Stage`: mesh and set are alike.

Under which sky they stand is told by `stages.toml`. Lengths in metres, colours linear.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scenes
from shapes import quad
from stage import Matter, Stage, Triple

WALL, REDDISH, GREENISH, BLUISH = (
    Matter("white", scenes.WHITE),
    Matter("red", scenes.RED),
    Matter("green", scenes.GREEN),
    Matter("blue", (0.06, 0.1, 0.5)),
)
GREY = Matter("grey", scenes.NEUTRAL)


def room(
    stage: Stage, prefix: str, lower: Triple, upper: Triple, wall: float, matters: dict[str, Matter]
) -> None:
    """Slabs of thickness `wall` round the air between two corners, those that `matters` names; they meet
    and do not overlap."""
    (x0, y0, z0), (x1, y1, z1) = lower, upper
    slabs = {
        "floor": ((x0 - wall, y0 - wall, z0 - wall), (x1 + wall, y0, z1 + wall)),
        "ceiling": ((x0 - wall, y1, z0 - wall), (x1 + wall, y1 + wall, z1 + wall)),
        "west wall": ((x0 - wall, y0, z0 - wall), (x0, y1, z1 + wall)),
        "east wall": ((x1, y0, z0 - wall), (x1 + wall, y1, z1 + wall)),
        "north wall": ((x0, y0, z0 - wall), (x1, y1, z0)),
        "south wall": ((x0, y0, z1), (x1, y1, z1 + wall)),
    }
    for name, matter in matters.items():
        stage.box(prefix + name, matter, *slabs[name])


def _all(matter: Matter, **others: Matter) -> dict[str, Matter]:
    """Every slab of a room of one matter, but `others`, by their names with underscores."""
    named = {name.replace("_", " "): other for name, other in others.items()}
    return {name: named.get(name, matter) for name in scenes.SLABS}


def cornell(stage: Stage) -> None:
    """The Cornell box of open sheets; in the set they are slabs that stand outside of it."""
    scenes.cornell(stage.glb)
    lamp, wall = Matter("lamp", (0.0, 0.0, 0.0), (17.0, 12.0, 4.0)), 0.05
    stage.slab("floor", WALL, (-1, -wall, -1), (1, 0, 1))
    stage.slab("ceiling", WALL, (-1, 2, -1), (1, 2 + wall, 1))
    stage.slab("back wall", WALL, (-1, 0, -1 - wall), (1, 2, -1))
    stage.slab("left wall", REDDISH, (-1 - wall, 0, -1), (-1, 2, 1))
    stage.slab("right wall", GREENISH, (1, 0, -1), (1 + wall, 2, 1))
    stage.slab("short block", WALL, (0.04, 0, 0.07), (0.64, 0.6, 0.67), degrees=-17)
    stage.slab("tall block", WALL, (-0.64, 0, -0.61), (-0.04, 1.2, -0.01), degrees=18)
    stage.panel("panel", lamp, (-0.24, 1.995, -0.2), (0.24, 2.0, 0.2))


def furnace(stage: Stage) -> None:
    """White solids that absorb nothing, under a sky of 1: everything has the sky's radiance and vanishes."""
    snow = Matter("snow", (1.0, 1.0, 1.0))
    stage.box("slab", snow, (-1.5, -0.2, -1.2), (1.5, 0.0, 1.2))
    stage.box("block", snow, (-1.1, 0.0, -0.7), (-0.4, 0.9, 0.0), degrees=25)
    stage.balls("ball", snow, [(0.1, 0.4, 0.3)], 0.4)
    stage.cylinder("rod", snow, (0.9, 0.0, -0.4), 0.25, 1.1)
    stage.glb.camera("front", (1.9, 1.9, 3.2), (0, 0.3, 0), 45)


def two_rooms(stage: Stage) -> None:
    """Two rooms with 10 cm between them: a lamp lights the west one, the east one is sealed and dark."""
    lamp = Matter("lamp", (0.0, 0.0, 0.0), (12.0, 12.0, 12.0))
    for side, x0, x1, color in (("west", -3.05, -0.05, REDDISH), ("east", 0.05, 3.05, BLUISH)):
        room(stage, f"{side} room, ", (x0, 0, -1.5), (x1, 2.6, 1.5), 0.05, _all(WALL, north_wall=color))
    shining = stage.glb.material(lamp.name, lamp.albedo, emission=lamp.emission)
    stage.glb.part("lamp", shining, quad((-1.9, 2.59, -0.35), (0.7, 0, 0), (0, 0, 0.7)))
    stage.panel("lamp", lamp, (-1.9, 2.59, -0.35), (-1.2, 2.6, 0.35))
    stage.glb.camera("west", (-0.3, 1.5, 1.3), (-2.5, 1.2, -1.2), 75)
    stage.glb.camera("east", (2.8, 1.5, 1.3), (0.6, 1.2, -1.2), 75)


def tunnel(stage: Stage) -> None:
    """A passage of 2 x 2 m, 12 m long, that daylight enters at one end; a screen half closes its middle."""
    walls = _all(WALL, west_wall=REDDISH, east_wall=GREENISH)
    del walls["south wall"]
    room(stage, "", (-1, 0, -6), (1, 2, 6), 0.1, walls)
    stage.box("screen", WALL, (-1, 0, -0.05), (0.2, 2, 0.05))
    stage.glb.camera("inside", (0.5, 1.2, 4.6), (0, 0.9, -1), 60)


def curtains(stage: Stage) -> None:
    """A small atrium: a sunny court, and behind columns and cloth of 2 cm a walk with a roof."""
    room(
        stage,
        "",
        (-3, 0, -2.5),
        (3, 3.6, 2.5),
        0.2,
        {name: WALL for name in scenes.SLABS if name != "ceiling"},
    )
    stage.box("roof", WALL, (-3, 2.6, -2.5), (3, 2.8, -1.0))
    for number, x in enumerate(np.linspace(-2.7, 2.7, 4)):
        stage.cylinder(f"column {number}", WALL, (float(x), 0.0, -1.15), 0.15, 2.6)
    for x, name, color in ((-1.8, "red", REDDISH), (0.0, "blue", BLUISH), (1.8, "green", GREENISH)):
        stage.box(f"{name} cloth", color, (x - 0.7, 0.3, -1.11), (x + 0.7, 2.6, -1.09))
    stage.glb.sun("sun", (0.25, 1.0, 0.55), 8.0)
    stage.glb.camera("court", (2.4, 1.6, 2.2), (-0.8, 1.2, -1.6), 70)
    stage.glb.camera("walk", (2.7, 1.5, -1.9), (-2, 1.2, -1.7), 75)


def emissive_room(stage: Stage) -> None:
    """A closed room that glowing things of three kinds and colours light, a large one and small ones."""
    room(stage, "", (-2, 0, -2), (2, 2.6, 2), 0.1, _all(WALL, west_wall=BLUISH))
    black = (0.0, 0.0, 0.0)
    stage.balls("lamp", Matter("warm", black, (9.0, 5.0, 2.0)), [(-1.1, 0.35, 0.4), (1.2, 1.9, -1.2)], 0.25)
    stage.cylinder("tube", Matter("cold", black, (3.0, 6.0, 10.0)), (1.5, 0.1, 0.9), 0.06, 2.2)
    stage.box("panel", Matter("pink", black, (3.0, 1.0, 2.0)), (-0.8, 0.8, -1.98), (0.2, 1.6, -1.94))
    stage.box("table", WALL, (-0.5, 0.6, -0.6), (0.7, 0.7, 0.6), degrees=20)
    stage.glb.camera("corner", (1.7, 1.8, 1.8), (-0.73, 0.81, -0.9), 75)


def courtyard(stage: Stage) -> None:
    """A court under sun and sky, full of coloured balls."""
    walls = {name: WALL for name in scenes.SLABS if name != "ceiling"}
    room(stage, "", (-2.5, 0, -2.5), (2.5, 2.0, 2.5), 0.2, walls | {"floor": GREY})
    places = [(x, 0.3, z) for x in np.linspace(-1.8, 1.8, 5) for z in np.linspace(-1.8, 1.8, 5)]
    for number, matter in enumerate((WALL, REDDISH, GREENISH)):
        stage.balls(f"{matter.name} ball", matter, places[number::3], 0.3)
    stage.glb.sun("sun", (0.5, 0.9, 0.3), 6.0)
    stage.glb.camera("corner", (2.2, 1.9, 2.2), (-0.5, 0.2, -0.5), 65)


def closed_box(stage: Stage) -> None:
    """Walls and a block that all glow alike and reflect a half: E = pi Le / (1 - 1/2) everywhere."""
    glow = Matter("glow", scenes.NEUTRAL, (1.0, 1.0, 1.0))
    room(stage, "", (-1.5, 0, -1.5), (1.5, 3, 1.5), 0.1, _all(glow))
    stage.box("block", glow, (-0.9, 0, -0.8), (0.1, 1.2, 0.1), degrees=30)
    stage.glb.camera("corner", (1.2, 1.8, 1.2), (-0.6, 0.8, -0.6), 75)


STAGES: dict[str, Callable[[Stage], None]] = {
    "closed_box": closed_box,
    "cornell": cornell,
    "courtyard": courtyard,
    "curtains": curtains,
    "emissive_room": emissive_room,
    "furnace": furnace,
    "tunnel": tunnel,
    "two_rooms": two_rooms,
}
