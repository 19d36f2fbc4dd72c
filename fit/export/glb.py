"""The glTF container: JSON and binary data of .glb and .gltf files, and their vertex data, nothing more.

Source: glTF 2.0 specification, 3.6 (binary data) and 4 (GLB).
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from fit.export.files import FormatError

_MAGIC, _JSON, _BIN = b"glTF", b"JSON", b"BIN\0"
_COMPONENTS = {
    5120: np.int8,
    5121: np.uint8,
    5122: np.int16,
    5123: np.uint16,
    5125: np.uint32,
    5126: np.float32,
}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


@dataclass(frozen=True)
class Container:
    """A glTF file: its JSON and, for a .glb, its binary chunk."""

    path: Path
    document: dict[str, Any]
    binary: bytes = b""
    _buffers: dict[int, bytes] = field(default_factory=dict, repr=False, compare=False)
    _arrays: dict[int, NDArray[Any]] = field(default_factory=dict, repr=False, compare=False)

    def accessor(self, index: int) -> NDArray[Any]:
        """Values (count,) or (count, width) of an accessor, read-only, normalised ones as float64.

        Raises:
            FormatError: the accessor is sparse, compressed or does not fit its buffer.
        """
        if index not in self._arrays:
            self._arrays[index] = self._read_accessor(index)
            self._arrays[index].flags.writeable = False
        return self._arrays[index]

    def _read_accessor(self, index: int) -> NDArray[Any]:
        place = f"accessors[{index}]"
        try:
            a = self.document["accessors"][index]
            dtype, width, count = np.dtype(_COMPONENTS[a["componentType"]]), _WIDTHS[a["type"]], a["count"]
            if "sparse" in a or "bufferView" not in a:
                raise FormatError(self.path, place, "is sparse; save the file without sparse accessors")
            view = self.document["bufferViews"][a["bufferView"]]
            if view["buffer"] not in self._buffers:
                self._buffers[view["buffer"]] = self._read_buffer(view["buffer"])
            data = self._buffers[view["buffer"]]
            row = dtype.itemsize * width
            stride = view.get("byteStride", row)
            start = view.get("byteOffset", 0) + a.get("byteOffset", 0)
            if min(start, count - 1, stride - row) < 0 or start + (count - 1) * stride + row > len(data):
                raise FormatError(self.path, place, "reaches beyond its buffer; save the file again")
            values = np.ndarray(
                (count, width), dtype.newbyteorder("<"), data, start, (stride, dtype.itemsize)
            )
        except (KeyError, IndexError, TypeError) as error:
            raise FormatError(self.path, place, f"is malformed ({error!r}); save the file again") from error
        if a.get("normalized") and dtype.kind != "f":
            values = np.maximum(values / float(np.iinfo(dtype.name).max), -1.0)
        return values[:, 0].copy() if width == 1 else values.copy()

    def _read_buffer(self, index: int) -> bytes:
        uri = self.document["buffers"][index].get("uri")
        place = f"buffers[{index}]"
        if uri is None:
            return self.binary
        if uri.startswith("data:"):
            try:
                return base64.b64decode(uri.partition(",")[2], validate=True)
            except binascii.Error as error:
                raise FormatError(self.path, place, f"holds broken base64 ({error})") from error
        folder = self.path.parent.resolve()
        file = (folder / unquote(uri)).resolve()
        if not file.is_relative_to(folder):
            raise FormatError(
                self.path, place, f"leads out of the file's folder ({uri}); put it beside the file"
            )
        if not file.is_file():
            raise FormatError(self.path, place, f"names {uri}, which is not there; put it beside the file")
        return file.read_bytes()


def read_container(path: Path) -> Container:
    """Read a .glb or .gltf file's JSON and binary chunk.

    Raises:
        FormatError: it is neither, or is cut short.
        OSError: the file can't be opened.
    """
    content = path.read_bytes()
    text, binary = _chunks(path, content) if content[:4] == _MAGIC else (content, b"")
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FormatError(path, "JSON", f"can't be parsed ({error}); save the file again") from error
    if not isinstance(document, dict) or not isinstance(document.get("asset"), dict):
        raise FormatError(path, "asset", "is missing: this is no glTF 2.0 file")
    if str(document["asset"].get("version", "")).split(".")[0] != "2":
        raise FormatError(path, "asset.version", "is not 2; convert the file to glTF 2.0")
    return Container(path, document, binary)


def _chunks(path: Path, content: bytes) -> tuple[bytes, bytes]:
    if len(content) < 20:
        raise FormatError(path, "header", "is cut short; save the file again")
    version, length = struct.unpack_from("<II", content, 4)
    if version != 2 or length > len(content):
        raise FormatError(
            path, "header", f"says version {version}, {length} bytes, but {len(content)} are there"
        )
    found: dict[bytes, bytes] = {}
    offset = 12
    while offset + 8 <= length:
        size, kind = struct.unpack_from("<I4s", content, offset)
        if offset + 8 + size > length:
            raise FormatError(path, f"chunk at byte {offset}", "is cut short; save the file again")
        found.setdefault(kind, content[offset + 8 : offset + 8 + size])
        offset += 8 + size
    if _JSON not in found:
        raise FormatError(path, "chunks", "hold no JSON; save the file again")
    return found[_JSON], found.get(_BIN, b"")


def build_glb(document: dict[str, Any], binary: bytes) -> bytes:
    """The bytes of a .glb; numbers keep their full double precision, keys their order.

    Raises:
        ValueError: a number is not finite.
    """
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()
    chunks = [(_JSON, text + b" " * (-len(text) % 4))]
    if binary:
        chunks.append((_BIN, binary + b"\0" * (-len(binary) % 4)))
    body = b"".join(struct.pack("<I4s", len(content), kind) + content for kind, content in chunks)
    return _MAGIC + struct.pack("<II", 2, 12 + len(body)) + body
