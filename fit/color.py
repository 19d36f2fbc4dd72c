"""Albedo and emission of each face of each primitive: means over the surface that it stands for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.glow import Glow, alpha_cutoffs
from fit.lamps import lamp_of
from fit.light import EvenLight
from fit.openings import reflected_shares
from fit.primitives import Kind, PrimitiveSet, shared_face_colors
from fit.scene import Float64, Scene
from fit.sdf import distance, primitive_face, sample_boundary, union_distance
from fit.shapes import Shapes, no_shapes
from fit.spaces import Air
from fit.surface import colors
from fit.targets import Seen

Index = NDArray[np.int64]

_BEHIND = 1e-9
"""Factor on the weight of samples behind their primitive: they speak only where no other does."""

_MIDDLE = 0.4
"""Of the thickness: both sides of a sheet lie near the middle of its primitive, and count."""

LOOK_OUT_CELLS = 0.04
"""Of a cell: this far out of the surface its nearest primitive is looked for. Lamps and plates stand out of
their walls by half of it."""

_EXPOSURE_SAMPLES = 4_000
"""Points on the primitives that emit, by which the part of each face that air touches is known."""


def color(
    primitives: PrimitiveSet,
    scene: Scene,
    air: Air,
    seen: Seen,
    glow: Glow,
    *,
    lamps: Shapes | None = None,
    seed: int = 0,
) -> PrimitiveSet:
    """The set with the textured linear colours of the surface near each face.

    Every seen sample goes to the primitive whose boundary is nearest, and there to the face that looks its
    way: so the two sides of a thin wall keep their own colours. Albedo is the mean over the area; a face that
    stands for no sample takes its primitive's mean, a primitive without any the mean of the scene. Where
    alpha cuts a hole, nothing reflects a colour and nothing emits.

    A face emits the light of the lamps that it stands for, spread over what air touches of the face, and
    never brighter than they are; a face that stands for no lamp emits nothing. `lamps`: what the first
    primitives are made for; their light is these primitives' alone.

    A face that shuts an opening gets as dark as that looks (`fit.openings`).
    """
    if len(primitives) == 0 or len(seen) == 0:
        return primitives
    samples = seen.samples
    albedo, _, alpha = colors(scene, air.walls, samples.triangle, samples.barycentric)
    shown = alpha >= alpha_cutoffs(scene)[air.walls.material[samples.triangle]]
    albedo = np.clip(albedo, 0.0, 1.0)
    means = _albedo(primitives, air, seen, albedo, shown)
    emission = _emission(primitives, glow, lamps or no_shapes(), air, seed)
    painted = replace(
        primitives,
        albedo=shared_face_colors(primitives.kinds, means),
        emission=shared_face_colors(primitives.kinds, emission),
    )
    light = EvenLight.of(air, seen, albedo.mean(axis=1) * shown, seed)
    left = _shared(primitives, reflected_shares(painted, light, seed=seed))
    return replace(painted, albedo=shared_face_colors(primitives.kinds, painted.albedo * left))


def _albedo(
    primitives: PrimitiveSet, air: Air, seen: Seen, albedo: Float64, shown: NDArray[np.bool_]
) -> Float64:
    """Means (n, 6, 3) of the seen samples' albedo (p, 3), as far as they are `shown` (p,)."""
    points = seen.samples.points
    owner = nearest_primitive(primitives, points, seen.normals, air.cell)
    face, turned_here = facing(primitives, owner, points, seen.normals)
    # Means over area: hits of rays only speak where no sample by area lies.
    weights = seen.weights * np.where(seen.by_area, 1.0, 1e-6) * np.where(turned_here, 1.0, _BEHIND) * shown
    slot = face_slots(primitives, owner, face)
    sums = _sums(albedo * weights[:, None], slot, len(primitives))
    mass = _sums(weights[:, None], slot, len(primitives))
    scene_mean = _ratio(sums.sum(axis=(0, 1)), mass.sum(axis=(0, 1)), np.zeros(3))
    own_mean = _ratio(sums.sum(axis=1), mass.sum(axis=1), scene_mean)
    return _shared(primitives, _ratio(sums, mass, own_mean[:, None]))


def _emission(primitives: PrimitiveSet, glow: Glow, lamps: Shapes, air: Air, seed: int) -> Float64:
    if len(glow) == 0:
        return np.zeros((len(primitives), 6, 3))
    lamp = lamp_of(lamps, glow.points, air.cell)
    owner = np.where(lamp >= 0, lamp, nearest_primitive(primitives, glow.points, glow.normals, air.cell))
    slot = face_slots(primitives, owner, facing(primitives, owner, glow.points, glow.normals)[0])
    flux = _sums(glow.flux, slot, len(primitives))
    area = _sums(glow.areas[:, None], slot, len(primitives))
    lit = np.unique(owner)
    area[lit] = np.maximum(area[lit], _exposed_areas(primitives, lit, air, seed))
    return _shared(primitives, _ratio(flux, area, np.zeros(3)))


def _exposed_areas(primitives: PrimitiveSet, which: Index, air: Air, seed: int) -> Float64:
    """Area (k, 6, 1) of what air touches of the faces of the primitives `which` (k,), by `face_slots`."""
    finite = which[~primitives.is_half_space[which]]
    chosen = primitives.select(finite)
    exposed = np.zeros((len(primitives), 6, 1))
    if len(chosen):
        points, normals, index = sample_boundary(chosen, _EXPOSURE_SAMPLES, seed)
        free = union_distance(primitives, points)[0] > -1e-9 * air.walls.diagonal
        free &= np.isin(air.labels_seen(points, normals), air.air_labels)
        slot = 6 * finite[index] + primitive_face(chosen, points, index)
        area = float(chosen.face_areas().sum()) / _EXPOSURE_SAMPLES
        exposed = _sums(np.full((int(free.sum()), 1), area), slot[free], len(primitives))
    return exposed[which]


def nearest_primitive(primitives: PrimitiveSet, points: Float64, normals: Float64, cell: float) -> Index:
    """Primitive (p,) whose boundary is nearest to each point of the surface, seen from just outside of it.

    Of about equally near ones it is the one that looks the same way: the floor that a wall's foot stands on
    is not what the wall's own samples belong to. `cell`: edge of the air's cells.
    """
    step = LOOK_OUT_CELLS * cell
    owner = np.zeros(len(points), np.int64)
    for start in range(0, len(points), 4096):
        rows = slice(start, start + 4096)
        outside = distance(primitives, points[rows] + step * normals[rows])
        rise = outside - distance(primitives, points[rows])  # step times the cosine between the normals
        owner[rows] = (np.abs(outside) + 2 * (step - rise)).argmin(axis=1)
    return owner


def facing(
    primitives: PrimitiveSet, owner: Index, points: Float64, normals: Float64
) -> tuple[Index, NDArray[np.bool_]]:
    """Face (p,) of primitive `owner[i]` that looks along normal i, and whether point i lies on its side.

    A point in the half that is turned away looks through the primitive: the inner side of a hollow wall, seen
    through a gap, is no part of the wall's other face.
    """
    frames = primitives.rotation_matrices()[owner]
    local = np.einsum("pij,pi->pj", frames, normals)
    flat = primitives.kinds[owner] == Kind.PLANE
    local[flat, 0] = local[flat, 2] = 0.0  # a sheet shows its two sides only
    axis = np.abs(local).argmax(axis=1)
    axis[flat] = 1
    rows = np.arange(len(local))
    negative = local[rows, axis] < 0
    place = np.einsum("pij,pi->pj", frames, points - primitives.positions[owner])[rows, axis]
    depth = np.where(negative, place, -place)  # beyond the middle, seen from that face
    return 2 * axis + negative, depth <= _MIDDLE * primitives.sizes[owner, axis]


_SIDES = [0, 1, 4, 5]


def face_slots(primitives: PrimitiveSet, owner: Index, face: Index) -> Index:
    """Row (p,) of a face in a table of six a primitive; spheres and cylinders' sides have the first only."""
    kinds = primitives.kinds[owner]
    round_ = (kinds == Kind.SPHERE) | ((kinds == Kind.CYLINDER) & np.isin(face, _SIDES))
    return 6 * owner + np.where(round_, 0, face)


def _shared(primitives: PrimitiveSet, values: Float64) -> Float64:
    """Values (n, 6, 3) with the first slot of spheres and of cylinders' sides on all faces it stands for."""
    shared = values.copy()
    for kind, faces in ((Kind.SPHERE, range(6)), (Kind.CYLINDER, _SIDES)):
        for face in faces:
            shared[primitives.kinds == kind, face] = values[primitives.kinds == kind, 0]
    return shared


def _sums(values: Float64, slot: Index, count: int) -> Float64:
    """Sums (n, 6, c) of values (p, c) over the slots."""
    sums = np.zeros((6 * count, values.shape[1]))
    for channel in range(values.shape[1]):
        sums[:, channel] = np.bincount(slot, weights=values[:, channel], minlength=6 * count)
    return sums.reshape(count, 6, -1)


def _ratio(sums: Float64, mass: Float64, empty: Float64) -> Float64:
    """sums / mass, and `empty` where there is no mass."""
    ratio: Float64 = np.where(mass > 0, sums / np.where(mass > 0, mass, 1.0), empty)
    return ratio
