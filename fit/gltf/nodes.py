"""The node graph: transforms, which nodes a scene draws, and GPU instances (glTF 2.0, section 3.5)."""

from __future__ import annotations

from dataclasses import dataclass

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

MAX_NODES = 1_000_000

INSTANCING_EXTENSION = "EXT_mesh_gpu_instancing"


@dataclass(frozen=True)
class NodeGraph:
    """The nodes as a tree.

    The file's nodes come first, in its order; copies of nodes with several parents, which glTF forbids and
    some exporters write all the same, come after them. `definitions[i]` is the file's node behind node i.
    """

    nodes: tuple[Node, ...]
    definitions: tuple[int, ...]
    children: tuple[tuple[int, ...], ...]


def read_nodes(document: Document, scale: float, notes: Notes) -> NodeGraph:
    """All nodes of the file, `scale` multiplied into the roots.

    Raises:
        GltfError: a cycle, or a transform that is not affine and finite.
    """
    files = document.nodes
    below = [node.references("children", len(files), "nodes") for node in files]
    _refuse_cycles(files, below)
    definitions, parents, children, order = _as_tree(files, below)
    notes.repair("nodes with several parents copied", len(definitions) - len(files))
    local = [_local_matrix(node, notes) for node in files]
    resize = np.diag([scale, scale, scale, 1.0])
    nodes: list[Node | None] = [None] * len(definitions)
    for index in order:
        definition, parent = definitions[index], parents[index]
        above = nodes[parent] if parent >= 0 else None
        matrix = local[definition] if above else resize @ local[definition]
        world = above.world_from_local @ matrix if above else matrix
        if not np.abs(world).max() <= LARGEST_TRANSFORM:
            raise files[definition].error("its world transform is absurdly large; check the scales above it")
        nodes[index] = Node(files[definition].string("name", f"node {definition}"), parent, matrix, world)
    placed = tuple(node for node in nodes if node is not None)
    return NodeGraph(placed, tuple(definitions), tuple(tuple(each) for each in children))


def _refuse_cycles(files: list[JsonObject], below: list[tuple[int, ...]]) -> None:
    """Peel off nodes without parents until none is left; what stays lies on a cycle or hangs below one."""
    parents = np.zeros(len(files), np.int64)
    for children in below:
        for child in children:
            parents[child] += 1
    free = [int(node) for node in np.flatnonzero(parents == 0)]
    peeled = 0
    while free:
        peeled += 1
        for child in below[free.pop()]:
            parents[child] -= 1
            if parents[child] == 0:
                free.append(child)
    if peeled < len(files):
        node = int(np.flatnonzero(parents)[0])
        raise files[node].error("the node is its own ancestor, the graph has a cycle; export the file again")


def _as_tree(
    files: list[JsonObject], below: list[tuple[int, ...]]
) -> tuple[list[int], list[int], list[list[int]], list[int]]:
    """Definitions, parents and children of the nodes of the tree, and its nodes from the roots down.

    Raises:
        GltfError: nodes with several parents multiply beyond `MAX_NODES`.
    """
    has_parent = {child for children in below for child in children}
    definitions, parents = list(range(len(files))), [-1] * len(files)
    children: list[list[int]] = [[] for _ in files]
    order: list[int] = []
    placed = [False] * len(files)
    waiting = [(root, -1) for root in reversed(range(len(files))) if root not in has_parent]
    while waiting:
        definition, parent = waiting.pop()
        index = definition
        if placed[definition]:
            index = len(definitions)
            definitions.append(definition)
            parents.append(-1)
            children.append([])
            if index >= MAX_NODES:
                raise files[definition].error(
                    f"shared children make more than {MAX_NODES} nodes; flatten the graph"
                )
        placed[definition] = True
        parents[index] = parent
        order.append(index)
        if parent >= 0:
            children[parent].append(index)
        waiting.extend((child, index) for child in reversed(below[definition]))
    return definitions, parents, children, order


def drawn_nodes(document: Document, graph: NodeGraph, notes: Notes) -> list[int]:
    """Nodes of the default scene, depth first: `scene`, else scene 0, else every root."""
    scenes = document.scenes
    if scenes:
        chosen = document.root.reference("scene", len(scenes), "scenes")
        start = scenes[chosen or 0].references("nodes", len(document.nodes), "nodes")
        notes.ignore("scenes that are not the default", len(scenes) - 1)
    else:
        start = tuple(i for i, node in enumerate(graph.nodes) if node.parent < 0)
    order: list[int] = []
    seen: set[int] = set()
    waiting = list(reversed(start))
    while waiting:
        node = waiting.pop()
        if node in seen:
            notes.repair("nodes listed twice in the scene")
            continue
        seen.add(node)
        if _is_hidden(document.nodes[graph.definitions[node]]):
            notes.ignore("nodes hidden by KHR_node_visibility, with all below")
            continue
        order.append(node)
        waiting.extend(reversed(graph.children[node]))
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
    translation, rotation, scale = rest_transform(node)
    return compose(translation[None], rotation[None], scale[None], notes)[0]


def rest_transform(node: JsonObject) -> tuple[Float64, Float64, Float64]:
    """Translation (3,), rotation (4,), a quaternion xyzw, and scale (3,) of a node without a matrix."""
    translation = node.numbers("translation", 3, (0.0, 0.0, 0.0))
    rotation = node.numbers("rotation", 4, (0.0, 0.0, 0.0, 1.0))
    scale = node.numbers("scale", 3, (1.0, 1.0, 1.0))
    return np.array(translation), np.array(rotation), np.array(scale)


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
            check_length(attributes, name, parts[name], count)
        else:
            parts[name] = np.broadcast_to(np.array(default), (count, len(default)))
        if not np.isfinite(parts[name]).all():
            raise attributes.error("holds NaN or infinity; export the file again", name)
    for name in indices:
        notes.ignore(f"instance attribute {name}")
    return compose(parts["TRANSLATION"], parts["ROTATION"], parts["SCALE"], notes)
