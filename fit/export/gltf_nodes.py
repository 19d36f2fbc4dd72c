"""The node graph of a glTF file as the reader of primitives needs it: places, and triangles with colours."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit import rotation
from fit.export.files import FormatError
from fit.export.glb import Container

Float64 = NDArray[np.float64]

MALFORMED = (LookupError, TypeError, AttributeError, ValueError, ArithmeticError)
"""What NumPy and Python raise at JSON of a wrong shape."""

SHEAR_LIMIT = 1e-4
"""Cosine between two axes of a node above which it counts as sheared."""


@dataclass(frozen=True)
class Placement:
    """A node's place in the world: position (3,), rotation (4,) xyzw, scale (3,) > 0.

    A mirrored node has its local x turned round, which no primitive's shape can tell.
    """

    position: Float64
    rotation: Float64
    scale: Float64

    def matrix(self) -> Float64:
        """(4, 4), world from local."""
        m = np.eye(4)
        m[:3, :3] = rotation.matrices_from_quaternions(self.rotation) * self.scale
        m[:3, 3] = self.position
        return m


@dataclass(frozen=True)
class Triangles:
    """World-space corners (t, 3, 3) of one glTF primitive and its material's index, or None."""

    corners: Float64
    material: int | None


@dataclass
class Graph:
    """The nodes that the file's scene holds, in ascending order, with parents and world matrices."""

    container: Container
    nodes: list[dict[str, Any]]
    parent: dict[int, int] = field(default_factory=dict)
    world: dict[int, Float64] = field(default_factory=dict)

    def error(self, node: int, problem: str) -> FormatError:
        """An error about a node, ready to raise."""
        return FormatError(self.container.path, self.place(node), problem)

    @contextmanager
    def reading(self, node: int) -> Iterator[None]:
        """Turns whatever malformed JSON raises in this block into a FormatError about the node."""
        try:
            yield
        except FormatError:
            raise
        except MALFORMED as error:
            raise self.error(node, f"is malformed: {error}; save the file again") from error

    def place(self, node: int) -> str:
        """How messages call a node."""
        name = self.nodes[node].get("name", "")
        return f"nodes[{node}] {name!r}" if name else f"nodes[{node}]"

    def ancestry(self, node: int) -> list[int]:
        """The node, its parent, and so on up to a root."""
        chain = [node]
        while self.parent[chain[-1]] >= 0:
            chain.append(self.parent[chain[-1]])
        return chain

    def placement(self, node: int) -> Placement:
        """The node's place; its own numbers, to the last bit, when no parent moves it."""
        own, parent = self.nodes[node], self.parent[node]
        still = parent < 0 or np.array_equal(self.world[parent], np.eye(4))
        scale = np.array(own.get("scale", (1, 1, 1)), np.float64)
        if still and "matrix" not in own and np.all(scale > 0):
            return Placement(
                np.array(own.get("translation", (0, 0, 0)), np.float64),
                np.array(own.get("rotation", (0, 0, 0, 1)), np.float64),
                scale,
            )
        return self.decomposed(node, self.world[node])

    def decomposed(self, node: int, matrix: Float64) -> Placement:
        """The place that a (4, 4) matrix gives the node.

        Raises:
            FormatError: the matrix shears or flattens.
        """
        columns = matrix[:3, :3]
        scale = np.linalg.norm(columns, axis=0)
        if not np.all(np.isfinite(matrix)) or not np.all(scale > 0):
            raise self.error(node, "is scaled to nothing, or not finite; give it a size")
        turn = columns / scale
        if np.abs(turn.T @ turn - np.eye(3)).max() > SHEAR_LIMIT:
            raise self.error(node, "is sheared; undo the uneven scale of its parents")
        if np.linalg.det(turn) < 0:
            turn = turn * np.array([-1.0, 1.0, 1.0])
        return Placement(matrix[:3, 3].copy(), rotation.quaternions_from_matrices(turn), scale)

    def positions(self, node: int) -> Float64:
        """Every vertex (v, 3) of the node's mesh, in the node's own space."""
        mesh = self.container.document["meshes"][self.nodes[node]["mesh"]]
        arrays = [self.container.accessor(p["attributes"]["POSITION"]) for p in mesh["primitives"]]
        return np.concatenate(arrays).astype(np.float64)

    def triangles(self, node: int) -> list[Triangles]:
        """The triangles of the node's mesh, counter-clockwise from outside, by glTF primitive."""
        found = []
        for part in self.container.document["meshes"][self.nodes[node]["mesh"]]["primitives"]:
            if part.get("mode", 4) != 4:
                continue
            points = self.container.accessor(part["attributes"]["POSITION"]).astype(np.float64)
            points = points @ self.world[node][:3, :3].T + self.world[node][:3, 3]
            order = (
                self.container.accessor(part["indices"]).astype(np.intp)
                if "indices" in part
                else np.arange(len(points))
            )
            corners = points[order[: len(order) // 3 * 3]].reshape(-1, 3, 3)
            if np.linalg.det(self.world[node][:3, :3]) < 0:
                corners = corners[:, ::-1]
            found.append(Triangles(corners, part.get("material")))
        return found


def read_graph(container: Container) -> Graph:
    """The graph below the file's scene; below all roots where it has no scene.

    Raises:
        FormatError: a node is its own ancestor, has two parents, or is malformed.
    """
    document = container.document
    nodes = document.get("nodes", [])
    if not isinstance(nodes, list) or not all(isinstance(node, dict) for node in nodes):
        raise FormatError(container.path, "nodes", "is no list of nodes; save the file again")
    graph = Graph(container, nodes)
    pending = [(root, -1, np.eye(4)) for root in _roots(container, nodes)]
    while pending:
        node, parent, above = pending.pop()
        if type(node) is not int or not 0 <= node < len(nodes):
            raise FormatError(container.path, "nodes", f"hold no {node!r}, which a parent names")
        if node in graph.parent:
            raise graph.error(node, "has two parents or is its own ancestor; save the file again")
        with graph.reading(node):
            world = above @ _local_matrix(nodes[node])
            children = list(nodes[node].get("children", []))
        graph.parent[node], graph.world[node] = parent, world
        pending += [(child, node, world) for child in children]
    graph.parent = dict(sorted(graph.parent.items()))
    return graph


def _roots(container: Container, nodes: list[dict[str, Any]]) -> list[Any]:
    document = container.document
    try:
        if document.get("scenes"):
            return list(document["scenes"][document.get("scene", 0)].get("nodes", []))
        children = {child for node in nodes for child in node.get("children", [])}
    except MALFORMED as error:
        raise FormatError(
            container.path, "scenes", f"are malformed ({error!r}); save the file again"
        ) from error
    return [node for node in range(len(nodes)) if node not in children]


def _local_matrix(node: dict[str, Any]) -> Float64:
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    turn = np.array(node.get("rotation", (0, 0, 0, 1)), np.float64).reshape(4)
    matrix = np.eye(4)
    matrix[:3, :3] = rotation.matrices_from_quaternions(turn) * np.array(
        node.get("scale", (1, 1, 1)), np.float64
    ).reshape(3)
    matrix[:3, 3] = np.array(node.get("translation", (0, 0, 0)), np.float64).reshape(3)
    return matrix
