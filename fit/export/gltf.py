"""Primitive sets as .prims.glb: colliders for programs, unit meshes with materials for viewers and artists.

Each primitive is a node with its place, its KHR_implicit_shapes shape as a KHR_physics_rigid_bodies collider,
and our own facts in `extras.sdfprim`; its child shows a unit mesh scaled to size. docs/formats.md has the
details, and `fit.export.gltf_reader` reads the file back.
"""

from __future__ import annotations

from collections.abc import Hashable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.export.files import write_atomically
from fit.export.glb import build_glb
from fit.export.unit_meshes import HALF_SPACE, UNIT_MESHES, UnitMesh
from fit.primitives import Kind, PrimitiveSet

VERSION = 1
"""Of `extras.sdfprim`."""

MESH_PREFIX = "sdfprim_"
"""Begins the name of every unit mesh, followed by the kind: some tools drop extras, none drops names."""

NODE_PREFIX = "sdfprim_node_"
"""Begins the name of the node above primitives that move, followed by the index of the scene's node that they
move with."""

HALF_SPACE_SIZE = 100.0
"""Metres: that side in a set without finite primitives."""

_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_FLOAT, _UNSIGNED_SHORT = 5126, 5123


def write_glb(primitives: PrimitiveSet, path: Path) -> None:
    """Write the set; the same set gives the same bytes.

    Raises:
        ValueError: the set is invalid.
    """
    primitives.validate()
    builder = _Builder()
    quad = half_space_size(primitives)
    for i in range(len(primitives)):
        builder.add(primitives, i, quad)
    write_atomically(path, build_glb(builder.document(), bytes(builder.binary)))


def kind_name(primitives: PrimitiveSet, i: int) -> str:
    """What `extras.sdfprim.kind` calls primitive i."""
    return HALF_SPACE if primitives.is_half_space[i] else Kind(primitives.kinds[i]).name.lower()


def node_name(kind: str, i: int) -> str:
    """The node name of a primitive without a name of its own."""
    return f"{kind}_{i:04d}"


def half_space_size(primitives: PrimitiveSet) -> float:
    """Side of the square that shows a half-space: twice the diagonal of the finite primitives' bounds."""
    if primitives.is_half_space.all():
        return HALF_SPACE_SIZE
    lower, upper = primitives.bounds()
    return 2.0 * float(np.linalg.norm(upper - lower))


class _Builder:
    """Collects the parts of the file; equal materials, meshes and index ranges are written once."""

    def __init__(self) -> None:
        self.binary = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.materials: list[dict[str, Any]] = []
        self.meshes: list[dict[str, Any]] = []
        self.shapes: list[dict[str, Any]] = []
        self.nodes: list[dict[str, Any]] = []
        self.roots: list[int] = []
        self.count = 0
        self._known: dict[Hashable, int] = {}

    def document(self) -> dict[str, Any]:
        glows = any("extensions" in m for m in self.materials)
        used = ["KHR_implicit_shapes", "KHR_physics_rigid_bodies"] if self.shapes else []
        parts = {
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": self.materials,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.binary)}] if self.binary else [],
            "extensionsUsed": used + ["KHR_materials_emissive_strength"] * glows,
        }
        document: dict[str, Any] = {
            "asset": {
                "version": "2.0",
                "generator": "sdfprim",
                "extras": {"sdfprim": {"version": VERSION, "primitives": self.count}},
            },
            "scene": 0,
            "scenes": [{"name": "primitives"} | ({"nodes": self.roots} if self.roots else {})],
        }
        # glTF has no empty arrays: what is not there is left out.
        document |= {name: part for name, part in parts.items() if part}
        if self.shapes:
            document["extensions"] = {"KHR_implicit_shapes": {"shapes": self.shapes}}
        return document

    def add(self, primitives: PrimitiveSet, i: int, half_space_size: float) -> None:
        """Add primitive i: its collider node and the child that shows it."""
        kind = kind_name(primitives, i)
        own_name = primitives.names[i] if primitives.names else ""
        name = own_name or node_name(kind, i)
        size = primitives.sizes[i]
        shown = np.array([half_space_size, 1.0, half_space_size]) if kind == HALF_SPACE else size
        self.count += 1
        mover = primitives.nodes[i] if primitives.nodes else -1
        siblings = self.roots if mover < 0 else self._children_of(mover)
        siblings.append(len(self.nodes))
        self.shapes.append(_shape(kind, size))
        self.nodes.append(
            {
                "name": name,
                "translation": primitives.positions[i].tolist(),
                "rotation": primitives.rotations[i].tolist(),
                "children": [len(self.nodes) + 1],
                "extensions": {
                    "KHR_physics_rigid_bodies": {"collider": {"geometry": {"shape": len(self.shapes) - 1}}}
                },
                "extras": {"sdfprim": _facts(primitives, i, kind, own_name)},
            }
        )
        mesh = self._mesh(kind, primitives.albedo[i], primitives.emission[i])
        self.nodes.append({"name": f"{name} mesh", "mesh": mesh, "scale": shown.tolist()})

    def _children_of(self, mover: int) -> list[int]:
        """The children of the node that stands for the scene's node `mover`; it has no transform."""
        key = ("mover", mover)
        if key not in self._known:
            self._known[key] = len(self.nodes)
            self.roots.append(len(self.nodes))
            self.nodes.append({"name": f"{NODE_PREFIX}{mover:04d}", "children": []})
        children: list[int] = self.nodes[self._known[key]]["children"]
        return children

    def _mesh(self, kind: str, albedo: NDArray[np.float32], emission: NDArray[np.float32]) -> int:
        """The unit mesh of a kind, split where neighbouring faces differ in colour."""
        unit = UNIT_MESHES[kind]
        parts: list[dict[str, Any]] = []
        for first, last in _equal_runs(unit, np.concatenate([albedo, emission], axis=1)):
            attributes = {
                "POSITION": self._accessor((unit.name, "positions"), unit.positions, bounds=True),
                "NORMAL": self._accessor((unit.name, "normals"), unit.normals),
            }
            start, end = unit.starts[first], unit.starts[last + 1]
            parts.append(
                {
                    "attributes": attributes,
                    "indices": self._accessor((unit.name, start, end), unit.triangles[start:end].ravel()),
                    "material": self._material(albedo[first], emission[first]),
                    "mode": 4,
                }
            )
        key = ("mesh", kind, tuple((p["indices"], p["material"]) for p in parts))
        if key not in self._known:
            self._known[key] = len(self.meshes)
            self.meshes.append({"name": f"{MESH_PREFIX}{kind}_{len(self.meshes):04d}", "primitives": parts})
        return self._known[key]

    def _material(self, albedo: NDArray[np.float32], emission: NDArray[np.float32]) -> int:
        """A diffuse material. The emissive strength is a power of two, so that the product is exact."""
        key = ("material", albedo.tobytes(), emission.tobytes())
        if key not in self._known:
            self._known[key] = len(self.materials)
            strength = max(1.0, 2.0 ** float(np.frexp(emission.max())[1]))
            material: dict[str, Any] = {
                "name": f"color_{len(self.materials):04d}",
                "pbrMetallicRoughness": {
                    "baseColorFactor": [*albedo.astype(float).tolist(), 1.0],
                    "metallicFactor": 0.0,
                    "roughnessFactor": 1.0,
                },
                "emissiveFactor": (emission.astype(float) / strength).tolist(),
            }
            if strength > 1:
                material["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
            self.materials.append(material)
        return self._known[key]

    def _accessor(self, key: Hashable, values: NDArray[Any], bounds: bool = False) -> int:
        key = ("accessor", key)
        if key in self._known:
            return self._known[key]
        indices = values.ndim == 1
        self.binary += b"\0" * (-len(self.binary) % 4)
        content = values.astype(values.dtype.newbyteorder("<")).tobytes()
        self.views.append(
            {
                "buffer": 0,
                "byteOffset": len(self.binary),
                "byteLength": len(content),
                "target": _ELEMENT_ARRAY_BUFFER if indices else _ARRAY_BUFFER,
            }
        )
        self.binary += content
        self._known[key] = len(self.accessors)
        self.accessors.append(
            {
                "bufferView": len(self.views) - 1,
                "componentType": _UNSIGNED_SHORT if indices else _FLOAT,
                "count": len(values),
                "type": "SCALAR" if indices else "VEC3",
            }
        )
        if bounds:
            self.accessors[-1] |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        return self._known[key]


def _shape(kind: str, size: NDArray[np.float64]) -> dict[str, Any]:
    """The KHR_implicit_shapes shape: every number is written, whatever its default."""
    x, y, z = size.tolist()
    numbers: dict[str, dict[str, Any]] = {
        "box": {"size": [x, y, z]},
        "sphere": {"radius": x / 2},
        "cylinder": {"height": y, "radiusBottom": x / 2, "radiusTop": x / 2},
        "plane": {"sizeX": x, "sizeZ": z, "doubleSided": True},
        HALF_SPACE: {"doubleSided": False},
    }
    shape = "plane" if kind == HALF_SPACE else kind
    return {"type": shape, shape: numbers[kind]}


def _facts(primitives: PrimitiveSet, i: int, kind: str, name: str) -> dict[str, Any]:
    facts: dict[str, Any] = {"version": VERSION, "kind": kind, "name": name}
    if kind == "plane":
        facts["thickness"] = float(primitives.sizes[i, 1])
    facts["albedo"] = primitives.albedo[i].astype(float).tolist()
    facts["emission"] = primitives.emission[i].astype(float).tolist()
    return facts


def _equal_runs(unit: UnitMesh, colors: NDArray[np.float32]) -> list[tuple[int, int]]:
    """First and last face of each run of equally coloured faces (6, k) that have triangles."""
    starts = unit.starts
    runs: list[tuple[int, int]] = []
    for face in range(6):
        if starts[face] == starts[face + 1]:
            continue
        if runs and np.array_equal(colors[face], colors[runs[-1][0]]):
            runs[-1] = (runs[-1][0], face)
        else:
            runs.append((face, face))
    return runs
