"""Primitive sets from .glb and .gltf: our own files, edited ones, and other tools' colliders.

What counts: where a visible unit mesh and its collider disagree, the mesh (it is what an artist moves); where
a material and `extras.sdfprim` disagree, the material; where they agree, the numbers of the collider and of
the extras, which are exact. Without a unit mesh the collider stands alone, without a collider the mesh does.
What can't become a primitive, or had to be guessed, is named in the notes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fit import rotation
from fit.export.files import FormatError
from fit.export.glb import read_container
from fit.export.gltf_facts import NO_FACTS, Facts, is_ours, mesh_kind, mover, read_facts
from fit.export.gltf_nodes import Float64, Graph, read_graph
from fit.export.gltf_paint import face_colors
from fit.export.unit_meshes import HALF_SPACE, misfit
from fit.primitives import PLANE_THICKNESS_LIMIT, Kind, PrimitiveSet

ENDLESS = np.array([np.inf, 0.0, np.inf])

DEFAULT_THICKNESS, DEFAULT_THICKNESS_SHARE = 0.01, 0.01
"""Of a plane that says nothing of one: metres, and the largest share of its smaller size."""

SAME_PLACE = 1e-5
"""Relative difference up to which a unit mesh and its collider are in the same place."""

EDITED_MESH_LIMIT = 0.01
"""Share of its size by which an edited unit mesh may leave the shape it stands for, or be uneven."""


@dataclass(frozen=True)
class Solid:
    """A primitive's geometry: its kind's name, full extents (3,), position (3,), rotation (4,) xyzw.

    A plane's thickness is NaN where nothing tells it.
    """

    kind: str
    size: Float64
    position: Float64
    rotation: Float64


@dataclass(frozen=True)
class Found:
    """The nodes of one primitive: which carries the collider or the extras, and which shows it."""

    owner: int | None
    shown: int | None

    @property
    def node(self) -> int:
        node = self.shown if self.owner is None else self.owner
        assert node is not None
        return node


def read_gltf(path: Path, notes: list[str]) -> PrimitiveSet:
    """Read the primitives of a .glb or .gltf file; what is left out or guessed is appended to `notes`.

    Raises:
        FormatError: the file is malformed, or holds no primitives.
        OSError: the file can't be opened.
    """
    container = read_container(path)
    graph = read_graph(container)
    sets = []
    for found in _find(graph):
        with graph.reading(found.node):
            one = _read_primitive(graph, found, notes)
        sets += [] if one is None else [one]
    if not sets and not is_ours(container.document):
        raise FormatError(
            path,
            "nodes",
            "hold no primitive, neither a KHR_implicit_shapes collider nor a unit mesh of sdfprim; "
            + ("; ".join(notes) or "make primitives with `sdfprim convert`"),
        )
    return PrimitiveSet.concatenate(sets)


def _find(graph: Graph) -> list[Found]:
    """Every primitive of the scene, in the order of its first node."""
    found = []
    shows: set[int] = set()
    for node in graph.parent:
        if "mesh" not in graph.nodes[node]:
            continue
        with graph.reading(node):
            owner = _owner(graph, node)
            if _shown_kind(graph, node, owner) is not None:
                found.append(Found(owner, node))
                shows |= set() if owner is None else {owner}
    found += [Found(node, None) for node in graph.parent if _owns(graph, node) and node not in shows]
    return sorted(found, key=lambda f: f.node)


def _owns(graph: Graph, node: int) -> bool:
    return _collider_json(graph, node) is not None or read_facts(graph, node) is not None


def _owner(graph: Graph, node: int) -> int | None:
    """The nearest of the node and its ancestors that carries a collider or our extras."""
    return next((n for n in graph.ancestry(node) if _owns(graph, n)), None)


def _shown_kind(graph: Graph, node: int, owner: int | None) -> str | None:
    """The kind that the node's mesh shows, if it is a unit mesh: by the mesh's name, else by the extras."""
    named = mesh_kind(graph, node)
    facts = None if owner is None else read_facts(graph, owner)
    return named or (facts.kind if facts else None)


def _read_primitive(graph: Graph, found: Found, notes: list[str]) -> PrimitiveSet | None:
    """The primitive that some nodes stand for; None, with a note, when it can't be one."""
    facts = (None if found.owner is None else read_facts(graph, found.owner)) or NO_FACTS
    solid = None if found.owner is None else _collider_solid(graph, found.owner, facts, notes)
    if found.shown is not None:
        shown = _shown_solid(graph, found.shown, found.owner)
        if solid is None or not _same_place(solid, shown):
            solid = shown
    solid = None if solid is None else _evened(graph, found, solid, notes)
    if solid is None:
        return None
    kind = Kind.PLANE if solid.kind == HALF_SPACE else Kind[solid.kind.upper()]
    painted = _meshes_of(graph, found.node) if found.shown is None else [found.shown]
    albedo, emission = face_colors(
        graph, found.node, painted, solid.position, solid.rotation, kind, facts, notes
    )
    name = _name(graph, found, facts)
    node = mover(graph, found.node)
    return PrimitiveSet(
        kinds=np.array([kind], np.uint8),
        positions=solid.position[None],
        rotations=solid.rotation[None],
        sizes=solid.size[None],
        albedo=albedo,
        emission=emission,
        names=(name,) if name else (),
        nodes=(node,) if node >= 0 else (),
    ).validate()


def _collider_json(graph: Graph, node: int) -> dict[str, Any] | None:
    extensions = graph.nodes[node].get("extensions")
    bodies = extensions.get("KHR_physics_rigid_bodies") if isinstance(extensions, dict) else None
    collider = bodies.get("collider") if isinstance(bodies, dict) else None
    return collider if isinstance(collider, dict) else None


def _collider_solid(graph: Graph, node: int, facts: Facts, notes: list[str]) -> Solid | None:
    """The collider's shape at the node's place; None without one, or, with a note, when it is no primitive.

    A missing number takes the extension's default. Early drafts have `collider.shape`, later ones
    `collider.geometry.shape`.
    """
    collider = _collider_json(graph, node)
    if collider is None:
        return None
    index = collider.get("geometry", collider).get("shape")
    if index is None:
        notes.append(f"{graph.place(node)}: a mesh or hull collider is no primitive; left out")
        return None
    shape = graph.container.document["extensions"]["KHR_implicit_shapes"]["shapes"][index]
    kind, problem = shape["type"], ""
    numbers = shape.get(kind, {})
    size = ENDLESS
    if kind == "box":
        size = np.array(numbers.get("size", (1, 1, 1)), np.float64).reshape(3)
    elif kind == "sphere":
        size = np.full(3, 2 * float(numbers.get("radius", 0.5)))
    elif kind == "cylinder":
        radii = [float(numbers.get(key, 0.25)) for key in ("radiusTop", "radiusBottom")]
        size = np.array([2 * radii[0], float(numbers.get("height", 0.5)), 2 * radii[0]])
        problem = "" if radii[0] == radii[1] else "a cone"
    elif kind == "plane":
        sides = [key for key in ("sizeX", "sizeZ") if key in numbers]
        problem = "" if len(sides) != 1 else "a plane that is endless one way"
        kind = "plane" if sides else HALF_SPACE
        if len(sides) == 2:
            thickness = np.nan if facts.thickness is None else facts.thickness
            size = np.array([float(numbers["sizeX"]), thickness, float(numbers["sizeZ"])])
    else:
        problem = f"a {kind}"
    if problem:
        notes.append(f"{graph.place(node)}: {problem} is no primitive; left out")
        return None
    place = graph.placement(node)
    size = ENDLESS if kind == HALF_SPACE else size * place.scale
    return Solid(kind, size, place.position, place.rotation)


def _shown_solid(graph: Graph, node: int, owner: int | None) -> Solid:
    """The shape of a visible unit mesh, wherever it was moved, scaled, or scaled within its mesh.

    Raises:
        FormatError: the mesh was edited into another shape.
    """
    kind = _shown_kind(graph, node, owner)
    assert kind is not None
    points = graph.positions(node)
    lower, upper = points.min(axis=0), points.max(axis=0)
    extent = upper - lower
    if kind == HALF_SPACE:
        extent[1] = 1.0
    if not np.all(extent > 0):
        raise graph.error(node, f"has a flat mesh, which is no {kind}; restore the unit mesh")
    unit = np.eye(4)
    unit[:3, :3], unit[:3, 3] = np.diag(extent), (lower + upper) / 2
    if misfit(kind, (points - unit[:3, 3]) / extent) > EDITED_MESH_LIMIT:
        raise graph.error(
            node, f"has a mesh that is no {kind} any more; restore the unit mesh and turn the node instead"
        )
    place = graph.decomposed(node, graph.world[node] @ unit)
    size = ENDLESS if kind == HALF_SPACE else place.scale
    return Solid(kind, size, place.position, place.rotation)


def _same_place(collider: Solid, shown: Solid) -> bool:
    """Whether a unit mesh is where its collider is, up to other tools' float32; not if a thickness is NaN."""
    if collider.kind != shown.kind:
        return False
    turns = [rotation.matrices_from_quaternions(s.rotation) for s in (collider, shown)]
    offset = np.abs(collider.position - shown.position).max()
    far = 1e-6 * np.abs(collider.position).max()
    if collider.kind == HALF_SPACE:
        return bool(np.abs(turns[0] - turns[1])[:, 1].max() <= SAME_PLACE and offset <= SAME_PLACE + far)
    apart = np.linalg.norm(turns[0] * collider.size - turns[1] * shown.size, axis=0)
    return bool(
        np.all(apart <= SAME_PLACE * collider.size) and offset <= SAME_PLACE * collider.size.min() + far
    )


def _evened(graph: Graph, found: Found, solid: Solid, notes: list[str]) -> Solid | None:
    """The solid with sizes its kind allows, round ones even, planes thin; None, with a note, if it can't."""
    size = solid.size.copy()
    place = graph.place(found.node)
    round_axes = {"sphere": [0, 1, 2], "cylinder": [0, 2]}.get(solid.kind, [])
    if round_axes and np.ptp(size[round_axes]) > 0:
        across = float(np.mean(size[round_axes]))
        if np.ptp(size[round_axes]) > EDITED_MESH_LIMIT * across:
            problem = f"is a {solid.kind} scaled unevenly, to {size.tolist()}; scale it evenly across"
            if found.shown is not None:
                raise graph.error(found.shown, problem)
            notes.append(f"{place}: {problem}; left out")
            return None
        size[round_axes] = across
    if solid.kind == "plane":
        smaller = min(size[0], size[2])
        if np.isnan(size[1]):
            size[1] = min(DEFAULT_THICKNESS, DEFAULT_THICKNESS_SHARE * smaller)
            notes.append(f"{place}: a plane without thickness; taken as {size[1]:g} m thick")
        if size[1] > PLANE_THICKNESS_LIMIT * smaller * (1 + 1e-6):
            notes.append(f"{place}: too thick for a plane; taken as a box")
            return replace(solid, kind="box", size=size)
    return replace(solid, size=size)


def _meshes_of(graph: Graph, owner: int) -> list[int]:
    """The nodes at and below a collider that have a mesh and no nearer collider of their own."""
    return [n for n in graph.parent if "mesh" in graph.nodes[n] and _owner(graph, n) == owner]


def _name(graph: Graph, found: Found, facts: Facts) -> str:
    """The extras' name while the node's still begins with it, else the node's, unless we made that up."""
    label = str(graph.nodes[found.node].get("name", ""))
    if facts.name and (not label or label.startswith(facts.name)):
        return facts.name
    if found.owner is None:
        label = label.partition(" mesh")[0]
    kind, _, number = label.rpartition("_")
    made_up = kind in ("box", "sphere", "cylinder", "plane", HALF_SPACE) and number[:4].isdigit()
    return "" if made_up else label
