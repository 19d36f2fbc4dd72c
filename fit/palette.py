"""The colours of a scene as its light tells them apart, and what it costs to mix them on one face.

A set is judged by distances alone, until two surfaces of clearly different colour share a face: the light
that it reflects is then of a colour that is nowhere. `color_cost` puts that into the units of the objective.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fit.color import face_slots, facing, nearest_primitive
from fit.glow import alpha_cutoffs
from fit.primitives import PrimitiveSet
from fit.scene import Float64, Scene
from fit.spaces import Air
from fit.surface import colors
from fit.targets import Seen

Index = NDArray[np.int64]

COLOR_WEIGHT = 1.0
"""Cost of albedos that are wrong by 1 everywhere against that of a set of nothing: both return light that is
wrong by as much as falls in."""

SMOOTHING_NEIGHBOURS = 8
"""Samples over which a colour is averaged first: what varies from one to the next, bricks and leaves, is one
colour to the light of a room."""

BLURRED = 0.12
"""Mean difference of the albedos around a sample at which it counts no more: it lies on the edge of two
colours, where no cut falls exactly, or on a pattern, which is one colour from afar."""

_NORMAL_SPACINGS = 4.0
"""Mean spacings of the samples that a right angle between two normals counts as in that average."""


@dataclass(frozen=True)
class Palette:
    """p points of the seen surface, normals (p, 3) toward the air, weights (p,) that sum to at most 1;
    features (p, 6): smooth albedo, and emission in units of the scene's mean; scale: E of the empty set;
    cell: edge of the air's cells."""

    points: Float64
    normals: Float64
    weights: Float64
    features: Float64
    scale: float
    cell: float

    def __len__(self) -> int:
        return len(self.weights)


def find_palette(scene: Scene, air: Air, seen: Seen, scale: float) -> Palette:
    """The colours of the seen samples, but of those in holes that alpha cuts; `scale`: as in `Palette`."""
    samples = seen.samples
    albedo, emission, alpha = colors(scene, air.walls, samples.triangle, samples.barycentric)
    shown = np.flatnonzero(alpha >= alpha_cutoffs(scene)[air.walls.material[samples.triangle]])
    points, normals, weights = samples.points[shown], seen.normals[shown], seen.weights[shown]
    weights = weights / max(float(weights.sum()), np.finfo(float).tiny)
    near = _neighbours(points, normals)
    albedo = np.clip(albedo[shown], 0.0, 1.0)[near]
    smooth = albedo.mean(axis=1)
    blur = np.abs(albedo - smooth[:, None]).mean(axis=(1, 2)) / BLURRED
    glow = np.maximum(emission[shown], 0.0)
    mean = float(weights @ glow.mean(axis=1))
    if mean > 0:
        glow /= mean
        around = glow.mean(axis=1)[near]
        level = around.mean(axis=1)
        unsteady = np.abs(around - level[:, None]).mean(axis=1)
        blur = np.maximum(blur, unsteady / np.where(level > 0, level, 1.0))
    weights *= np.maximum(0.0, 1.0 - blur)
    return Palette(points, normals, weights, np.concatenate([smooth, glow], axis=1), scale, air.cell)


def _neighbours(points: Float64, normals: Float64) -> Index:
    """Rows (p, k) of the nearest samples that look the same way, the point itself among them."""
    count = min(SMOOTHING_NEIGHBOURS, len(points))
    if count < 2:
        return np.arange(len(points))[:, None]
    spacing = float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))
    place = np.concatenate([points, _NORMAL_SPACINGS / np.sqrt(2) * spacing * normals], axis=1)
    rows: Index = cKDTree(place).query(place, k=count)[1].astype(np.int64)
    return rows


def color_cost(primitives: PrimitiveSet, palette: Palette) -> float:
    """What mixing colours on the faces of a set costs, in units of the objective E.

    `COLOR_WEIGHT * scale * sum_i w_i |c_i - mean of the c on its face|`, the mean over R, G, B, of albedo and
    of emission: each sample belongs to the face that `fit.color.color` gives it to. It takes one evaluation
    of all distances, about a hundredth of a second for a set of 64.
    """
    if len(primitives) == 0 or len(palette) == 0:
        return 0.0
    return float(face_costs(palette, face_of(primitives, palette), 6 * len(primitives)).sum())


def face_of(primitives: PrimitiveSet, palette: Palette) -> Index:
    """The face (p,) that each sample belongs to: six for each primitive, in the set's order."""
    owner = nearest_primitive(primitives, palette.points, palette.normals, palette.cell)
    return face_slots(primitives, owner, facing(primitives, owner, palette.points, palette.normals)[0])


def face_costs(palette: Palette, face: Index, count: int, rows: Index | slice = slice(None)) -> Float64:
    """Cost (count,) of each face when the samples `rows` belong to the faces `face`."""
    weights, features = palette.weights[rows], palette.features[rows]
    mass = np.bincount(face, weights=weights, minlength=count)
    off = np.zeros(len(face))
    for channel in features.T:
        sums = np.bincount(face, weights=weights * channel, minlength=count)
        off += np.abs(channel - (sums / np.where(mass > 0, mass, 1.0))[face])
    scale = COLOR_WEIGHT * palette.scale / 3
    return scale * np.bincount(face, weights=weights * off, minlength=count).astype(np.float64)
