"""A glTF file -> `Scene`, top to bottom."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from fit.gltf import pose
from fit.gltf.animations import read_animations
from fit.gltf.container import Document, read_document
from fit.gltf.extensions import check_required, note_ignored
from fit.gltf.json_object import JsonObject
from fit.gltf.lights import read_cameras, read_lights
from fit.gltf.materials import Materials
from fit.gltf.meshes import to_mesh
from fit.gltf.nodes import INSTANCING_EXTENSION, NodeGraph, drawn_nodes, instance_matrices, read_nodes
from fit.gltf.notes import Notes
from fit.gltf.primitives import Primitive, PrimitiveReader
from fit.scene import Float64, Instance, Mesh, Scene

MAX_INSTANCES = 1_000_000
MAX_DRAWN_TRIANGLES = 200_000_000


def load(path: Path | str, *, scale: float = 1.0) -> Scene:
    """Read a glTF 2.0 file, .gltf or .glb, with everything that it points at.

    The default scene is drawn: `scene`, else scene 0, else every root node. Morph targets and skins take the
    pose that the node graph gives them and keep it, whatever `animations` move. Meshes, materials, textures
    and images that the scene does not use are left out. What is mended is counted in `repairs`, what is left
    out in `ignored`.

    Args:
        scale: metres in a unit of the file. It multiplies every length at the roots of the node graph; ranges
            of lights follow it, and intensities of point and spot lights its square, so the picture stays.

    Raises:
        GltfError: the file is not glTF 2.0, is damaged, requires what can't be read, or draws no triangle;
            the message names the file, the place in it and the remedy.
        ValueError: `scale` is not a positive number.
    """
    if not (math.isfinite(scale) and scale > 0):
        raise ValueError(f"scale must be a positive number, not {scale}")
    # Damaged files hold infinities; they are looked for by name, not met as floating-point exceptions.
    with np.errstate(all="ignore"):
        return _load(read_document(Path(path)), scale)


def _load(document: Document, scale: float) -> Scene:
    check_required(document)
    notes = Notes()
    note_ignored(document, notes)
    graph = read_nodes(document, scale, notes)
    drawn = drawn_nodes(document, graph, notes)
    drawing = _Drawing(document, graph, notes)
    for node in drawn:
        drawing.draw(node)
    drawing.note_unused()
    if drawing.triangles == 0:
        raise document.root.error(_nothing_drawn(notes), "scenes" if document.scenes else "nodes")
    return Scene(
        source=document.file,
        meshes=tuple(drawing.meshes),
        materials=tuple(drawing.materials.materials),
        textures=tuple(drawing.materials.textures),
        images=drawing.materials.images(),
        nodes=graph.nodes,
        instances=tuple(drawing.instances),
        lights=read_lights(document, graph, drawn, scale),
        cameras=read_cameras(document, graph, drawn, scale),
        animations=read_animations(document, graph, drawing.reader.accessors, scale, notes),
        extensions=document.extensions_used,
        repairs=notes.repairs_by_name(),
        ignored=notes.ignored_lines(),
    )


def _nothing_drawn(notes: Notes) -> str:
    there = "; ".join(notes.ignored_lines())
    found = f" (it holds {there})" if there else ""
    return f"the scene draws no triangle{found}; export it with its meshes, points and lines have no surface"


class _Drawing:
    """Meshes and instances as the nodes ask for them; each primitive is read once for each of its poses."""

    def __init__(self, document: Document, graph: NodeGraph, notes: Notes) -> None:
        self.document = document
        self.graph = graph
        self.notes = notes
        self.reader = PrimitiveReader(document, notes)
        self.materials = Materials(document, self.reader.resources, notes)
        self.meshes: list[Mesh] = []
        self.instances: list[Instance] = []
        self.triangles = 0
        self._stored: dict[int, list[Primitive]] = {}
        self._posed: dict[tuple[int, int, tuple[float, ...], int], int] = {}

    def draw(self, index: int) -> None:
        """Draw the mesh of a node, if it has one.

        Raises:
            GltfError: the mesh is damaged, or the scene draws an absurd amount.
        """
        node = self.document.nodes[self.graph.definitions[index]]
        mesh = node.reference("mesh", len(self.document.meshes), "meshes")
        if mesh is None:
            return
        skin = node.reference("skin", len(self.document.skins), "skins")
        copies = instance_matrices(self.reader.accessors, node, self.notes)
        below = np.eye(4)[None] if copies is None else copies
        for number, primitive in enumerate(self._primitives(mesh)):
            if skin is None or primitive.joints is None:
                self._place(self._posed_mesh(node, mesh, number, primitive, None), index, node, below)
                continue
            # Skinned: posed in world space already, the transform of the node itself does not count.
            self.notes.ignore(f"{INSTANCING_EXTENSION} on skinned meshes", int(copies is not None))
            self._place(self._posed_mesh(node, mesh, number, primitive, skin), index, node, None)

    def note_unused(self) -> None:
        """Note the meshes and materials that the scene doesn't draw."""
        self.notes.ignore(
            "meshes that the scene does not draw", len(self.document.meshes) - len(self._stored)
        )
        self.materials.note_unused()

    def _primitives(self, mesh: int) -> list[Primitive]:
        if mesh not in self._stored:
            definition = self.document.meshes[mesh]
            parts = definition.objects("primitives")
            name = definition.string("name", f"mesh {mesh}")
            names = [name] if len(parts) == 1 else [f"{name}.{i}" for i in range(len(parts))]
            found = (self.reader.read(part, each) for part, each in zip(parts, names, strict=True))
            self._stored[mesh] = [primitive for primitive in found if primitive is not None]
        return self._stored[mesh]

    def _posed_mesh(
        self, node: JsonObject, mesh: int, number: int, primitive: Primitive, skin: int | None
    ) -> int:
        """The number in `meshes` of a primitive in the pose that a node gives it."""
        weights = self._weights(self.document.meshes[mesh], node, len(primitive.targets))
        key = (mesh, number, weights, -1 if skin is None else skin)
        if key not in self._posed:
            file = str(self.document.file)
            if primitive.targets or skin is not None:
                self.reader.spend(node, len(primitive.positions), primitive.triangles.size)
            if primitive.targets:
                primitive = pose.morph(primitive, weights)
            if skin is not None:
                primitive = pose.skin(file, primitive, self._joint_matrices(skin), self.notes)
            self._posed[key] = len(self.meshes)
            material = self.materials.use(primitive.material)
            self.meshes.append(to_mesh(file, primitive, material, self.notes))
        return self._posed[key]

    def _weights(self, mesh: JsonObject, node: JsonObject, targets: int) -> tuple[float, ...]:
        """Morph weights: the node's, else the mesh's, else none."""
        owner = node if "weights" in node else mesh
        weights = owner.number_list("weights")
        if weights and targets and len(weights) != targets:
            raise owner.error(f"{len(weights)} weights for {targets} morph targets", "weights")
        return (weights or (0.0,) * targets)[:targets]

    def _joint_matrices(self, index: int) -> Float64:
        """(j, 4, 4): the world matrix of each joint times its inverse bind matrix."""
        skin = self.document.skins[index]
        joints = skin.references("joints", len(self.document.nodes), "nodes")
        if not joints:
            raise skin.error("required but missing", "joints")
        world = np.stack([self.graph.nodes[joint].world_from_local for joint in joints])
        accessor = skin.reference("inverseBindMatrices", len(self.document.accessors), "accessors")
        if accessor is None:
            return world
        inverse_bind = self.reader.accessors.floats(accessor, "MAT4")
        if len(inverse_bind) < len(joints):
            raise skin.error(f"{len(inverse_bind)} matrices for {len(joints)} joints", "inverseBindMatrices")
        if not np.isfinite(inverse_bind).all():
            raise skin.error("holds NaN or infinity; export the file again", "inverseBindMatrices")
        return world @ inverse_bind[: len(joints)]

    def _place(self, mesh: int, index: int, node: JsonObject, copies: Float64 | None) -> None:
        """Draw a mesh at each of `copies` (n, 4, 4) below its node, or, at None, in world space."""
        count = 1 if copies is None else len(copies)
        self.triangles += len(self.meshes[mesh].triangles) * count
        if self.triangles > MAX_DRAWN_TRIANGLES or len(self.instances) + count > MAX_INSTANCES:
            limits = f"{MAX_DRAWN_TRIANGLES} triangles or {MAX_INSTANCES} instances"
            raise node.error(f"the scene draws more than {limits}; simplify it")
        if copies is None:
            self.instances.append(Instance(mesh, index, np.eye(4), None))
            return
        world = self.graph.nodes[index].world_from_local
        self.instances.extend(Instance(mesh, index, world @ copy, copy) for copy in copies)
