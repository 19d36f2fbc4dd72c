"""Plane cuts through a scene as pictures: spaces, mesh and set, with a scale and a legend."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

if TYPE_CHECKING:
    from fit.primitives import PrimitiveSet
    from fit.spaces import Air

Float64 = NDArray[np.float64]
UInt8 = NDArray[np.uint8]

AXES = ("x", "y", "z")
PLANES = ((2, 1, -1), (0, 2, 1), (0, 1, -1))
"""For a cut across each axis: the axis to the right, the other one, and 1 where that runs downwards."""

MARGIN = 0.04
"""Of the bounds: what is shown around them."""

AIR_COLORS = (
    (196, 224, 245),
    (206, 238, 200),
    (250, 236, 180),
    (244, 210, 232),
    (200, 238, 236),
    (232, 216, 250),
)
SOLID, REJECTED, HATCH = (255, 255, 255), (214, 214, 214), (178, 178, 178)
SET, SET_EDGE, FILLED, FILLED_EDGE, MESH = (
    (150, 158, 190),
    (84, 92, 140),
    (240, 96, 80),
    (170, 20, 20),
    (0, 0, 0),
)
MOST_REJECTED = 4
"""Spaces that are no air in the legend, the largest first."""

HATCH_PIXELS = 8
TEXT_PIXELS, LINE_PIXELS, GAP = 13, 19, 12


@dataclass(frozen=True)
class Cut:
    """A cut across one axis, as pixels (h, w): label, number of the space; is_air; owner, the primitive that
    fills it, or -1. segments (k, 2, 2): the cut through the mesh, pixels to the right and down; place: metres
    along the axis; metres: the size of a pixel."""

    axis: int
    place: float
    metres: float
    label: NDArray[np.int32]
    is_air: NDArray[np.bool_]
    owner: NDArray[np.intp]
    segments: Float64


def pixel_size(air: Air, pixels: int) -> float:
    """Metres of a pixel at which every cut fits a square of so many pixels."""
    lower, upper = air.walls.bounds
    return float((upper - lower).max() * (1 + 2 * MARGIN) / pixels)


def cut_scene(primitives: PrimitiveSet, air: Air, axis: int, point: Float64, metres: float) -> Cut:
    """Cuts spaces, mesh and set through `point` (3,) across `axis`."""
    from fit.sdf import union_distance
    from fit.spaces import OUTSIDE

    right, down, sign = PLANES[axis]
    lower, upper = air.walls.bounds
    pad = MARGIN * float((upper - lower).max())
    corner = (lower - pad) if sign > 0 else np.where(np.arange(3) == down, upper + pad, lower - pad)
    width, height = (max(1, round((upper[k] - lower[k] + 2 * pad) / metres)) for k in (right, down))
    place = float(point[axis]) + 1e-7 * air.walls.diagonal  # beside a wall that runs along the cut
    points = np.empty((height, width, 3))
    points[..., axis] = place
    points[..., right] = corner[right] + (np.arange(width) + 0.5) * metres
    points[..., down] = (corner[down] + sign * (np.arange(height) + 0.5) * metres)[:, None]
    cells = air.grid.cells_of(points.reshape(-1, 3))
    label = np.where(air.grid.holds(cells), air.label.ravel()[air.grid.flat(cells)], OUTSIDE)
    signed, owner = union_distance(primitives, points.reshape(-1, 3))
    ends = _mesh_segments(air.walls.vertices, axis, place)
    across = (ends[..., right] - corner[right]) / metres
    along = sign * (ends[..., down] - corner[down]) / metres
    return Cut(
        axis=axis,
        place=place,
        metres=metres,
        label=label.reshape(height, width),
        is_air=np.isin(label, air.air_labels).reshape(height, width),
        owner=np.where(signed < 0, owner, -1).reshape(height, width),
        segments=np.stack([across, along], axis=-1),
    )


def _mesh_segments(vertices: Float64, axis: int, place: float) -> Float64:
    """Where triangles (t, 3, 3) cross a plane: segments (k, 2, 3)."""
    height = vertices[:, :, axis] - place
    above = height >= 0
    crossing = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
    corners, height, above = vertices[crossing], height[crossing], above[crossing]
    ends = []
    for a, b in ((0, 1), (1, 2), (2, 0)):
        rows = np.flatnonzero(above[:, a] != above[:, b])
        share = (height[rows, a] / (height[rows, a] - height[rows, b]))[:, None]
        ends.append((rows, corners[rows, a] + share * (corners[rows, b] - corners[rows, a])))
    rows, points = (np.concatenate(column) for column in zip(*ends, strict=True))
    return points[np.argsort(rows, kind="stable")].reshape(-1, 2, 3)  # each crossing triangle has two ends


# ------------------------------------------------------------------------------------------------ drawing


def draw_cuts(cuts: list[Cut], air: Air, width: int) -> UInt8:
    """The cuts beside each other, their scale and their legend: (h, width, 3)."""
    panel = (width - (len(cuts) + 1) * GAP) // len(cuts)
    tallest = max(cut.label.shape[0] for cut in cuts)
    legend = _legend(air)
    top = GAP + LINE_PIXELS
    below = top + tallest + GAP
    picture = Image.new("RGB", (width, below + LINE_PIXELS * (len(legend) + 2)), (255, 255, 255))
    draw = ImageDraw.Draw(picture)
    font = ImageFont.load_default(TEXT_PIXELS)
    shades = _shades(air)
    for number, cut in enumerate(cuts):
        height, wide = cut.label.shape
        left = GAP + number * (panel + GAP) + (panel - wide) // 2
        picture.paste(Image.fromarray(_fill(cut, shades)), (left, top))
        for start, end in cut.segments + np.array([left, top]):
            draw.line((*start, *end), fill=MESH, width=1)
        right, down, sign = PLANES[cut.axis]
        words = f"{AXES[cut.axis]} = {cut.place:.4g} m    {AXES[right]} to the right, {AXES[down]} "
        draw.text((left, GAP), words + ("down" if sign > 0 else "up"), fill=MESH, font=font)
        draw.rectangle((left - 1, top - 1, left + wide, top + height), outline=HATCH)
    _draw_scale(draw, font, cuts[0].metres, (GAP, below), panel)
    for number, (color, is_hatched, words) in enumerate(legend):
        place = (GAP, below + LINE_PIXELS * (number + 2) - GAP // 2)
        _draw_swatch(draw, color, is_hatched, place)
        draw.text((place[0] + 34, place[1]), words, fill=MESH, font=font)
    return np.asarray(picture)


def _shades(air: Air) -> UInt8:
    """Colour of each space's number: air in one of its own, the largest first, what is no air in grey."""
    shades = np.full((int(air.label.max()) + 2, 3), REJECTED, np.uint8)
    shades[0] = SOLID
    for number, label in enumerate(_by_size(air)):
        shades[label] = AIR_COLORS[number % len(AIR_COLORS)]
    return shades


def _by_size(air: Air) -> list[int]:
    cells = np.bincount(air.label.ravel(), minlength=max(air.air_labels, default=0) + 1)
    return sorted(air.air_labels, key=lambda label: -cells[label])


def _fill(cut: Cut, shades: UInt8) -> UInt8:
    pixels = shades[cut.label]
    rows, columns = np.indices(cut.label.shape)
    stripes = (rows + columns) % HATCH_PIXELS == 0
    pixels[(cut.label > 0) & ~cut.is_air & stripes] = HATCH
    filled, solid = cut.is_air & (cut.owner >= 0), ~cut.is_air & (cut.owner >= 0)
    edge = np.zeros(cut.owner.shape, bool)
    edge[:, 1:] |= cut.owner[:, 1:] != cut.owner[:, :-1]
    edge[1:] |= cut.owner[1:] != cut.owner[:-1]
    for mask, inner, outer in ((solid, SET, SET_EDGE), (filled, FILLED, FILLED_EDGE)):
        pixels[mask] = inner
        pixels[mask & edge] = outer
    return pixels


def _legend(air: Air) -> list[tuple[tuple[int, int, int], bool, str]]:
    """Colour, hatched or not, and words of each entry."""
    spaces = sorted(air.spaces, key=lambda space: -space.volume)
    entries: list[tuple[tuple[int, int, int], bool, str]] = [
        (SET, False, "set, where no air is"),
        (FILLED, False, "set in the air: blocks light"),
        (MESH, False, "mesh"),
        (SOLID, False, "cells at the mesh, which the grid can't tell"),
    ]
    for number, space in enumerate(spaces[: len(AIR_COLORS)]):
        words = f"air, {space.volume:.4g} m3: {space.evidence}"
        entries.append((AIR_COLORS[number], False, words))
    for space in air.rejected[:MOST_REJECTED]:
        entries.append((REJECTED, True, f"no air, {space.volume:.4g} m3: {space.evidence}"))
    if len(air.rejected) > MOST_REJECTED:
        entries.append((REJECTED, True, f"no air: {len(air.rejected) - MOST_REJECTED} smaller spaces"))
    return entries


def _draw_swatch(draw: Any, color: tuple[int, int, int], is_hatched: bool, place: tuple[int, int]) -> None:
    x, y = place
    box = (x, y + 2, x + 26, y + LINE_PIXELS - 4)
    draw.rectangle(box, fill=color, outline=HATCH)
    for step in range(0, 18, HATCH_PIXELS) if is_hatched else ():
        draw.line((x + step, box[3], x + step + HATCH_PIXELS, box[1]), fill=HATCH)


def _draw_scale(draw: Any, font: Any, metres: float, place: tuple[int, int], panel: int) -> None:
    """A bar of a round length, about a third of a panel."""
    x, y = place
    longest = panel * metres / 3
    power = 10.0 ** np.floor(np.log10(longest))
    length = max(step * power for step in (1, 2, 5) if step * power <= longest)
    end = x + length / metres
    draw.line((x, y + 10, end, y + 10), fill=MESH, width=2)
    for tick in (x, end):
        draw.line((tick, y + 5, tick, y + 15), fill=MESH, width=2)
    draw.text((end + 8, y + 2), f"{length:g} m", fill=MESH, font=font)
