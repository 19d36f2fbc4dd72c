"""Buffers and the files that a glTF file points at; nothing outside the file's folder is ever opened."""

from __future__ import annotations

import base64
import binascii
import re
import reprlib
from pathlib import Path
from urllib.parse import unquote, unquote_to_bytes

from fit.gltf.container import Document
from fit.gltf.errors import GltfError
from fit.gltf.extensions import MESHOPT_EXTENSIONS, extension_remedy
from fit.gltf.json_object import JsonObject

_SCHEME = re.compile(r"^[A-Za-z][A-Za-z0-9+.-]*:")


class Resources:
    """Reads buffers lazily, each once."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self._buffers: dict[int, memoryview] = {}

    def buffer_view(self, index: int) -> memoryview:
        """The bytes of a buffer view.

        Raises:
            GltfError: it is meshopt-compressed without a fallback, or runs past the end of its buffer.
        """
        view = self.document.buffer_views[index]
        for name in MESHOPT_EXTENSIONS:
            if view.extension(name) is not None and not self._has_fallback(view):
                raise view.error(extension_remedy(name), f"extensions.{name}")
        buffer = self._buffer(view.required_reference("buffer", len(self.document.buffers), "buffers"))
        offset = view.integer("byteOffset", 0)
        length = view.integer("byteLength")
        if offset + length > len(buffer):
            what = (
                f"bytes {offset} to {offset + length} run past the end of the buffer, which has {len(buffer)}"
            )
            raise view.error(f"{what}; export the file again")
        return buffer[offset : offset + length]

    def _has_fallback(self, view: JsonObject) -> bool:
        index = view.required_reference("buffer", len(self.document.buffers), "buffers")
        buffer = self.document.buffers[index]
        return "uri" in buffer or (
            index == 0 and self.document.binary is not None and not _is_placeholder(buffer)
        )

    def _buffer(self, index: int) -> memoryview:
        if index not in self._buffers:
            self._buffers[index] = self._read_buffer(index)
        return self._buffers[index]

    def _read_buffer(self, index: int) -> memoryview:
        buffer = self.document.buffers[index]
        length = buffer.integer("byteLength")
        if "uri" in buffer:
            data = memoryview(self.read_uri(buffer, length))
        elif index == 0 and self.document.binary is not None:
            data = self.document.binary
        else:
            raise buffer.error("has no uri and the file has no binary chunk for it; export the file again")
        if len(data) < length:
            what = f"declares {length} bytes but only {len(data)} are there; it is truncated, fetch it again"
            raise buffer.error(what, "byteLength")
        return data[:length]

    def read_uri(self, owner: JsonObject, limit: int | None = None) -> bytes:
        """The bytes of `owner.uri`: a data URI, or a file in the folder of the glTF file.

        Args:
            limit: reads at most so many bytes of a file.

        Raises:
            GltfError: a malformed or foreign URI, one that leaves the folder, or no such file.
        """
        uri = owner.string("uri")
        if uri[:5].lower() == "data:":
            return _decode_data_uri(owner, uri)
        path = self._resolve(owner, uri)
        try:
            with path.open("rb") as stream:
                size = path.stat().st_size
                return stream.read(size if limit is None else min(size, limit))
        except OSError as error:
            raise owner.error(
                f"{path.name} can't be read ({error.strerror}); check its permissions", "uri"
            ) from error

    def has_uri(self, owner: JsonObject) -> bool:
        """Whether `owner.uri` is a data URI or a file that is there; errors as in `read_uri` but for that."""
        uri = owner.string("uri")
        return uri[:5].lower() == "data:" or self._find(owner, uri) is not None

    def _resolve(self, owner: JsonObject, uri: str) -> Path:
        path = self._find(owner, uri)
        if path is None:
            shown = reprlib.repr(unquote(uri))
            raise owner.error(f"{shown} is missing; put it beside {self.document.file.name}", "uri")
        return path

    def _find(self, owner: JsonObject, uri: str) -> Path | None:
        """The file inside the folder that a URI names, None where there is none."""
        if _SCHEME.match(uri) or uri.startswith(("/", "\\")):
            what = f"{reprlib.repr(uri)} is not a relative path; put the file beside the glTF file"
            raise owner.error(what, "uri")
        folder = self.document.file.parent.resolve()
        # The decoded name is what glTF means; some exporters write a real "%20" or a Windows separator.
        names = (unquote(uri), uri, unquote(uri).replace("\\", "/"))
        found = (_existing_file(owner, folder, name) for name in dict.fromkeys(names))
        return next((path for path in found if path is not None), None)


def _is_placeholder(buffer: JsonObject) -> bool:
    extensions = [buffer.extension(name) for name in MESHOPT_EXTENSIONS]
    return any(extension is not None and extension.boolean("fallback") for extension in extensions)


def _existing_file(owner: JsonObject, folder: Path, name: str) -> Path | None:
    try:
        path = (folder / name).resolve()
        inside = path.is_relative_to(folder)
        exists = path.is_file()
    except (OSError, ValueError, RuntimeError) as error:
        raise owner.error(f"is not a usable file name ({error})", "uri") from error
    if not inside:
        what = f"{name[:80]!r} leaves the folder of the glTF file; put the file inside the folder"
        raise owner.error(what, "uri")
    return path if exists else None


def _decode_data_uri(owner: JsonObject, uri: str) -> bytes:
    header, comma, body = uri.partition(",")
    if not comma:
        raise owner.error("is a data URI without a comma; export the file again", "uri")
    if not header.lower().endswith(";base64"):
        return unquote_to_bytes(body)
    text = "".join(unquote(body).split())
    try:
        return base64.b64decode(text + "=" * (-len(text) % 4), validate=True)
    except (binascii.Error, ValueError) as error:
        raise _broken_base64(owner, error) from error


def _broken_base64(owner: JsonObject, error: Exception) -> GltfError:
    return owner.error(f"is a data URI whose base64 is damaged ({error}); export the file again", "uri")
