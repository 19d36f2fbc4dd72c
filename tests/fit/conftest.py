"""A writer of small glTF files from NumPy arrays, for tests of the reader."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

COMPONENT_TYPES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
SQUARE_INDICES = np.array([0, 1, 2, 0, 2, 3], np.uint16)


class GltfBuilder:
    """Collects a document and its one buffer; `document` may be changed at will before writing."""

    def __init__(self) -> None:
        self.document: dict[str, Any] = {"asset": {"version": "2.0"}}
        self.buffer = bytearray()

    def add(self, collection: str, **entry: Any) -> int:
        """Append to a top-level array; the index of the new entry."""
        entries = self.document.setdefault(collection, [])
        entries.append(entry)
        return len(entries) - 1

    def view(self, data: bytes, **entry: Any) -> int:
        """A buffer view of its own for `data`, at a multiple of four bytes."""
        self.buffer.extend(b"\0" * (-len(self.buffer) % 4))
        offset = len(self.buffer)
        self.buffer.extend(data)
        return self.add("bufferViews", buffer=0, byteOffset=offset, byteLength=len(data), **entry)

    def accessor(self, values: np.ndarray, **entry: Any) -> int:
        """An accessor of `values` (n,) or (n, components) in their own little-endian dtype."""
        values = np.ascontiguousarray(values)
        width = 1 if values.ndim == 1 else values.shape[1]
        entry = {
            "bufferView": self.view(values.astype(values.dtype.newbyteorder("<")).tobytes()),
            "componentType": COMPONENT_TYPES[f"{values.dtype.kind}{values.dtype.itemsize}"],
            "count": len(values),
            "type": TYPES[width],
        } | entry
        return self.add("accessors", **entry)

    def primitive(
        self, positions: Any = SQUARE, indices: Any = SQUARE_INDICES, **entry: Any
    ) -> dict[str, Any]:
        """A primitive; accessor numbers pass through, arrays are stored; capitalised names are attributes."""
        attributes = {"POSITION": self._number(positions)}
        attributes |= {key: self._number(value) for key, value in entry.items() if key.isupper()}
        plain = {key: value for key, value in entry.items() if not key.isupper()}
        if indices is not None:
            plain["indices"] = self._number(indices)
        return {"attributes": attributes, **plain}

    def mesh(self, *primitives: dict[str, Any], **entry: Any) -> int:
        return self.add("meshes", primitives=list(primitives), **entry)

    def node(self, **entry: Any) -> int:
        return self.add("nodes", **entry)

    def square(self, **entry: Any) -> int:
        """A node with a unit square of two triangles in the plane z = 0; `entry` goes to its primitive."""
        return self.node(mesh=self.mesh(self.primitive(**entry)))

    def extend(self, *names: str, required: bool = False) -> None:
        """List extensions as used, and as required."""
        for key in ("extensionsUsed", "extensionsRequired")[: 2 if required else 1]:
            self.document.setdefault(key, []).extend(names)

    def glb(self) -> bytes:
        """The whole as a .glb file."""
        document = dict(self.document)
        if self.buffer:
            document["buffers"] = [{"byteLength": len(self.buffer)}, *document.get("buffers", [])]
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        if self.buffer:
            data = bytes(self.buffer) + b"\0" * (-len(self.buffer) % 4)
            chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def write(self, path: Path) -> Path:
        """The whole at `path`: a .glb, or a .gltf with its buffer in `<stem>.bin` unless it lists its own."""
        if path.suffix == ".glb":
            path.write_bytes(self.glb())
            return path
        document = dict(self.document)
        if "buffers" not in document and self.buffer:
            document["buffers"] = [{"byteLength": len(self.buffer), "uri": f"{path.stem}.bin"}]
            path.with_suffix(".bin").write_bytes(self.buffer)
        path.write_text(json.dumps(document), encoding="utf-8")
        return path

    def _number(self, values: Any) -> int:
        return values if isinstance(values, int) else self.accessor(values)


@pytest.fixture
def builder() -> GltfBuilder:
    """An empty glTF document."""
    return GltfBuilder()


@pytest.fixture
def new_builder() -> type[GltfBuilder]:
    """The writer itself, for tests that need several documents."""
    return GltfBuilder


@pytest.fixture
def load_built(tmp_path):
    """Write a builder's document as .glb and load it."""
    from fit.gltf import load

    def load_it(builder: GltfBuilder, **options: Any):
        return load(builder.write(tmp_path / "built.glb"), **options)

    return load_it
