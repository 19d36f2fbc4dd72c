"""glTF mesh primitives -> vertex attributes and triangles, as stored: not posed, not mended."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.gltf import draco
from fit.gltf.accessors import SHAPES, Accessors, Rows, check_length, normalize
from fit.gltf.container import Document
from fit.gltf.json_object import JsonObject
from fit.gltf.notes import Notes
from fit.gltf.resources import Resources
from fit.gltf.triangles import MODE_NAMES, TRIANGLES, leftover_corners, to_triangles

Float64 = NDArray[np.float64]

MAX_VALUES = 1 << 26
"""Vertices, and triangle corners, that one file may unfold to: 67 million of each."""


@dataclass(frozen=True)
class Primitive:
    """What the file stores for one primitive; only vertices that a triangle uses.

    positions (n, 3), normals (n, 3) or None, texcoords (n, 2) each, colors (n, 4) or None, triangles (m, 3);
    joints and weights (n, 4 k) or None for skinning; each of `targets` holds the displacements of a morph
    target for weight 1, by attribute name.
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
    targets: tuple[dict[str, Float64], ...] = ()


class PrimitiveReader:
    """Reads the primitives of a document; a budget on what one file may unfold to spans all of them."""

    def __init__(self, document: Document, notes: Notes) -> None:
        self.document = document
        self.notes = notes
        self.resources = Resources(document)
        self.accessors = Accessors(document, self.resources)
        self._vertices = 0
        self._corners = 0

    def read(self, definition: JsonObject, name: str) -> Primitive | None:
        """One primitive, which gets this name; None where it draws no triangle (which is noted).

        Raises:
            GltfError: it names the accessor or attribute that is wrong.
        """
        mode = definition.choice("mode", dict(enumerate(range(len(MODE_NAMES)))), TRIANGLES)
        if mode < TRIANGLES:
            self.notes.ignore(f"{MODE_NAMES[mode]} primitives")
            return None
        attributes = definition.object("attributes")
        if attributes is None:
            raise definition.error("required but missing", "attributes")
        if "POSITION" not in attributes:
            self.notes.ignore("primitives without positions")
            return None
        return _AttributeReader(self, definition, attributes).read(mode, name)

    def spend(self, definition: JsonObject, vertices: int, corners: int) -> None:
        """Book what is about to be allocated.

        Raises:
            GltfError: the whole file asks for an absurd amount.
        """
        self._vertices += vertices
        self._corners += corners
        if max(self._vertices, self._corners) > MAX_VALUES:
            limit = f"{MAX_VALUES} vertices or triangle corners"
            raise definition.error(f"the file unfolds to more than {limit}; simplify or split it")


class _AttributeReader:
    """Reads the attributes of one primitive, from Draco data where it is compressed."""

    def __init__(self, reader: PrimitiveReader, definition: JsonObject, attributes: JsonObject) -> None:
        self.reader = reader
        self.accessors = reader.accessors
        self.definition = definition
        self.attributes = attributes
        self.compressed = self._decode_draco()
        self.stored_vertices = self._stored_vertices()
        self.rows: Rows = None
        self.vertices = self.stored_vertices
        self.read_names: set[str] = set()

    def read(self, mode: int, name: str) -> Primitive | None:
        triangles = self._select_rows(self._triangles(mode))
        if len(triangles) == 0:
            self.reader.notes.ignore("primitives without triangles")
            return None
        positions = self._attribute("POSITION", "VEC3")
        normals = self._attribute("NORMAL", "VEC3")
        texcoords = self._texcoords()
        colors = self._colors()
        joints, weights = self._skinning()
        assert positions is not None
        present = {"POSITION", "NORMAL", "COLOR_0", *(f"TEXCOORD_{i}" for i in range(len(texcoords)))}
        primitive = Primitive(
            place=self.definition.path,
            name=name,
            material=self.definition.reference("material", len(self.reader.document.materials), "materials"),
            positions=positions,
            normals=normals,
            texcoords=texcoords,
            colors=colors,
            triangles=triangles,
            joints=joints,
            weights=weights,
            targets=self._targets(present & self.read_names),
        )
        for left in self.attributes.values:
            if left not in self.read_names:
                self.reader.notes.ignore(f"attribute {left}")
        return primitive

    def _decode_draco(self) -> draco.DracoMesh | None:
        """The decoded data, None where the primitive is not compressed, or stored uncompressed as well."""
        extension = self.definition.extension(draco.DRACO_EXTENSION)
        if extension is None:
            return None
        indices = [self._accessor(self.attributes, key) for key in self.attributes.values]
        is_required = draco.DRACO_EXTENSION in self.reader.document.extensions_required
        if not is_required and all(self.accessors.is_backed(index) for index in indices):
            return None
        declared = max((self.accessors.count(index) for index in indices), default=0)
        self.reader.spend(self.definition, declared, 0)
        return draco.decode(self.reader.document, self.reader.resources, extension)

    def _stored_vertices(self) -> int:
        if self.compressed is not None and "POSITION" in self.compressed.attributes:
            return len(self.compressed.attributes["POSITION"])
        return self.accessors.count(self._accessor(self.attributes, "POSITION"))

    def _accessor(self, owner: JsonObject, key: str) -> int:
        return owner.required_reference(key, len(self.reader.document.accessors), "accessors")

    def _triangles(self, mode: int) -> NDArray[np.uint32]:
        if self.compressed is not None:
            triangles = self.compressed.triangles
            self.reader.spend(self.definition, 0, triangles.size)
            if triangles.max(initial=0) >= max(self.stored_vertices, 1):
                raise self.definition.error("the compressed data contradicts itself; export the file again")
            return triangles
        accessor = self.definition.reference("indices", len(self.reader.document.accessors), "accessors")
        count = self.stored_vertices if accessor is None else self.accessors.count(accessor)
        self.reader.spend(self.definition, 0, count)
        indices = np.arange(count) if accessor is None else self._indices(accessor)
        self.reader.notes.repair("corners that form no triangle", leftover_corners(mode, count))
        return to_triangles(mode, indices)

    def _indices(self, accessor: int) -> NDArray[np.int64]:
        indices = self.accessors.integers(accessor, "SCALAR")
        lowest, highest = indices.min(initial=0), indices.max(initial=-1)
        if lowest < 0 or highest >= self.stored_vertices:
            index = lowest if lowest < 0 else highest
            what = (
                f"index {index} in {self.accessors.definition(accessor).path} points past the "
                f"{self.stored_vertices} vertices; the file is damaged, export it again"
            )
            raise self.definition.error(what, "indices")
        return indices

    def _select_rows(self, triangles: NDArray[np.uint32]) -> NDArray[np.uint32]:
        """Restrict what is read to the vertices in use: many primitives may share one big vertex buffer."""
        if 4 * triangles.size < self.stored_vertices:
            rows = np.unique(triangles)
            triangles = np.searchsorted(rows, triangles).astype(np.uint32)
        else:
            used = np.zeros(self.stored_vertices, bool)
            used[triangles] = True
            rows = np.flatnonzero(used).astype(np.uint32)
            if len(rows) < self.stored_vertices:
                triangles = (np.cumsum(used) - 1).astype(np.uint32)[triangles]
        self.reader.spend(self.definition, len(rows), 0)
        if len(rows) < self.stored_vertices:
            self.rows, self.vertices = rows, len(rows)
        return triangles

    def _attribute(self, name: str, *types: str) -> Float64 | None:
        """Values (vertices, n) of an attribute, None where the primitive has none of this name."""
        if name not in self.attributes:
            return None
        self.read_names.add(name)
        index = self._accessor(self.attributes, name)
        if self.compressed is None or name not in self.compressed.attributes:
            check_length(self.attributes, name, range(self.accessors.count(index)), self.stored_vertices)
            return self.accessors.floats(index, *types, rows=self.rows)
        definition, values = self.accessors.definition(index), self.compressed.attributes[name]
        check_length(self.attributes, name, values, self.stored_vertices)
        kind = definition.string("type")
        if kind not in types or values.shape[1] != SHAPES[kind][1]:
            what = f"{kind!r} does not fit {name} as it is compressed; export the file again"
            raise definition.error(what, "type")
        return normalize(values if self.rows is None else values[self.rows], definition)

    def _texcoords(self) -> tuple[Float64, ...]:
        found: list[Float64] = []
        while (values := self._attribute(f"TEXCOORD_{len(found)}", "VEC2")) is not None:
            found.append(values)
        return tuple(found)

    def _colors(self) -> Float64 | None:
        values = self._attribute("COLOR_0", "VEC3", "VEC4")
        if values is None or values.shape[1] == 4:
            return values
        return np.concatenate([values, np.ones((len(values), 1))], axis=1)

    def _skinning(self) -> tuple[NDArray[np.int64] | None, Float64 | None]:
        joints: list[NDArray[np.int64]] = []
        weights: list[Float64] = []
        while True:
            joint = self._attribute(f"JOINTS_{len(joints)}", "VEC4")
            weight = self._attribute(f"WEIGHTS_{len(joints)}", "VEC4")
            if joint is None or weight is None:
                break
            joints.append(np.where(np.isfinite(joint), joint, -1.0).astype(np.int64))
            weights.append(weight)
        if not joints:
            return None, None
        return np.concatenate(joints, axis=1), np.concatenate(weights, axis=1)

    def _targets(self, present: set[str]) -> tuple[dict[str, Float64], ...]:
        """Morph targets, restricted to attributes that the primitive has."""
        types = {"POSITION": ("VEC3",), "NORMAL": ("VEC3",), "COLOR_0": ("VEC3", "VEC4")}
        targets = []
        for target in self.definition.objects("targets"):
            deltas = {}
            for name in target.values:
                if name in present:
                    index = self._accessor(target, name)
                    check_length(target, name, range(self.accessors.count(index)), self.stored_vertices)
                    self.reader.spend(self.definition, self.vertices, 0)
                    deltas[name] = self.accessors.floats(index, *types.get(name, ("VEC2",)), rows=self.rows)
            targets.append(deltas)
        return tuple(targets)
