"""Primitive sets as self-contained WGSL: `map(p)`, the signed distance, and `map_material(p)`; write only.

For shader toys and other renderers: every number is a literal, nothing has to be bound. WGSL computes in
float32, so a set far from the origin should be moved there first.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fit.export.files import write_atomically
from fit.export.gltf import kind_name
from fit.export.unit_meshes import HALF_SPACE
from fit.primitives import PrimitiveSet

_LIBRARY = """
struct Material {
    albedo: vec3f,
    emission: vec3f,  // radiance, W/m2/sr
}

/// Point p in the space of a primitive at `center`, turned by the unit quaternion `rotation` (xyzw).
fn to_local(p: vec3f, center: vec3f, rotation: vec4f) -> vec3f {
    let v = p - center;
    let t = 2.0 * cross(-rotation.xyz, v);
    return v + rotation.w * t + cross(-rotation.xyz, t);
}

fn sd_box(p: vec3f, half: vec3f) -> f32 {
    let q = abs(p) - half;
    return length(max(q, vec3f(0.0))) + min(max(q.x, max(q.y, q.z)), 0.0);
}

fn sd_sphere(p: vec3f, radius: f32) -> f32 {
    return length(p) - radius;
}

fn sd_cylinder(p: vec3f, radius: f32, half_height: f32) -> f32 {
    let q = vec2f(length(p.xz) - radius, abs(p.y) - half_height);
    return length(max(q, vec2f(0.0))) + min(max(q.x, q.y), 0.0);
}

fn sd_half_space(p: vec3f) -> f32 {
    return p.y;
}

/// The face whose plane lies farthest outwards at p: 0 to 5 are +x, -x, +y, -y, +z, -z.
fn box_face(p: vec3f, half: vec3f) -> u32 {
    let q = abs(p) - half;
    if (q.x >= q.y && q.x >= q.z) {
        return select(0u, 1u, p.x < 0.0);
    }
    if (q.y >= q.z) {
        return select(2u, 3u, p.y < 0.0);
    }
    return select(4u, 5u, p.z < 0.0);
}

/// 0 is the side, 2 and 3 are the caps +y and -y.
fn cylinder_face(p: vec3f, radius: f32, half_height: f32) -> u32 {
    let cap = abs(p.y) - half_height > length(p.xz) - radius;
    return select(0u, select(2u, 3u, p.y < 0.0), cap);
}
"""


def write_wgsl(primitives: PrimitiveSet, path: Path) -> None:
    """Write the set; the same set gives the same bytes.

    Raises:
        ValueError: the set is invalid, or a number of it is beyond float32.
    """
    write_atomically(path, wgsl_source(primitives.validate()).encode())


def wgsl_source(primitives: PrimitiveSet) -> str:
    """The WGSL text of a valid set."""
    shapes = [_Shape(primitives, i) for i in range(len(primitives))]
    distances = "".join(f"    d = min(d, {s.distance('p')});\n" for s in shapes)
    nearest = "".join(s.nearest() for s in shapes)
    cases = "".join(s.case() for s in shapes)
    return (
        f"// {len(primitives)} primitives of sdfprim. Metres; colours linear Rec.709.\n{_LIBRARY}\n"
        "/// Signed distance in metres, negative inside.\n"
        f"fn map(p: vec3f) -> f32 {{\n    var d = 3.0e38;\n{distances}    return d;\n}}\n\n"
        "/// Albedo and emission of the face that is nearest to p.\n"
        "fn map_material(p: vec3f) -> Material {\n"
        "    var best = 3.0e38;\n    var index = 0u;\n    var face = 0u;\n"
        f"{nearest}    switch (index) {{\n{cases}"
        "        default: {\n            return Material(vec3f(0.0), vec3f(0.0));\n        }\n    }\n}\n"
    )


class _Shape:
    """The pieces of WGSL that stand for one primitive."""

    def __init__(self, primitives: PrimitiveSet, i: int) -> None:
        half = [_number(v / 2) for v in primitives.sizes[i]]
        self.index = i
        self.kind = kind_name(primitives, i)
        self.center = _vector(primitives.positions[i])
        self.rotation = primitives.rotations[i]
        self.size = {
            "sphere": f", {half[0]}",
            "cylinder": f", {half[0]}, {half[1]}",
            HALF_SPACE: "",
        }.get(self.kind, f", vec3f({', '.join(half)})")
        self.colors = [
            f"Material({_vector(a)}, {_vector(e)})"
            for a, e in zip(primitives.albedo[i], primitives.emission[i], strict=True)
        ]

    def local(self, point: str) -> str:
        if np.array_equal(self.rotation, (0, 0, 0, 1)):
            return f"{point} - {self.center}"
        return f"to_local({point}, {self.center}, {_vector(self.rotation)})"

    def distance(self, point: str) -> str:
        name = "sd_box" if self.kind == "plane" else f"sd_{self.kind}"
        return f"{name}({self.local(point)}{self.size})"

    def nearest(self) -> str:
        """Statements that keep this primitive and its face when it is nearer than the best so far."""
        i = self.index
        face = {
            "sphere": "0u",
            "cylinder": f"cylinder_face(q{i}{self.size})",
            HALF_SPACE: "2u",
        }.get(self.kind, f"box_face(q{i}{self.size})")
        name = "sd_box" if self.kind == "plane" else f"sd_{self.kind}"
        return (
            f"    let q{i} = {self.local('p')};\n"
            f"    let d{i} = {name}(q{i}{self.size});\n"
            f"    if (d{i} < best) {{\n"
            f"        best = d{i};\n        index = {i}u;\n        face = {face};\n    }}\n"
        )

    def case(self) -> str:
        """The arm of the switch over primitives that returns the colour of its faces."""
        head = f"        case {self.index}u: {{\n"
        if len(set(self.colors)) == 1:
            return f"{head}            return {self.colors[0]};\n        }}\n"
        arms = "".join(
            f"                {'default' if f == 5 else f'case {f}u'}: {{ return {c}; }}\n"
            for f, c in enumerate(self.colors)
        )
        return f"{head}            switch (face) {{\n{arms}            }}\n        }}\n"


def _number(value: float) -> str:
    """A float32 literal that reads back to the same number; infinities have none and are never shown."""
    with np.errstate(over="ignore", under="ignore"):
        short = np.float32(value)
    if np.isinf(short) and np.isfinite(value):
        raise ValueError(f"{value} is beyond WGSL's float32; scale the set down")
    text = str(short)
    return text if "." in text or "e" in text else f"{text}.0"


def _vector(values: Iterable[float] | NDArray[np.float32]) -> str:
    numbers = [_number(float(v)) for v in values]
    return f"vec{len(numbers)}f({', '.join(numbers)})"
