"""The face colours of a primitive from the materials of the meshes that show it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fit import rotation
from fit.export.gltf_facts import Facts
from fit.export.gltf_nodes import Float64, Graph
from fit.primitives import Float32, Kind, shared_face_colors

DEFAULT_ALBEDO = 0.5
"""Of a primitive without any material."""

SAME_ALBEDO, SAME_EMISSION = 1e-4, 1e-3
"""Difference up to which a material's colour is the extras' one: absolute, and relative to the largest."""


def face_colors(
    graph: Graph,
    node: int,
    meshes: Sequence[int],
    position: Float64,
    turn: Float64,
    kind: Kind,
    facts: Facts,
    notes: list[str],
) -> tuple[Float32, Float32]:
    """Albedo and emission (1, 6, 3) of the primitive `node` at `position`, `turn` (xyzw), shown by `meshes`.

    A triangle belongs to the face that its normal points to, however tools have split or joined the mesh; a
    face takes the area-weighted mean of its materials. Extras give the exact colour where the material is
    still theirs, and the colour of faces without triangles.
    """
    areas, albedo, emission = _painted(
        graph, meshes, position, rotation.matrices_from_quaternions(turn), notes
    )
    if not areas.any() and facts.albedo is None:
        notes.append(f"{graph.place(node)}: no material; albedo taken as {DEFAULT_ALBEDO}")
    sides = []
    for colors, exact, default in (
        (albedo, facts.albedo, DEFAULT_ALBEDO),
        (emission, facts.emission, 0.0),
    ):
        bare = areas == 0
        mean = areas @ colors / areas.sum() if areas.any() else np.full(3, default)
        colors[bare] = mean if exact is None else exact[bare]
        sides.append(colors)
    albedo, emission = sides
    if facts.albedo is not None:
        same = np.abs(albedo - facts.albedo).max(axis=1) <= SAME_ALBEDO
        albedo[same] = facts.albedo[same]
    if facts.emission is not None:
        scale = facts.emission.max(axis=1)
        same = np.abs(emission - facts.emission).max(axis=1) <= SAME_EMISSION * scale
        emission[same] = facts.emission[same]
    kinds, weights = np.array([kind]), areas[None]
    return shared_face_colors(kinds, albedo[None], weights), shared_face_colors(
        kinds, emission[None], weights
    )


def _painted(
    graph: Graph, meshes: Sequence[int], position: Float64, turn: Float64, notes: list[str]
) -> tuple[Float64, Float64, Float64]:
    """Area (6,), mean albedo (6, 3) and mean emission (6, 3) of each face; zeros where nothing is painted."""
    parts, colors = [], []
    for node in meshes:
        for part in graph.triangles(node):
            if part.material is not None and len(part.corners):
                parts.append(part.corners)
                colors += [_material_colors(graph, node, part.material, notes)] * len(part.corners)
    if not parts:
        return np.zeros(6), np.zeros((6, 3)), np.zeros((6, 3))
    corners = (np.concatenate(parts) - position) @ turn
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    axis = np.argmax(np.abs(normal), axis=1)
    face = 2 * axis + (normal[np.arange(len(normal)), axis] < 0)
    weights = np.zeros((6, len(face)))
    weights[face, np.arange(len(face))] = np.linalg.norm(normal, axis=1)
    areas = weights.sum(axis=1)
    albedo, emission = np.moveaxis(np.tensordot(weights, np.array(colors), 1), 1, 0)
    divisor = np.where(areas > 0, areas, 1.0)[:, None]
    return areas, albedo / divisor, emission / divisor


def _material_colors(graph: Graph, node: int, index: int, notes: list[str]) -> tuple[Float64, Float64]:
    """Linear albedo (3,) in [0, 1] and emission (3,) of a material's factors."""
    material: dict[str, Any] = graph.container.document["materials"][index]
    surface = material.get("pbrMetallicRoughness", {})
    strength = material.get("extensions", {}).get("KHR_materials_emissive_strength", {})
    albedo = np.array(surface.get("baseColorFactor", (1, 1, 1, 1)), np.float64)[:3]
    emission = np.array(material.get("emissiveFactor", (0, 0, 0)), np.float64)
    if "baseColorTexture" in surface or "emissiveTexture" in material:
        note = f"{graph.place(node)}: its textures are left out; the colour factors count"
        notes += [] if note in notes else [note]
    return np.clip(albedo, 0, 1), emission * float(strength.get("emissiveStrength", 1.0))
