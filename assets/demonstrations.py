"""Bundled stages for demonstrations: bouncing balls, a room that two probes light, a dark room in the sun."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scenes
from shapes import Array
from stage import Matter, Stage
from stages import room

WALL = Matter("wall", (0.75, 0.72, 0.66))
GREY = Matter("grey", (0.45, 0.45, 0.45))
BALLS = (
    Matter("white", (0.8, 0.8, 0.8)),
    Matter("red", (0.75, 0.08, 0.06)),
    Matter("green", (0.1, 0.5, 0.12)),
    Matter("blue", (0.08, 0.16, 0.6)),
)

BALL_RADIUS, BALL_PERIOD, BALL_PHASES = 0.25, 1.6, 8
"""Metres, seconds, and how many balls follow each other before the first phase comes again."""


def ball_court(stage: Stage) -> None:
    """A court of 8 m under sun and sky, in which a hundred balls bounce, each in its own time."""
    walls = {name: WALL for name in scenes.SLABS if name != "ceiling"}
    room(stage, "", (-4, 0, -4), (4, 2.4, 4), 0.2, walls | {"floor": GREY})
    places = [(x, z) for x in np.linspace(-3.4, 3.4, 10) for z in np.linspace(-3.4, 3.4, 10)]
    for number, matter in enumerate(BALLS):
        mesh = stage.ball_mesh(f"{matter.name} ball", matter, BALL_RADIUS)
        for k in range(number, len(places), len(BALLS)):
            x, z = places[k]
            times, keys = bounce((0.37 * k) % 1.0, 0.6 + 0.15 * (k % 3))
            stage.moving_ball(
                f"ball {k}", matter, mesh, (float(x), BALL_RADIUS, float(z)), BALL_RADIUS, times, keys
            )
    stage.glb.sun("sun", (0.5, 0.9, 0.3), 6.0)
    stage.glb.camera("corner", (3.7, 2.3, 3.7), (-0.6, 0.2, -0.6), 65)


def bounce(phase: float, height: float) -> tuple[Array, Array]:
    """Times (3,) and spline keys (3, 3, 3) of a bounce on the spot, which starts `phase` of the way through.

    A parabola is a cubic, so two pieces of spline are exact: up to the ground, and on from it.
    """
    phase = round(BALL_PHASES * phase) % BALL_PHASES / BALL_PHASES
    times = np.array([0.0, (1 - phase) * BALL_PERIOD, BALL_PERIOD])
    keys = np.zeros((3, 3, 3))
    speed = 4 * height / BALL_PERIOD
    start = phase * BALL_PERIOD * speed * (1 - phase)
    turn = speed * (1 - 2 * phase)
    keys[:, 1, 1] = (start, 0.0, start)
    keys[:, 0, 1] = (turn, -speed, turn)
    keys[:, 2, 1] = (turn, speed, turn)
    if phase == 0:
        return times[[0, 2]], np.stack([keys[1], keys[1]])
    return times, keys


def two_probe_room(stage: Stage) -> None:
    """Two chambers, a wall of 2 cm with a doorway between them, and a lamp in the western one."""
    walls = {name: WALL for name in scenes.SLABS} | {"west wall": BALLS[1], "east wall": BALLS[2]}
    room(stage, "", (-2, 0, -1.5), (2, 2.2, 1.5), 0.1, walls)
    stage.box("partition", WALL, (-0.01, 0, -1.5), (0.01, 2.2, 0.7))
    stage.box("bench", WALL, (0.7, 0, -1.4), (1.5, 0.5, -0.9))
    lamp = Matter("lamp", (0.0, 0.0, 0.0), (12.0, 10.0, 8.0))
    stage.box("lamp", lamp, (-1.3, 2.14, -0.3), (-0.7, 2.18, 0.3))
    stage.glb.camera("inside", (1.85, 1.7, 1.35), (-0.4, 0.75, -0.9), 80)


def dark_room(stage: Stage) -> None:
    """A sealed room with walls of 1 cm in full sun, and a block in it: its inside must stay black."""
    room(stage, "", (-1.5, 0, -1.5), (1.5, 3, 1.5), 0.01, {name: WALL for name in scenes.SLABS})
    stage.box("block", BALLS[1], (-1.0, 0, -0.9), (-0.2, 0.9, -0.1), degrees=25)
    stage.glb.sun("sun", (0.3, 1.0, 0.2), 10.0)
    stage.glb.camera("inside", (1.3, 1.6, 1.3), (-0.7, 0.9, -0.7), 75)


DEMONSTRATIONS: dict[str, Callable[[Stage], None]] = {
    "ball_court": ball_court,
    "dark_room": dark_room,
    "two_probe_room": two_probe_room,
}
