"""A glTF file -> `Scene`, top to bottom."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from fit.gltf import pose
from fit.gltf.container import Document, read_document
from fit.gltf.errors import GltfError
from fit.gltf.extensions import check_required, note_ignored
from fit.gltf.json_object import JsonObject
from fit.gltf.lights import read_cameras, read_lights
from fit.gltf.materials import Materials
from fit.gltf.meshes import to_mesh
from fit.gltf.nodes import INSTANCING_EXTENSION, drawn_nodes, instance_matrices, read_nodes
from fit.gltf.notes import Notes
from fit.gltf.primitives import Primitive, PrimitiveReader
from fit.scene import Float64, Instance, Mesh, Node, Scene

MAX_INSTANCES = 1_000_000
MAX_DRAWN_TRIANGLES = 200_000_000


def load(path: Path | str, *, scale: float = 1.0) -> Scene:
    """Read a glTF 2.0 file, .gltf or .glb, with everything that it points at.

    The default scene is drawn: `scene`, else scene 0, else every root node. Morph targets and skins take the
    pose that the node graph gives them. What is mended is counted in `repairs`, what is left out in `ignored`.

    Args:
        scale: metres in a unit of the file. It multiplies every length at the roots of the node graph; light
            ranges follow it, and intensities of point and spot lights its square, so that the picture stays.

    Raises:
        GltfError: the file is not glTF 2.0, is damaged, requires what can't be read, or draws no triangle... its
            message names the file, the place in it and the remedy.
    """
    if not (math.isfinite(scale) and scale > 0):
        raise ValueError(f"scale must be a positive number, not {scale}")
    document = read_document(Path(path))
    check_required(document)
    notes = Notes()
    note_ignored(document, notes)
    nodes = read_nodes(document, scale, notes)
    drawn = drawn_nodes(document, notes)
    draw = _Drawing(document, nodes, notes)
    for node in drawn:
        draw.node(node)
    draw.note_unused()
    return Scene(
        source=Path(path),
        meshes=tuple(draw.meshes),
        materials=tuple(draw.materials.materials),
        textures=tuple(draw.materials.textures),
        images=draw.materials.images(),
        nodes=nodes,
        instances=tuple(draw.instances),
        lights=read_lights(document, nodes, drawn, scale),
        cameras=read_cameras(document, nodes, drawn, scale),
        extensions=document.extensions_used,
        repairs=notes.repairs_by_name(),
        ignored=notes.ignored_lines(),
    )


class _Drawing:
    """Meshes and instances as the nodes ask for them; each primitive is read once for each of its poses."""

    def __init__(self, document: Document, nodes: tuple[Node, ...], notes: Notes) -> None:
        self.document = document
        self.nodes = nodes
        self.notes = notes
        self.reader = PrimitiveReader(document, notes)
        self.materials = Materials(document, self.reader.resources, notes)
        self.meshes: list[Mesh] = []
        self.instances: list[Instance] = []
        self._stored: dict[tuple[int, int], Primitive | None] = {}
        self._posed: dict[tuple[int, int, tuple[float, ...], int], int | None] = {}
        self._triangles = 0

    def node(self, index: int) -> None:
        """Draw the mesh of a node, if it has one."""
        definition = self.document.nodes[index]
        mesh = definition.reference("mesh", len(self.document.meshes), "meshes")
        if mesh is None:
            return
        skin = definition.reference("skin", len(self.document.skins), "skins")
        primitives = self.document.meshes[mesh].objects("primitives")
        for number in range(len(primitives)):
            posed = self._mesh(mesh, number, primitives[number], definition, skin)
            if posed is not None:
                self._place(posed, index, definition, skin is not None and self._is_skinned(mesh, number))

    def note_unused(self) -> None:
        """Note the meshes and materials that the scene doesn't draw."""
        drawn = {mesh for mesh, _ in self._stored}
        self.notes.ignore("meshes that the scene does not draw", len(self.document.meshes) - len(drawn))
        self.materials.note_unused()

    def _mesh(
        self, mesh: int, number: int, definition: JsonObject, node: JsonObject, skin: int | None
    ) -> int | None:
        stored = self._primitive(mesh, number, definition)
        if stored is None:
            return None
        weights = self._weights(self.document.meshes[mesh], node, len(stored.targets))
        key = (mesh, number, weights, skin if skin is not None and stored.joints is not None else -1)
        if key not in self._posed:
            posed = pose.morph(stored, weights) if stored.targets else stored
            if key[3] >= 0:
                posed = pose.skin(str(self.document.file), posed, self._joint_matrices(key[3]), self.notes)
            self._posed[key] = len(self.meshes)
            material = self.materials.use(stored.material)
            self.meshes.append(to_mesh(str(self.document.file), posed, material, self.notes))
        return self._posed[key]

    def _primitive(self, mesh: int, number: int, definition: JsonObject) -> Primitive | None:
        if (mesh, number) not in self._stored:
            self._stored[mesh, number] = self.reader.read(self.document.meshes[mesh], number, definition)
        return self._stored[mesh, number]

    def _is_skinned(self, mesh: int, number: int) -> bool:
        stored = self._stored[mesh, number]
        return stored is not None and stored.joints is not None

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
        joints = skin.references("joints", len(self.nodes), "nodes")
        if not joints:
            raise skin.error("required but missing", "joints")
        world = np.stack([self.nodes[joint].world_from_local for joint in joints])
        accessor = skin.reference("inverseBindMatrices", len(self.document.accessors), "accessors")
        if accessor is None:
            return world
        inverse_bind = self.reader.accessors.floats(accessor, "MAT4")
        if len(inverse_bind) < len(joints):
            raise skin.error(f"{len(inverse_bind)} matrices for {len(joints)} joints", "inverseBindMatrices")
        if not np.isfinite(inverse_bind).all():
            raise skin.error("holds NaN or infinity; export the file again", "inverseBindMatrices")
        return world @ inverse_bind[: len(joints)]

    def _place(self, mesh: int, index: int, definition: JsonObject, is_skinned: bool) -> None:
        copies = instance_matrices(self.reader.accessors, definition, self.notes)
        if is_skinned:  # posed in world space already: the transform of the node itself does not count
            matrices = np.eye(4)[None]
            self.notes.ignore(f"{INSTANCING_EXTENSION} on skinned meshes", 0 if copies is None else 1)
        else:
            world = self.nodes[index].world_from_local
            matrices = world[None] if copies is None else world @ copies
        self._triangles += len(self.meshes[mesh].triangles) * len(matrices)
        if self._triangles > MAX_DRAWN_TRIANGLES or len(self.instances) + len(matrices) > MAX_INSTANCES:
            what = f"draws more than {MAX_DRAWN_TRIANGLES} triangles or {MAX_INSTANCES} instances; simplify the scene"
            raise definition.error(what)
        self.instances.extend(Instance(mesh, index, matrix) for matrix in matrices)


__all__ = ["GltfError", "load"]
