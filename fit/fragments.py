"""Patches as primitives: what one patch shows, and whether another shows the same."""

from __future__ import annotations

import numpy as np

from fit.facets import Int64
from fit.patches import Fragment, Patches, box_in_frame, fit_box, nearly_all, on_box
from fit.primitives import Kind
from fit.rounds import cylinder_on, fit_cylinder, fit_sphere, on_cylinder, on_sphere, sphere_on


def fit_patch(patches: Patches, patch: int) -> Fragment | None:
    """The one primitive that all facets of a patch lie on; None where there is none, or too little shows."""
    return fit_box(patches, np.flatnonzero(patches.of_facet == patch)) or fit_round(patches, patch)


def fit_round(patches: Patches, patch: int) -> Fragment | None:
    """The cylinder or sphere that all facets of a patch lie on."""
    members = np.flatnonzero(patches.of_facet == patch)
    edges = np.flatnonzero(patches.edges == patch)
    whole = patches.whole_points[patches.whole_patch == patch]
    return fit_cylinder(patches, members, edges) or fit_sphere(patches, members, edges, whole)


def join_facets(patches: Patches, fragment: Fragment, members: Int64) -> Fragment | None:
    """The fragment with further facets, if those lie on the same primitive."""
    together = np.concatenate([fragment.facets, members])
    if fragment.kind is Kind.BOX:
        both = box_in_frame(patches, together, fragment.frame)
        on = on_box(patches, members, both) if both else None
    elif fragment.kind is Kind.CYLINDER:
        both = cylinder_on(patches, together, fragment)
        on = on_cylinder(patches, members, both) if both else None
    else:
        both = sphere_on(patches, together, fragment)
        on = on_sphere(patches, members, both) if both else None
    return both if on is not None and nearly_all(on, patches.facets.areas[members]) else None
