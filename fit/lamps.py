"""Lamps get primitives of their own, which nothing may cover.

The surface around a lamp is fitted to centimetres, and a slab that stands a little too far out
would take the lamp's light away: a room behind sixteen window panes was an eighth as bright as it is. So
when all other shapes stand, each lamp grows out of what covers it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.fit_parts import bounding_fit
from fit.glow import Glow
from fit.primitives import Kind, PrimitiveSet
from fit.recognize import Piece, recognize
from fit.scene import Float64
from fit.sdf import union_distance
from fit.shapes import Index, Shapes, distances_to_one, join, make_shapes, to_primitives
from fit.spaces import Air
from fit.split import Parts
from fit.trace import first_hits

Bool = NDArray[np.bool_]

LEAST_POWER = 0.01
"""Of the light that the strongest lamp emits: below it a lamp may share its neighbour's primitive."""

PROUD = 0.02
"""Of a cell: a lamp stands out of the wall that it hangs on, so that a ray meets the lamp first."""

_FLAT_ENOUGH = 0.5
"""Of a cell: mean distance of a lamp's surface from its box; a worse one is left to the general fit."""

MOST_COVER = 1.0
"""Cells: what covers a lamp deeper than this is no error of the fit."""

COVERED = 0.9
"""Share of a side's bare points that come free: what covers a few of them is not worth a thicker lamp."""


def emissive_parts(glow: Glow, air: Air, parts: Parts, most: int) -> Shapes:
    """One fixed shape for each of the parts that emit the most light, the strongest first."""
    walls = air.walls
    of_sample = parts.of_triangle[glow.triangle]
    power = np.bincount(of_sample, weights=glow.flux.sum(axis=1), minlength=len(parts))
    strongest = np.argsort(-power, kind="stable")[:most]
    lamps = []
    for part in strongest[power[strongest] > LEAST_POWER * power.max(initial=0.0)]:
        rows = np.flatnonzero(parts.of_triangle == part)
        piece = Piece(walls.vertices[rows], walls.normals[rows], walls.areas[rows])
        exact = recognize(piece)
        shape = exact if len(exact) == 1 else bounding_fit(piece)
        points = glow.points[of_sample == part]
        if np.abs(distances_to_one(shape, 0, points)).mean() <= _FLAT_ENOUGH * air.cell:
            halves = shape.halves + PROUD * air.cell
            lamps.append(
                make_shapes(Kind(shape.kinds[0]), shape.centers, shape.frames[0], halves, exact=True)
            )
    return join(lamps)


def lamp_of(lamps: Shapes, points: Float64, cell: float) -> Index:
    """The lamp (p,) that holds each of the points (p, 3), -1 where none does; `cell`: edge of the air's."""
    if len(lamps) == 0:
        return np.full(len(points), -1)
    depths = np.stack([distances_to_one(lamps, i, points) for i in range(len(lamps))], axis=1)
    return np.where(depths.min(axis=1) <= _FLAT_ENOUGH * cell, depths.argmin(axis=1), -1)


def uncover(shapes: Shapes, count: int, glow: Glow, air: Air) -> Shapes:
    """The shapes with the first `count` of them, lamps, grown out of what covers them in the others."""
    lamps, others = shapes.select(slice(0, count)), shapes.select(slice(count, None))
    if len(lamps) == 0 or len(others) == 0:
        return shapes
    owner = lamp_of(lamps, glow.points, air.cell)
    cover, is_bare = _cover(glow, to_primitives(others), air)
    grown = []
    for i in range(count):
        rows = np.flatnonzero((owner == i) & is_bare)
        grown.append(_grown(lamps.select(slice(i, i + 1)), glow.normals[rows], cover[rows], PROUD * air.cell))
    return join([*grown, others])


def _cover(glow: Glow, others: PrimitiveSet, air: Air) -> tuple[Float64, Bool]:
    """How far (g,) before each point the foremost of the others stands, and where (g,) none should: the mesh
    leaves the point bare, and it is not buried deeper than `MOST_COVER`."""
    most = MOST_COVER * air.cell
    before = glow.points + most * glow.normals
    on_mesh = air.rays.first_hit(before, -glow.normals)[0]
    on_set = first_hits(others, before, -glow.normals)
    is_bare = (on_mesh > (1 - PROUD) * most) & (union_distance(others, before)[0] > 0)
    return np.maximum(most - on_set, 0.0), is_bare


def _grown(lamp: Shapes, normals: Float64, cover: Float64, proud: float) -> Shapes:
    """One lamp whose sides stand out of what covers its points, which have normals and covers (p, 3), (p,).
    They stand `proud` of the points as they are."""
    local = normals @ lamp.frames[0]
    axis = np.abs(local).argmax(axis=1)
    side = 2 * axis + (local[np.arange(len(local)), axis] < 0)
    halves, center = lamp.halves.copy(), lamp.centers.copy()
    for one in np.unique(side):
        growth = float(np.quantile(cover[side == one], COVERED, method="lower"))
        if growth < proud / 2:
            continue
        if lamp.kinds[0] != Kind.BOX:
            halves += growth
            break
        along = lamp.frames[0][:, one // 2] * (-1.0 if one % 2 else 1.0)
        halves[0, one // 2] += growth / 2
        center[0] += along * growth / 2
    return replace(lamp, halves=halves, centers=center)
