"""The node graph: transforms, which nodes a scene draws, and GPU instances (glTF 2.0, section 3.5)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fit.gltf.accessors import Accessors, check_length
from fit.gltf.container import Document
from fit.gltf.json_object import JsonObject
from fit.gltf.notes import Notes
from fit.scene import Node

Float64 = NDArray[np.float64]

LARGEST_TRANSFORM = 1e15
"""Entries of a world matrix above it are damage: float64 has no millimetres left out there."""

INSTANCING_EXTENSION = "EXT_mesh_gpu_instancing"


def read_nodes(document: Document, scale: float, notes: Notes) -> tuple[Node, ...]:
    """All nodes of the file, in its order, `scale` multiplied into the roots.

    Raises:
        GltfError: a cycle, a node with two parents, or a transform that is not affine and finite.
    """
    definitions = document.nodes
    children = [node.references("children", len(definitions), "nodes") for node in definitions]
    parents = _parents(definitions, children)
    local = [_local_matrix(node, notes) for node in definitions]
    roots = [i for i, parent in enumerate(parents) if parent < 0]
    for root in roots:
        local[root] = np.diag([scale, scale, scale, 1.0]) @ local[root]
    world = _world_matrices(definitions, children, roots, local)
    return tuple(
        Node(node.string("name", f"node {i}"), parents[i], local[i], world[i])
        for i, node in enumerate(definitions)
    )


def _parents(definitions: list[JsonObject], children: list[tuple[int, ...]]) -> list[int]:
    parents = [-1] * len(definitions)
    for parent, below in enumerate(children):
        for child in below:
            if parents[child] >= 0:
                what = f"node {child} has two parents, nodes {parents[child]} and {parent}; export the file again"
                raise definitions[parent].error(what, "children")
            parents[child] = parent
    return parents


def _world_matrices(
    definitions: list[JsonObject], children: list[tuple[int, ...]], roots: list[int], local: list[Float64]
) -> list[Float64]:
    """World matrices from the roots down; what no root leads to hangs on a cycle."""
    world: list[Float64 | None] = [None] * len(definitions)
    waiting = [(root, np.eye(4)) for root in reversed(roots)]
    while waiting:
        node, above = waiting.pop()
        with np.errstate(over="ignore", invalid="ignore", under="ignore"):
            matrix = above @ local[node]
        if not np.abs(matrix).max() <= LARGEST_TRANSFORM:
            raise definitions[node].error("its world transform is absurdly large; check the scales above it")
        world[node] = matrix
        waiting.extend((child, matrix) for child in children[node])
    done = []
    for node, reached in enumerate(world):
        if reached is None:
            what = "the node is its own ancestor, the graph has a cycle; export the file again"
            raise definitions[node].error(what, "children")
        done.append(reached)
    return done


def drawn_nodes(document: Document, notes: Notes) -> list[int]:
    """Nodes of the default scene, depth first: `scene`, else scene 0, else every root."""
    definitions, scenes = document.nodes, document.scenes
    chosen = document.root.reference("scene", len(scenes), "scenes") if scenes else None
    if scenes:
        notes.ignore("scenes that are not the default", len(scenes) - 1)
        start = scenes[chosen or 0].references("nodes", len(definitions), "nodes")
    else:
        below = {
            child for node in definitions for child in node.references("children", len(definitions), "nodes")
        }
        start = tuple(i for i in range(len(definitions)) if i not in below)
    order: list[int] = []
    seen: set[int] = set()
    waiting = list(reversed(start))
    while waiting:
        node = waiting.pop()
        if node in seen:
            notes.repair("nodes listed twice in the scene")
            continue
        seen.add(node)
        if _is_hidden(definitions[node]):
            notes.ignore("nodes hidden by KHR_node_visibility, with all below")
            continue
        order.append(node)
        waiting.extend(reversed(definitions[node].references("children", len(definitions), "nodes")))
    return order


def _is_hidden(node: JsonObject) -> bool:
    visibility = node.extension("KHR_node_visibility")
    return visibility is not None and not visibility.boolean("visible", True)


def _local_matrix(node: JsonObject, notes: Notes) -> Float64:
    if "matrix" in node:
        matrix = np.array(node.numbers("matrix", 16)).reshape(4, 4).T
        if not np.allclose(matrix[3], (0, 0, 0, 1), atol=1e-5):
            raise node.error("its last row must be 0 0 0 1; export the file again", "matrix")
        matrix[3] = (0, 0, 0, 1)
        return np.ascontiguousarray(matrix)
    translation = node.numbers("translation", 3, (0.0, 0.0, 0.0))
    rotation = node.numbers("rotation", 4, (0.0, 0.0, 0.0, 1.0))
    scale = node.numbers("scale", 3, (1.0, 1.0, 1.0))
    return compose(np.array([translation]), np.array([rotation]), np.array([scale]), notes)[0]


def compose(translations: Float64, rotations: Float64, scales: Float64, notes: Notes) -> Float64:
    """Matrices (n, 4, 4) of translations (n, 3), quaternions xyzw (n, 4) and scales (n, 3): T R S."""
    lengths = np.abs(rotations).max(axis=1, keepdims=True)
    lost = lengths[:, 0] <= 0
    notes.repair("rotations of zero length read as none", int(np.count_nonzero(lost)))
    quaternions = np.where(
        lost[:, None], (0.0, 0.0, 0.0, 1.0), rotations / np.where(lengths > 0, lengths, 1.0)
    )
    x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    matrices = np.zeros((len(translations), 4, 4))
    matrices[:, 0, :3] = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], axis=1)
    matrices[:, 1, :3] = np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], axis=1)
    matrices[:, 2, :3] = np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=1)
    matrices[:, :3, :3] *= scales[:, None, :]
    matrices[:, :3, 3] = translations
    matrices[:, 3, 3] = 1.0
    return matrices


def instance_matrices(accessors: Accessors, node: JsonObject, notes: Notes) -> Float64 | None:
    """Matrices (n, 4, 4) of EXT_mesh_gpu_instancing below the node's own, None where it has none.

    Raises:
        GltfError: attributes of different counts, or values that are not finite.
    """
    extension = node.extension(INSTANCING_EXTENSION)
    if extension is None:
        return None
    attributes = extension.object("attributes")
    if attributes is None or not attributes.values:
        raise extension.error("required but missing", "attributes")
    size = len(accessors.document.accessors)
    indices = {name: attributes.required_reference(name, size, "accessors") for name in attributes.values}
    count = accessors.count(next(iter(indices.values())))
    parts = {}
    for name, default, kind in (
        ("TRANSLATION", (0.0, 0.0, 0.0), "VEC3"),
        ("ROTATION", (0.0, 0.0, 0.0, 1.0), "VEC4"),
        ("SCALE", (1.0, 1.0, 1.0), "VEC3"),
    ):
        if name in indices:
            parts[name] = accessors.floats(indices.pop(name), kind)
            check_length(attributes, parts[name], count, name)
        else:
            parts[name] = np.broadcast_to(np.array(default), (count, len(default)))
        if not np.isfinite(parts[name]).all():
            raise attributes.error("holds NaN or infinity; export the file again", name)
    for name in indices:
        notes.ignore(f"instance attribute {name}")
    return compose(parts["TRANSLATION"], parts["ROTATION"], parts["SCALE"], notes)
