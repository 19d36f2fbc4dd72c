"""References of a glTF scene and of a primitive set."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from fit.primitives import PrimitiveSet
from fit.scene import Scene
from pipelines.reference.lighting import emitters
from pipelines.reference.meshes import mesh_shapes
from pipelines.reference.mitsuba import load_mitsuba
from pipelines.reference.solids import primitive_bounds, primitive_shapes
from pipelines.reference.surfaces import Surfaces
from pipelines.reference.truth import Reference
from runtime.lights import Illumination


def mesh_reference(scene: Scene, illumination: Illumination) -> Reference:
    """The scene's triangles: diffuse base colour with textures and cut-outs, emission, every face two-sided.

    Raises:
        MissingMitsuba: Mitsuba is not installed.
        ValueError: the scene draws no triangle.
    """
    mi = load_mitsuba()
    lower, upper = scene.bounds()
    origin = (lower + upper) / 2
    surfaces = Surfaces(mi, scene)
    lights, notes = emitters(mi, illumination, origin)
    with tempfile.TemporaryDirectory(prefix="sdfprim-") as folder:
        shapes = mesh_shapes(scene, surfaces, origin, Path(folder))
        diagonal = float(np.linalg.norm(upper - lower))
        return Reference(mi, shapes, lights, origin, diagonal, (*surfaces.notes, *notes))


def primitive_reference(primitives: PrimitiveSet, illumination: Illumination) -> Reference:
    """The set itself, exactly: what a tracer of its distances converges to.

    Raises:
        MissingMitsuba: Mitsuba is not installed.
        ValueError: the set is empty.
    """
    if len(primitives) == 0:
        raise ValueError("a set of no primitives has nothing to light")
    mi = load_mitsuba()
    lower, upper = primitive_bounds(primitives)
    origin, diagonal = (lower + upper) / 2, float(np.linalg.norm(upper - lower))
    lights, notes = emitters(mi, illumination, origin)
    shapes = primitive_shapes(mi, primitives, origin)
    return Reference(mi, shapes, lights, origin, diagonal, notes)
