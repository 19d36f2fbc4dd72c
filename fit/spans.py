"""Where lines are inside a shape: one interval of each line, since every shape is convex."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fit.primitives import Kind
from fit.scene import Float64
from fit.shapes import Shapes

FLAT: dict[Kind, tuple[int, ...]] = {Kind.BOX: (0, 1, 2), Kind.CYLINDER: (1,), Kind.SPHERE: ()}
ROUND: dict[Kind, tuple[int, ...]] = {Kind.BOX: (), Kind.CYLINDER: (0, 2), Kind.SPHERE: (0, 1, 2)}
"""Axes along which a kind is bounded by two faces, and those that its radius spans."""


def entries_of_one(shapes: Shapes, which: int, origins: Float64, directions: Float64) -> Float64:
    """How far along rays (p, 3) they enter one shape (p,): 0 from inside it, inf where they miss it."""
    enter, leave = _spans(shapes, which, origins, directions)
    enter = np.maximum(enter, 0.0)
    return np.where(enter < leave, enter, np.inf)


def cross(shapes: Shapes, which: int, starts: Float64, ways: Float64) -> NDArray[np.bool_]:
    """Whether the segments (p,) from `starts` along `ways` (p, 3) pass through the inside of one shape."""
    enter, leave = _spans(shapes, which, starts, ways)
    return np.maximum(enter, 0.0) < np.minimum(leave, 1.0)


def _spans(shapes: Shapes, which: int, origins: Float64, directions: Float64) -> tuple[Float64, Float64]:
    """From where to where (p,) lines are inside, in lengths of their directions; enter >= leave: nowhere."""
    kind, halves, frame = Kind(shapes.kinds[which]), shapes.halves[which], shapes.frames[which]
    at, toward = frame.T @ (origins - shapes.centers[which]).T, frame.T @ directions.T
    enter, leave = np.full(len(origins), -np.inf), np.full(len(origins), np.inf)
    for axis in FLAT[kind]:
        way = np.where(toward[axis] == 0, np.finfo(float).tiny, toward[axis])
        with np.errstate(over="ignore"):
            one, other = (-halves[axis] - at[axis]) / way, (halves[axis] - at[axis]) / way
        enter, leave = np.maximum(enter, np.minimum(one, other)), np.minimum(leave, np.maximum(one, other))
    if ROUND[kind]:
        rows = list(ROUND[kind])
        at, toward = at[rows], toward[rows]
        square = np.maximum((toward * toward).sum(axis=0), np.finfo(float).tiny)
        # From the closest approach: the textbook's discriminant loses all digits from afar.
        middle = -(at * toward).sum(axis=0) / square
        nearest = at + middle * toward
        with np.errstate(over="ignore"):
            room = (halves[0] ** 2 - (nearest * nearest).sum(axis=0)) / square
        reach = np.sqrt(np.maximum(room, 0.0))
        enter, leave = np.maximum(enter, middle - reach), np.minimum(leave, middle + reach)
    return enter, leave
