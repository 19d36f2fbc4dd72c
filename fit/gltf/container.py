"""The two containers, .gltf and .glb: bytes -> JSON document and binary chunk (glTF 2.0, section 4)."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NoReturn

from fit.gltf.errors import GltfError
from fit.gltf.json_object import JsonObject

GLB_MAGIC = b"glTF"
CHUNK_JSON = 0x4E4F534A
CHUNK_BIN = 0x004E4942

_CONVERT_MESH = "python -c \"import trimesh; trimesh.load('{name}').export('{stem}.glb')\""
TRIMESH_FORMATS = frozenset({".obj", ".stl", ".ply", ".off"})


@dataclass(frozen=True)
class Document:
    """A parsed file: the JSON root, and the binary chunk of a .glb."""

    file: Path
    root: JsonObject
    binary: memoryview | None = None

    @cached_property
    def accessors(self) -> list[JsonObject]:
        return self.root.objects("accessors")

    @cached_property
    def buffers(self) -> list[JsonObject]:
        return self.root.objects("buffers")

    @cached_property
    def buffer_views(self) -> list[JsonObject]:
        return self.root.objects("bufferViews")

    @cached_property
    def cameras(self) -> list[JsonObject]:
        return self.root.objects("cameras")

    @cached_property
    def images(self) -> list[JsonObject]:
        return self.root.objects("images")

    @cached_property
    def materials(self) -> list[JsonObject]:
        return self.root.objects("materials")

    @cached_property
    def meshes(self) -> list[JsonObject]:
        return self.root.objects("meshes")

    @cached_property
    def nodes(self) -> list[JsonObject]:
        return self.root.objects("nodes")

    @cached_property
    def samplers(self) -> list[JsonObject]:
        return self.root.objects("samplers")

    @cached_property
    def scenes(self) -> list[JsonObject]:
        return self.root.objects("scenes")

    @cached_property
    def skins(self) -> list[JsonObject]:
        return self.root.objects("skins")

    @cached_property
    def textures(self) -> list[JsonObject]:
        return self.root.objects("textures")

    @cached_property
    def extensions_used(self) -> tuple[str, ...]:
        return self.root.strings("extensionsUsed")

    @cached_property
    def extensions_required(self) -> tuple[str, ...]:
        return self.root.strings("extensionsRequired")


def read_document(file: Path) -> Document:
    """Read the container of a glTF 2.0 file.

    Raises:
        GltfError: no such file, another format, glTF 1.0, a damaged container or damaged JSON.
    """
    data = _read_file(file)
    text: bytes | memoryview = data
    binary = None
    if data[:4] == GLB_MAGIC:
        text, binary = _split_glb(file, data)
    elif not data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{"):
        raise GltfError(file, "container", _not_gltf(file))
    root = JsonObject(file, "", _parse_json(file, bytes(text)))
    _check_version(root)
    return Document(file, root, binary)


def _read_file(file: Path) -> bytes:
    if not file.exists():
        raise GltfError(file, "container", "there is no such file; check the path")
    if not file.is_file():
        raise GltfError(file, "container", "is not a regular file; give the path of a .gltf or .glb file")
    try:
        return file.read_bytes()
    except OSError as error:
        raise GltfError(
            file, "container", f"can't be read ({error.strerror}); check its permissions"
        ) from error


def _not_gltf(file: Path) -> str:
    if file.suffix.lower() in TRIMESH_FORMATS:
        command = _CONVERT_MESH.format(name=file.name, stem=file.stem)
        return f"is not a glTF file but {file.suffix.lower()}; convert it first: {command}"
    return "is not a glTF 2.0 file; export the scene as .glb or .gltf, from Blender for one"


def _split_glb(file: Path, data: bytes) -> tuple[memoryview, memoryview | None]:
    if len(data) < 12:
        raise GltfError(file, "glb header", "the file ends within it; it is truncated, fetch it again")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise GltfError(file, "glb header", _other_version(str(version)))
    if not 12 <= length <= len(data):
        what = f"declares {length} bytes but the file has {len(data)}; it is truncated, fetch it again"
        raise GltfError(file, "glb header", what)
    view = memoryview(data)[:length]
    text = binary = None
    offset = 12
    while offset + 8 <= length:
        size, kind = struct.unpack_from("<II", view, offset)
        if offset + 8 + size > length:
            what = (
                f"a chunk of {size} bytes at byte {offset} runs past the end; it is truncated, fetch it again"
            )
            raise GltfError(file, "glb chunks", what)
        chunk = view[offset + 8 : offset + 8 + size]
        if kind == CHUNK_JSON and text is None:
            text = chunk
        elif kind == CHUNK_BIN and binary is None:
            binary = chunk
        offset += 8 + size + -size % 4
    if text is None:
        raise GltfError(file, "glb chunks", "there is no JSON chunk; export the file again")
    return text, binary


def _parse_json(file: Path, text: bytes) -> dict[str, Any]:
    def refuse(literal: str) -> NoReturn:
        raise ValueError(f"{literal} is not a JSON number")

    try:
        root = json.loads(text.decode("utf-8-sig").rstrip("\0"), parse_constant=refuse)
    except RecursionError as error:
        raise GltfError(file, "JSON", "is nested too deeply; export the file again") from error
    except ValueError as error:
        raise GltfError(file, "JSON", f"can't be parsed ({error}); export the file again") from error
    if not isinstance(root, dict):
        raise GltfError(file, "JSON", "must be an object; this is not a glTF file")
    return root


def _check_version(root: JsonObject) -> None:
    asset = root.object("asset")
    if asset is None:
        raise root.error("required but missing; this is not a glTF 2.0 file", "asset")
    if "version" not in asset:
        raise asset.error("required but missing; " + _other_version("unknown"), "version")
    version = asset.string("version")
    least = asset.string("minVersion", "2.0")
    if version.split(".")[0] != "2":
        raise asset.error(_other_version(version), "version")
    if least != "2.0":
        raise asset.error(
            f"needs a reader of glTF {least}, this one reads 2.0; export it as glTF 2.0", "minVersion"
        )


def _other_version(version: str) -> str:
    remedy = "convert a glTF 1.0 file with `npx gltf-pipeline -i in.gltf -o out.glb`"
    return f"glTF version {version} is not supported, only 2.0 is; {remedy}"
