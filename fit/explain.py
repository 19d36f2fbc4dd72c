"""The boxes, cylinders and spheres of which a mesh is the union, whole or as separate shells that overlap.

Each patch (`fit.facets`) shows a part of one primitive. What two patches show of the same one is joined when
nothing of the mesh lies in between. What no facet shows, because it is inside another primitive, ends where
the facets end: the smallest that explains all that is seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fit.facets import Facets, Int64, find_facets, find_patches
from fit.flush import Solid, flush_boxes
from fit.fragments import fit_patch, fit_round, join_facets
from fit.patches import Fragment, Patches, gather
from fit.rounds import WIDEST_TURN
from fit.scene import Float64
from fit.shapes import Shapes, distances_to_one, join, no_shapes, right_handed

TOLERANCES = (5e-7, 1e-5, 1e-4)
"""Of the diagonal, the finest first: vertices in float32, far from their origin, or quantised."""

MOST_PATCHES = 400
MOST_TRIANGLES = 200_000

MOST_NOISY = 20_000
"""Triangles of a mesh that is tried at coarser tolerances too."""

MOST_UNEXPLAINED = 0.005
"""Share of the area that may belong to no primitive of an explained shell."""

_FAILURES = 8
"""Of the largest patches that fit nothing: then the shell is no union of primitives."""

_SPECK = 1e-6
"""Share of the area that a patch has at least: smaller ones are crumbs of rounding."""

_FRAMES = 4
"""Frames of boxes with flush faces in one shell."""

_FEWEST_SMOOTH = 3
"""Facets that a round side shows at least."""


@dataclass(frozen=True)
class Explanation:
    """Primitives of the closed shells among t triangles.

    shapes: all of them, exact; of_triangle (t,): the shape that each triangle lies on, -1 where none does.
    """

    shapes: Shapes
    of_triangle: Int64


def explain(corners: Float64) -> Explanation:
    """The primitives that triangles (t, 3, 3) show, in the frame of the triangles."""
    lower, upper = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    center, scale = (lower + upper) / 2, float(np.linalg.norm(upper - lower))
    nothing = Explanation(no_shapes(), np.full(len(corners), -1))
    if not scale > 0 or len(corners) > MOST_TRIANGLES:
        return nothing
    best = nothing
    for tolerance in TOLERANCES[: 1 if len(corners) > MOST_NOISY else None]:
        found = _explain_unit((corners - center) / scale, tolerance)
        if (found.of_triangle >= 0).mean() > (best.of_triangle >= 0).mean():
            best = found
        if (best.of_triangle >= 0).all():
            break
    shapes = best.shapes
    return Explanation(
        replace(shapes, centers=shapes.centers * scale + center, halves=shapes.halves * scale),
        best.of_triangle,
    )


def _explain_unit(corners: Float64, tolerance: float) -> Explanation:
    facets = find_facets(corners, tolerance)
    of_triangle = np.full(len(corners), -1)
    if len(facets) == 0:
        return Explanation(no_shapes(), of_triangle)
    patches = gather(facets, find_patches(facets))
    fragments: list[Fragment] = []
    shell_of_facet = np.zeros(len(facets), np.int64)
    rows = np.flatnonzero(facets.of_triangle >= 0)
    shell_of_facet[facets.of_triangle[rows]] = facets.shell[rows]
    shell_of_patch = np.zeros(len(patches), np.int64)
    shell_of_patch[patches.of_facet] = shell_of_facet
    for shell in np.unique(shell_of_patch):
        fragments += _explain_shell(patches, np.flatnonzero(shell_of_patch == shell))
    owner = np.full(len(facets), -1)
    for number, fragment in enumerate(fragments):
        owner[fragment.facets] = number
    of_triangle[rows] = owner[facets.of_triangle[rows]]
    return Explanation(join([f.shape() for f in fragments]), of_triangle)


def _explain_shell(patches: Patches, own: Int64) -> list[Fragment]:
    """Fragments of the patches of one shell, joined; none unless they explain nearly all of it."""
    facets = patches.facets
    areas = np.bincount(patches.of_facet, facets.areas, len(patches))
    total = areas[own].sum()
    own = own[np.argsort(-areas[own], kind="stable")]
    own = own[areas[own] > _SPECK * total]
    if len(own) > MOST_PATCHES:
        return []
    fragments, loose = [], []
    for patch in own:
        found = fit_patch(patches, int(patch))
        if found is not None:
            fragments.append(found)
            continue
        loose.append(int(patch))
        if len(loose) >= _FAILURES and not fragments:
            return []
    samples = _samples(patches, own)
    fragments = _join_fragments(patches, fragments, samples)
    fragments, loose = _absorb(patches, fragments, loose, samples)
    left = np.flatnonzero(np.isin(patches.of_facet, loose))
    most = MOST_UNEXPLAINED * total
    if facets.areas[left].sum() > most:
        fragments = _separate(patches, fragments, left, samples, own)
        left = _unclaimed(fragments, left)
    return fragments if facets.areas[left].sum() <= most else []


def _samples(patches: Patches, own: Int64) -> Float64:
    """Points (p, 3) of a shell: what lies within a primitive makes it no part of the solid."""
    corners = patches.facets.points[patches.facets.triangles[_triangles(patches, own)]]
    middles = (corners + np.roll(corners, 1, axis=1)) / 2
    return np.concatenate([corners.reshape(-1, 3), middles.reshape(-1, 3), corners.mean(axis=1)])


def _triangles(patches: Patches, own: Int64) -> Int64:
    """Rows of the triangles of patches."""
    rows = np.flatnonzero(patches.facets.of_triangle >= 0)
    return rows[np.isin(patches.of_facet[patches.facets.of_triangle[rows]], own)]


def _is_empty(fragment: Fragment, samples: Float64, tolerance: float) -> bool:
    """Whether no surface lies within a primitive, as deep as its tessellation may."""
    depth = 20 * tolerance + (1 - fragment.inner) * fragment.radius
    return bool(distances_to_one(fragment.shape(), 0, samples).min() >= -depth - 1e-4 * fragment.radius)


def _join_fragments(patches: Patches, fragments: list[Fragment], samples: Float64) -> list[Fragment]:
    """Fragments of the same primitive become one, the largest first."""
    joined: list[Fragment] = []
    for fragment in fragments:
        for i, other in enumerate(joined):
            both = join_facets(patches, other, fragment.facets)
            if both is not None and _is_empty(both, samples, patches.facets.tolerance):
                joined[i] = both
                break
        else:
            joined.append(fragment)
    return joined


def _absorb(
    patches: Patches, fragments: list[Fragment], loose: list[int], samples: Float64
) -> tuple[list[Fragment], list[int]]:
    """Patches that fit nothing by themselves join the fragments that they lie on."""
    left = []
    for patch in loose:
        members = np.flatnonzero(patches.of_facet == patch)
        for i, other in enumerate(fragments):
            both = join_facets(patches, other, members)
            if both is not None and _is_empty(both, samples, patches.facets.tolerance):
                fragments[i] = both
                break
        else:
            left.append(patch)
    return fragments, left


# ------------------------------------------------------------------------------------------- flush faces


def _separate(
    patches: Patches, fragments: list[Fragment], left: Int64, samples: Float64, own: Int64
) -> list[Fragment]:
    """Primitives of the facets `left`, of which coplanar faces are one: round sides first, then the boxes."""
    facets = patches.facets
    fragments = [*fragments, *_round_sides(patches, left, samples)]
    left = _unclaimed(fragments, left)
    rows = _triangles(patches, own)
    normals = facets.normals[facets.of_triangle[rows]]
    solid = Solid(facets.points[facets.triangles[rows]], normals, samples, facets.tolerance)
    for _ in range(_FRAMES):
        frame = _main_frame(facets, left)
        if frame is None:
            break
        turned = np.abs(facets.normals[left] @ frame).max(axis=1)
        aligned = left[turned > 1 - 1e-8 - facets.slack()[left] ** 2]
        local = patches.corners(aligned) @ frame
        first = patches.corner_rows(aligned)[1]
        ends = np.concatenate([np.minimum.reduceat(local, first), np.maximum.reduceat(local, first)])
        found = flush_boxes(solid, ends, frame, fragments)
        if not found:
            break
        fragments, rest = _claim_by_few(patches, fragments, found, left)
        if len(rest) == len(left):
            break
        left = rest
    return fragments


def _unclaimed(fragments: list[Fragment], rows: Int64) -> Int64:
    """Facets that lie on no fragment."""
    return np.setdiff1d(rows, np.concatenate([np.zeros(0, np.int64), *(f.facets for f in fragments)]))


def _round_sides(patches: Patches, left: Int64, samples: Float64) -> list[Fragment]:
    """Cylinders and spheres of the smooth groups among facets."""
    facets = patches.facets
    inside = np.zeros(len(facets), bool)
    inside[left] = True
    smooth = inside[facets.pair].all(axis=1) & (facets.angles < WIDEST_TURN)
    again = gather(facets, find_patches(facets, smooth))
    sizes = np.bincount(again.of_facet[left], minlength=len(again))
    found = [fit_round(again, int(group)) for group in np.flatnonzero(sizes >= _FEWEST_SMOOTH)]
    kept = [f for f in found if f is not None and _is_empty(f, samples, facets.tolerance)]
    return _join_fragments(again, kept, samples)


def _main_frame(facets: Facets, rows: Int64) -> Float64 | None:
    """Frame (3, 3) of the largest facet and the largest one at right angles to it; None without one."""
    rows = rows[facets.slack()[rows] < 1e-3]
    if len(rows) == 0:
        return None
    order = rows[np.argsort(-facets.areas[rows], kind="stable")]
    normals = facets.normals[order]
    across = np.flatnonzero(np.abs(normals @ normals[0]) <= facets.slack()[order] + 1e-5)
    if len(across) == 0:
        return None
    return right_handed(np.stack([normals[0], normals[across[0]]], axis=1))


def _claim_by_few(
    patches: Patches, fragments: list[Fragment], boxes: list[Fragment], left: Int64
) -> tuple[list[Fragment], Int64]:
    """`_claim` with the boxes that it takes: those of cells that a round side cuts unseen are left out."""
    off = _distances(patches, fragments + boxes, left)
    claimed, rest = _claim(patches, fragments + boxes, left, off)
    for box in boxes:
        fewer = [b for b in boxes if b is not box]
        if not fragments + fewer:
            break
        others_off = np.delete(off, len(fragments) + _place(boxes, box), axis=0)
        others, without = _claim(patches, fragments + fewer, left, others_off)
        if len(without) == len(rest):
            claimed, boxes, off = others, fewer, others_off
    return claimed, rest


def _place(boxes: list[Fragment], box: Fragment) -> int:
    return next(k for k, other in enumerate(boxes) if other is box)


def _distances(patches: Patches, fragments: list[Fragment], left: Int64) -> Float64:
    """How far (n, 4 t) corners and middles of the triangles of `left` are off the faces of n fragments."""
    facets = patches.facets
    corners = facets.points[facets.triangles[_triangles_of(facets, left)]]
    points = np.concatenate([corners, corners.mean(axis=1)[:, None]], axis=1).reshape(-1, 3)
    return np.array([np.abs(distances_to_one(f.shape(), 0, points)) for f in fragments])


def _triangles_of(facets: Facets, left: Int64) -> Int64:
    return np.flatnonzero(np.isin(facets.of_triangle, left))


def _claim(
    patches: Patches, fragments: list[Fragment], left: Int64, off: Float64
) -> tuple[list[Fragment], Int64]:
    """Fragments with the facets of `left` that lie on their faces, be it piece by piece; the facets left."""
    facets = patches.facets
    reach = 20 * facets.tolerance
    rows = _triangles_of(facets, left)
    astray = np.bincount(
        facets.of_triangle[rows], (off.min(axis=0) > reach).reshape(-1, 4).any(axis=1), len(facets)
    )
    nearest = np.zeros(len(facets), np.int64)
    nearest[facets.of_triangle[rows]] = off[:, 3::4].argmin(axis=0)
    settled = left[astray[left] == 0]
    fragments = [
        replace(f, facets=np.concatenate([f.facets, settled[nearest[settled] == k]]))
        for k, f in enumerate(fragments)
    ]
    return fragments, left[astray[left] > 0]
