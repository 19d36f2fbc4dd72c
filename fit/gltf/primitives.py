"""glTF mesh primitives -> vertex attributes and triangles, as stored: not posed, not mended."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fit.gltf import draco
from fit.gltf.accessors import SHAPES, Accessors, check_length, normalize
from fit.gltf.container import Document
from fit.gltf.json_object import JsonObject
from fit.gltf.notes import Notes
from fit.gltf.resources import Resources
from fit.gltf.triangles import MODE_NAMES, TRIANGLES, leftover_corners, to_triangles

Float64 = NDArray[np.float64]

MAX_VERTICES = 1 << 26
"""Vertices, and triangle corners, that one file may hold; 67 million of each."""


@dataclass
class MorphTarget:
    """Displacements for weight 1, by attribute name (`POSITION`, `NORMAL`, `TEXCOORD_n`, `COLOR_0`)."""

    deltas: dict[str, Float64]


@dataclass
class Primitive:
    """What the file stores for one primitive.

    positions (n, 3), normals (n, 3) or None, texcoords (n, 2) each, colors (n, 4) or None, triangles (m, 3);
    joints and weights (n, 4 k) or None for skinning.
    """

    place: str
    name: str
    material: int | None
    positions: Float64
    normals: Float64 | None
    texcoords: tuple[Float64, ...]
    colors: Float64 | None
    triangles: NDArray[np.uint32]
    joints: NDArray[np.int64] | None = None
    weights: Float64 | None = None
    targets: tuple[MorphTarget, ...] = field(default=())


class PrimitiveReader:
    """Reads the primitives of a document; a budget on what one file may ask for spans all of them."""

    def __init__(self, document: Document, notes: Notes) -> None:
        self.document = document
        self.notes = notes
        self.resources = Resources(document)
        self.accessors = Accessors(document, self.resources)
        self._vertices = 0
        self._corners = 0

    def read(self, mesh: JsonObject, index: int, definition: JsonObject) -> Primitive | None:
        """One primitive, None where it draws no triangle (which is noted).

        Raises:
            GltfError: it names the accessor or attribute that is wrong.
        """
        mode = definition.choice("mode", dict(enumerate(range(7))), TRIANGLES)
        if mode < TRIANGLES:
            self.notes.ignore(f"{MODE_NAMES[mode]} primitives")
            return None
        attributes = definition.object("attributes")
        if attributes is None:
            raise definition.error("required but missing", "attributes")
        if "POSITION" not in attributes:
            self.notes.ignore("primitives without positions")
            return None
        return _AttributeReader(self, definition, attributes).read(mode, _name(mesh, index))

    def spend(self, definition: JsonObject, vertices: int, corners: int) -> None:
        """Book what a primitive is about to allocate.

        Raises:
            GltfError: the whole file asks for an absurd amount.
        """
        self._vertices += vertices
        self._corners += corners
        if max(self._vertices, self._corners) > MAX_VERTICES:
            what = (
                f"the file holds more than {MAX_VERTICES} vertices or triangle corners; simplify or split it"
            )
            raise definition.error(what)


class _AttributeReader:
    """Reads the attributes of one primitive, from Draco data where it is compressed."""

    def __init__(self, reader: PrimitiveReader, definition: JsonObject, attributes: JsonObject) -> None:
        self.reader = reader
        self.accessors = reader.accessors
        self.definition = definition
        self.attributes = attributes
        self.draco: draco.DracoMesh | None = None
        self.used: set[str] = set()

    def read(self, mode: int, name: str) -> Primitive:
        position = self._accessor(self.attributes, "POSITION")
        vertices = self.accessors.count(position)
        indices = self._index_accessor()
        self.reader.spend(
            self.definition, vertices, vertices if indices is None else self.accessors.count(indices)
        )
        self._decode_draco()
        positions = self._attribute("POSITION", "VEC3")
        assert positions is not None
        if self.draco is not None:
            vertices = len(positions)
        primitive = Primitive(
            place=self.definition.path,
            name=name,
            material=self.definition.reference("material", len(self.reader.document.materials), "materials"),
            positions=positions,
            normals=self._vertex_attribute("NORMAL", vertices, "VEC3"),
            texcoords=self._texcoords(vertices),
            colors=self._colors(vertices),
            triangles=self._triangles(mode, indices, vertices),
        )
        primitive.joints, primitive.weights = self._skinning(vertices)
        primitive.targets = self._targets(primitive)
        for left in self.attributes.values:
            if left not in self.used:
                self.reader.notes.ignore(f"attribute {left}")
        return primitive

    def _decode_draco(self) -> None:
        extension = self.definition.extension(draco.DRACO_EXTENSION)
        if extension is None:
            return
        required = draco.DRACO_EXTENSION in self.reader.document.extensions_required
        stored = all(
            self.accessors.is_backed(self._accessor(self.attributes, key)) for key in self.attributes.values
        )
        if required or not stored:
            self.draco = draco.decode(self.reader.document, self.reader.resources, extension)
            self._check_draco(extension)

    def _check_draco(self, extension: JsonObject) -> None:
        assert self.draco is not None
        counts = {len(values) for values in self.draco.attributes.values()}
        corners = self.draco.triangles.size
        if len(counts) > 1 or (corners and self.draco.triangles.max() >= min(counts, default=0)):
            raise extension.error("the compressed data contradicts itself; export the file again")
        self.reader.spend(self.definition, max(counts, default=0), corners)

    def _accessor(self, owner: JsonObject, key: str) -> int:
        return owner.required_reference(key, len(self.reader.document.accessors), "accessors")

    def _index_accessor(self) -> int | None:
        return self.definition.reference("indices", len(self.reader.document.accessors), "accessors")

    def _attribute(self, name: str, *types: str) -> Float64 | None:
        if name not in self.attributes:
            return None
        self.used.add(name)
        index = self._accessor(self.attributes, name)
        if self.draco is None or name not in self.draco.attributes:
            return self.accessors.floats(index, *types)
        definition, values = self.accessors.definition(index), self.draco.attributes[name]
        kind = definition.string("type")
        components = definition.choice("type", SHAPES)[1]
        if kind not in types or values.shape[1] != components:
            raise definition.error(
                f"{kind!r} does not fit {name} as it is compressed; export the file again", "type"
            )
        return normalize(values, definition)

    def _vertex_attribute(self, name: str, vertices: int, *types: str) -> Float64 | None:
        values = self._attribute(name, *types)
        if values is not None:
            check_length(self.attributes, values, vertices, name)
        return values

    def _texcoords(self, vertices: int) -> tuple[Float64, ...]:
        found = []
        while (values := self._vertex_attribute(f"TEXCOORD_{len(found)}", vertices, "VEC2")) is not None:
            found.append(values)
        return tuple(found)

    def _colors(self, vertices: int) -> Float64 | None:
        values = self._vertex_attribute("COLOR_0", vertices, "VEC3", "VEC4")
        if values is None or values.shape[1] == 4:
            return values
        return np.concatenate([values, np.ones((vertices, 1))], axis=1)

    def _triangles(self, mode: int, accessor: int | None, vertices: int) -> NDArray[np.uint32]:
        if self.draco is not None:
            return self.draco.triangles
        if accessor is None:
            indices = np.arange(vertices)
        else:
            indices = self.accessors.integers(accessor, "SCALAR")
            if indices.min() < 0 or indices.max() >= vertices:
                bad = indices.min() if indices.min() < 0 else indices.max()
                what = (
                    f"index {bad} in {self.accessors.definition(accessor).path} points past "
                    f"the {vertices} vertices; the file is damaged, export it again"
                )
                raise self.definition.error(what, "indices")
        self.reader.notes.repair("corners that form no triangle", leftover_corners(mode, len(indices)))
        return to_triangles(mode, indices)

    def _skinning(self, vertices: int) -> tuple[NDArray[np.int64] | None, Float64 | None]:
        joints, weights = [], []
        while f"JOINTS_{len(joints)}" in self.attributes and f"WEIGHTS_{len(joints)}" in self.attributes:
            number = len(joints)
            influence = self._vertex_attribute(f"WEIGHTS_{number}", vertices, "VEC4")
            joint = self._vertex_attribute(f"JOINTS_{number}", vertices, "VEC4")
            assert influence is not None and joint is not None
            weights.append(influence)
            joints.append(joint.astype(np.int64))
        if not joints:
            return None, None
        return np.concatenate(joints, axis=1), np.concatenate(weights, axis=1)

    def _targets(self, primitive: Primitive) -> tuple[MorphTarget, ...]:
        shapes = {"POSITION": ("VEC3",), "NORMAL": ("VEC3",), "COLOR_0": ("VEC3", "VEC4")}
        present = {"POSITION"} | {f"TEXCOORD_{i}" for i in range(len(primitive.texcoords))}
        present |= {"NORMAL"} if primitive.normals is not None else set()
        present |= {"COLOR_0"} if primitive.colors is not None else set()
        targets = []
        for target in self.definition.objects("targets"):
            deltas = {}
            for name in target.values:
                if name in present:
                    values = self.accessors.floats(self._accessor(target, name), *shapes.get(name, ("VEC2",)))
                    check_length(target, values, len(primitive.positions), name)
                    deltas[name] = values
            targets.append(MorphTarget(deltas))
        return tuple(targets)


def _name(mesh: JsonObject, index: int) -> str:
    name = mesh.string("name", mesh.path)
    return name if len(mesh.objects("primitives")) == 1 else f"{name}.{index}"
