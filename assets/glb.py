"""Writes the bundled scenes: a small glTF 2.0 binary writer whose bytes depend on its input alone."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from shapes import Shape

FLOAT, UINT16, UINT32 = 5126, 5123, 5125
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
REPEAT, LINEAR, LINEAR_MIPMAP_LINEAR = 10497, 9729, 9987


class Glb:
    """A scene being built: materials, parts, lights and cameras in the order in which they are added."""

    def __init__(self, name: str) -> None:
        self._binary = bytearray()
        self._extensions: set[str] = set()
        self._lights: list[dict[str, Any]] = []
        self._splines: dict[tuple[bytes, bytes], int] = {}
        self._json: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "sdfprim assets/generate.py"},
            "scene": 0,
            "scenes": [{"name": name, "nodes": []}],
            "nodes": [],
        }

    def texture(self, name: str, shades: NDArray[np.uint8], palette: ArrayLike) -> int:
        """A repeating texture; `shades` (h, w) are row numbers of `palette` (n, 3), sRGB from 0 to 255."""
        view = self._view(_png(shades, np.asarray(palette, dtype=np.uint8)))
        if "samplers" not in self._json:
            filters = {"magFilter": LINEAR, "minFilter": LINEAR_MIPMAP_LINEAR}
            self._json["samplers"] = [{**filters, "wrapS": REPEAT, "wrapT": REPEAT}]
        image = self._append("images", {"name": name, "mimeType": "image/png", "bufferView": view})
        return self._append("textures", {"sampler": 0, "source": image})

    def material(
        self,
        name: str,
        color: Sequence[float] = (1.0, 1.0, 1.0),
        *,
        texture: int | None = None,
        emission: Sequence[float] | None = None,
        double_sided: bool = False,
    ) -> int:
        """A rough dielectric. `color` is linear; `emission` is radiance, W/m2/sr."""
        surface: dict[str, Any] = {"baseColorFactor": [*color, 1.0], "metallicFactor": 0.0}
        if texture is not None:
            surface["baseColorTexture"] = {"index": texture}
        material: dict[str, Any] = {"name": name, "pbrMetallicRoughness": surface}
        if double_sided:
            material["doubleSided"] = True
        if emission is not None:
            strength = max(*emission, 1.0)
            material["emissiveFactor"] = [round(value / strength, 6) for value in emission]
            material["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
            self._extensions.add("KHR_materials_emissive_strength")
        return self._append("materials", material)

    def part(
        self,
        name: str,
        material: int,
        shape: Shape,
        tile: float = 1.0,
        places: Sequence[Sequence[float]] = (),
    ) -> None:
        """A mesh, drawn once as it is, or once at each of `places`; texture coordinates are metres divided
        by `tile`."""
        mesh = self.mesh(name, [(material, shape)], tile)
        if not places:
            self._root({"name": name, "mesh": mesh})
        for number, place in enumerate(places):
            self._root({"name": f"{name} {number}", "mesh": mesh, "translation": list(map(float, place))})

    def mesh(self, name: str, parts: Sequence[tuple[int, Shape]], tile: float = 1.0) -> int:
        """A mesh of parts, each of one material, that nothing draws yet; its index."""
        primitives = []
        for material, shape in parts:
            attributes = {
                "POSITION": self._accessor(shape.positions, bounds=True),
                "NORMAL": self._accessor(shape.normals),
                "TEXCOORD_0": self._accessor(shape.texcoords / tile),
            }
            primitives.append(
                {"attributes": attributes, "indices": self._indices(shape.triangles), "material": material}
            )
        return self._append("meshes", {"name": name, "primitives": primitives})

    def carried(self, name: str, mesh: int, place: Sequence[float], rest: Sequence[float]) -> int:
        """A node that draws a mesh and rests at `rest` within a root node at `place`; its index."""
        child = self._append("nodes", {"name": name, "mesh": mesh, "translation": list(map(float, rest))})
        self._root({"name": f"{name}, place", "translation": list(map(float, place)), "children": [child]})
        return child

    def instances(self, name: str, mesh: int, places: ArrayLike, rotations: ArrayLike) -> None:
        """A mesh at many places (n, 3), turned by quaternions (n, 4) xyzw, as GPU instances of one node."""
        attributes = {
            "TRANSLATION": self._accessor(np.asarray(places, float)),
            "ROTATION": self._accessor(np.asarray(rotations, float)),
        }
        self._extensions.add("EXT_mesh_gpu_instancing")
        extension = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
        self._root({"name": name, "mesh": mesh, "extensions": extension})

    def spline(self, node: int, times: NDArray[np.float64], keys: NDArray[np.float64]) -> None:
        """Moves a node's translation along a spline: times (k,), keys (k, 3, 3), in-tangent, value and
        out-tangent. Equal splines are stored once."""
        if "animations" not in self._json:
            self._append("animations", {"name": "all", "channels": [], "samplers": []})
        animation = self._json["animations"][0]
        key = (times.tobytes(), keys.tobytes())
        if key not in self._splines:
            self._splines[key] = len(animation["samplers"])
            clock = self._accessor(times[:, None], bounds=True)
            values = self._accessor(keys.reshape(-1, 3))
            animation["samplers"].append({"input": clock, "output": values, "interpolation": "CUBICSPLINE"})
        target = {"node": node, "path": "translation"}
        animation["channels"].append({"sampler": self._splines[key], "target": target})

    def sun(self, name: str, towards: Sequence[float], irradiance: float) -> None:
        """A directional light; `towards` points at the sun."""
        self._light({"name": name, "type": "directional", "intensity": irradiance}, _aim(towards), (0, 0, 0))

    def point_light(self, name: str, position: Sequence[float], intensity: float) -> None:
        """A white point light, W/sr."""
        self._light({"name": name, "type": "point", "intensity": intensity}, (0, 0, 0, 1), position)

    def camera(self, name: str, position: Sequence[float], target: Sequence[float], fov: float) -> None:
        """A perspective camera; `fov` is vertical, in degrees."""
        perspective = {"yfov": round(float(np.radians(fov)), 6), "znear": 0.05}
        camera = self._append("cameras", {"name": name, "type": "perspective", "perspective": perspective})
        backwards = np.asarray(position, float) - np.asarray(target, float)
        place = {"translation": list(map(float, position)), "rotation": _aim(backwards)}
        self._root({"name": name, "camera": camera, **place})

    def write(self, path: Path) -> None:
        """Writes the binary container."""
        document = dict(self._json)
        if self._lights:
            document["extensions"] = {"KHR_lights_punctual": {"lights": self._lights}}
        if self._extensions:
            document["extensionsUsed"] = sorted(self._extensions)
        document["buffers"] = [{"byteLength": len(self._binary)}]
        text = json.dumps(document, separators=(",", ":")).encode()
        chunks = (
            (b"JSON", text + b" " * (-len(text) % 4)),
            (b"BIN\0", bytes(self._binary) + b"\0" * (-len(self._binary) % 4)),
        )
        body = b"".join(struct.pack("<I", len(data)) + kind + data for kind, data in chunks)
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)

    def _append(self, kind: str, item: dict[str, Any]) -> int:
        items = self._json.setdefault(kind, [])
        items.append(item)
        return len(items) - 1

    def _root(self, node: dict[str, Any]) -> None:
        self._json["scenes"][0]["nodes"].append(self._append("nodes", node))

    def _light(self, light: dict[str, Any], rotation: Sequence[float], position: Sequence[float]) -> None:
        self._extensions.add("KHR_lights_punctual")
        self._lights.append(light)
        extension = {"KHR_lights_punctual": {"light": len(self._lights) - 1}}
        place = {"translation": list(map(float, position)), "rotation": list(map(float, rotation))}
        self._root({"name": light["name"], **place, "extensions": extension})

    def _view(self, data: bytes, target: int | None = None) -> int:
        self._binary += b"\0" * (-len(self._binary) % 4)
        view = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": len(data)}
        self._binary += data
        return self._append("bufferViews", view | ({"target": target} if target else {}))

    def _accessor(self, values: NDArray[np.float64], bounds: bool = False) -> int:
        data = (np.round(values, 6) + 0.0).astype("<f4")  # rounded, so that libm's last bit changes no byte
        view = self._view(data.tobytes(), ARRAY_BUFFER)
        accessor: dict[str, Any] = {"bufferView": view, "componentType": FLOAT, "count": len(data)}
        accessor["type"] = "SCALAR" if data.shape[1] == 1 else f"VEC{data.shape[1]}"
        if bounds:
            accessor |= {"min": data.min(axis=0).tolist(), "max": data.max(axis=0).tolist()}
        return self._append("accessors", accessor)

    def _indices(self, triangles: NDArray[np.int64]) -> int:
        small = triangles.max() < 65535
        data = triangles.reshape(-1).astype("<u2" if small else "<u4")
        view = self._view(data.tobytes(), ELEMENT_ARRAY_BUFFER)
        kind = UINT16 if small else UINT32
        accessor = {"bufferView": view, "componentType": kind, "count": len(data), "type": "SCALAR"}
        return self._append("accessors", accessor)


def _aim(backwards: ArrayLike) -> list[float]:
    """Quaternion (xyzw) that turns local +Z to `backwards` and keeps local X level."""
    z = np.asarray(backwards, float)
    z = z / np.linalg.norm(z)
    x = np.cross([0.0, 1.0, 0.0], z)
    x = x / np.linalg.norm(x) if np.linalg.norm(x) > 1e-9 else np.array([1.0, 0.0, 0.0])
    m = np.stack([x, np.cross(z, x), z], axis=1)
    # q q^T from the matrix; its largest column is the best-conditioned multiple of q
    k = np.array(
        [
            [1 + m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]],
            [m[0, 1] + m[1, 0], 1 - m[0, 0] + m[1, 1] - m[2, 2], m[1, 2] + m[2, 1], m[0, 2] - m[2, 0]],
            [m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], 1 - m[0, 0] - m[1, 1] + m[2, 2], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], 1 + m[0, 0] + m[1, 1] + m[2, 2]],
        ]
    )
    column = k[:, int(np.argmax(np.diagonal(k)))]
    return [round(float(value), 7) + 0.0 for value in column / np.linalg.norm(column)]


def _png(shades: NDArray[np.uint8], palette: NDArray[np.uint8]) -> bytes:
    """Palette PNG in stored deflate blocks: no two zlib versions compress alike, so nothing is compressed."""
    height, width = shades.shape
    rows = np.concatenate([np.zeros((height, 1), np.uint8), shades], axis=1).tobytes()
    blocks = [rows[start : start + 65535] for start in range(0, len(rows), 65535)]
    stored = b"".join(
        struct.pack("<BHH", block is blocks[-1], len(block), len(block) ^ 0xFFFF) + block for block in blocks
    )
    stream = b"\x78\x01" + stored + struct.pack(">I", zlib.adler32(rows))
    header = struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"PLTE", palette.tobytes()), (b"IDAT", stream), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )
