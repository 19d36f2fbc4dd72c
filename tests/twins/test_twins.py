"""Every function of shaders/lib and its NumPy twin in runtime/twins: the same name, the same arguments, the
same result on the same random inputs.

A new twin needs no line here: modules and functions are found by their names. What inputs a function takes
is told by the name of its parameter in `DOMAINS`, or for one function alone under "function.parameter".
"""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import runtime.twins
from fit.encoding import encode_rotation
from runtime import layouts
from runtime.encoder import Recorder
from runtime.kernel import Kernel
from runtime.resources import Buffer
from runtime.sky import Sky, SkyMap
from runtime.wgsl import SHADERS

ROWS = 512

PLAIN = {
    "f32": (np.float32, 1),
    "u32": (np.uint32, 1),
    "vec2f": (np.float32, 2),
    "vec3f": (np.float32, 3),
    "vec4f": (np.float32, 4),
    "vec2u": (np.uint32, 2),
    "vec3u": (np.uint32, 3),
    "vec4u": (np.uint32, 4),
}
RECORDS = {record.__name__: record for record in layouts.STRUCTS}


@dataclass(frozen=True)
class Function:
    module: str
    name: str
    parameters: tuple[tuple[str, str], ...]
    result: str

    @property
    def twin(self) -> Callable[..., Any] | None:
        return getattr(importlib.import_module(f"runtime.twins.{self.module}"), self.name, None)


def functions_of(module: str) -> list[Function]:
    text = re.sub(r"//[^\n]*", "", (SHADERS / "lib" / f"{module}.wgsl").read_text())
    found = []
    for match in re.finditer(r"\bfn\s+(\w+)\s*\(([^)]*)\)\s*->\s*(\w+)", text):
        pairs = [part.split(":") for part in match[2].split(",") if part.strip()]
        parameters = tuple((name.strip(), type_.strip()) for name, type_ in pairs)
        found.append(Function(module, match[1], parameters, match[3]))
    return found


def struct_fields(module: str, name: str) -> list[tuple[str, str]]:
    text = re.sub(r"//[^\n]*", "", (SHADERS / "lib" / f"{module}.wgsl").read_text())
    body = re.search(rf"struct\s+{name}\s*\{{([^}}]*)\}}", text)
    assert body is not None, f"lib/{module}.wgsl has no struct {name}"
    return [(a.strip(), b.strip()) for a, b in (m.split(":") for m in body[1].split(",") if m.strip())]


NOT_LIBRARIES = {"__init__", "reference"}
MODULES = sorted(
    p.stem for p in Path(runtime.twins.__file__).parent.glob("*.py") if p.stem not in NOT_LIBRARIES
)

BOUND = {"candidates", "clear", "march", "frame", "light_list", "lights", "emitters", "sight"}
"""Modules of bound resources, of functions that ask them, and of what they return; tests/gi/test_tracer.py,
tests/gi/test_emitters.py and tests/runtime hold them to their references.
"""

FUNCTIONS = [
    f for m in MODULES if m not in BOUND and (SHADERS / "lib" / f"{m}.wgsl").exists() for f in functions_of(m)
]

UNTWINNED = {"sky_texel_blend", "sky_radiance", "sky_radiance_within"}
"""Functions of twinned modules that read a texture; tests/runtime checks them."""


# -------------------------------------------------------------------------------- random inputs


def unit(rng: np.random.Generator, width: int) -> np.ndarray:
    v = rng.normal(size=(ROWS, width))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def uniform(low: float, high: float) -> Callable[[np.random.Generator, int], np.ndarray]:
    return lambda rng, width: rng.uniform(low, high, (ROWS, width))


def log_uniform(low: float, high: float) -> Callable[[np.random.Generator, int], np.ndarray]:
    return lambda rng, width: np.exp(rng.uniform(np.log(low), np.log(high), (ROWS, width)))


def integers(low: int, high: int) -> Callable[[np.random.Generator, int], np.ndarray]:
    return lambda rng, width: rng.integers(low, high, (ROWS, width))


def even_sizes(rng: np.random.Generator, width: int) -> np.ndarray:
    return 2 * rng.integers(4, 9, (ROWS, width))


def halves(rng: np.random.Generator, width: int) -> np.ndarray:
    half = np.exp(rng.uniform(np.log(0.05), np.log(2), (ROWS, width)))
    half[::5] = (-1, 0, -1)
    return half


def float_bits(rng: np.random.Generator, width: int) -> np.ndarray:
    return rng.uniform(-9, 9, (ROWS, width)).astype(np.float32).view(np.uint32)


def two_floats_two_words(rng: np.random.Generator, width: int) -> np.ndarray:
    """The second quarter of a record: half extents, then a rotation as the packer writes it."""
    words = encode_rotation(unit(rng, 4), rng.integers(0, 4, ROWS))
    return np.concatenate([float_bits(rng, 2), words], axis=1)


DOMAINS: dict[str, Callable[[np.random.Generator, int], np.ndarray]] = {
    "direction": unit,
    "normal": unit,
    "axis": unit,
    "q": unit,
    "rotation": unit,
    "half": log_uniform(0.05, 2),
    "radius": log_uniform(0.05, 2),
    "half_height": log_uniform(0.05, 2),
    "p": uniform(-3, 3),
    "u": uniform(0, 1),
    "square": uniform(-1, 1),
    "albedo": uniform(0, 1),
    "irradiance": uniform(0, 10),
    "solid_angle": log_uniform(1e-5, 10),
    "texel": integers(0, 8),
    "oct_tile_source.texel": integers(0, 10),
    **{
        f"{name}.size": even_sizes
        for name in ("oct_texel_direction", "oct_tile_source", "oct_tile_corner", "oct_tile_position")
    },
    "index": integers(0, 4096),
    "columns": integers(1, 700),
    "count": integers(4096, 5000),
    "corner": integers(0, 4000),
    "kind": integers(0, 4),
    "Shape.half": halves,
    "Shape.kind": lambda rng, width: np.where(np.arange(ROWS) % 5 == 0, 3, rng.integers(0, 4, ROWS))[:, None],
    "first": float_bits,
    "second": two_floats_two_words,
    "words": lambda rng, width: encode_rotation(unit(rng, 4), rng.integers(0, 4, ROWS)),
    "Light.kind": integers(0, 3),
    "orthographic": integers(0, 2),
    "curve": integers(0, 3),
    "rgb": uniform(0, 4),
    "srgb": uniform(0, 1),
    "exposure": uniform(-3, 3),
    "size": uniform(16, 2000),
    "range": uniform(-1, 8),
    "distance": uniform(0.05, 10),
    "depth": uniform(0.05, 1),
    "method": integers(0, 4),
    "slope": uniform(-1, 0.5),
    "measured": uniform(-1.1, 1.1),
    "tile_size": uniform(16, 2000),
    "from_share": uniform(0, 1),
    "to_share": uniform(0, 1),
    "jitter": uniform(0, 1),
}

TOLERANCE: dict[str, float] = {
    "oct_tile_position": 2e-3,  # texels, in atlases of 4000
    "spherical_fibonacci": 2e-3,  # the angle of point 4000 has lost 12 bits of float32
    "decode_rotation": 1e-6,
    "quat_rotate": 2e-6,
}
"""Largest relative difference, where it is not 2e-5 (of the larger of the value and 1)."""


def draw(function: Function, name: str, type_: str, rng: np.random.Generator, owner: str = "") -> np.ndarray:
    dtype, width = PLAIN[type_]
    keys = (f"{function.name}.{name}", f"{owner}.{name}", name)
    domain = next((DOMAINS[key] for key in keys if key in DOMAINS), None)
    if domain is not None:
        values = np.asarray(domain(rng, width)).astype(dtype)
    elif dtype is np.uint32:
        values = rng.integers(0, 2**32, (ROWS, width), dtype=np.uint32)
    else:
        values = rng.uniform(-2, 2, (ROWS, width)).astype(dtype)
    return values[:, 0] if width == 1 else values


# -------------------------------------------------------------------------------- the two sides


def kernel_text(function: Function, inputs: list[tuple[str, str]], call: str) -> str:
    """A kernel that calls the function once a row; input i is the buffer `in_i`, output field k is
    `out_k`.
    """
    outputs = struct_outputs(function)
    structs = {t for _, t in inputs if t in RECORDS}
    local = {t for _, t in function.parameters if t not in PLAIN and t not in RECORDS}
    local |= {function.result} - set(PLAIN) - {"bool"}
    lines = [f"import package::lib::{function.module}::{{{', '.join([function.name, *sorted(local)])}}};"]
    lines += [f"import package::structs::{{{name}}};" for name in sorted(structs)]
    for i, (_, type_) in enumerate(inputs):
        lines.append(f"@group(0) @binding({i}) var<storage, read> in_{i}: array<{type_}>;")
    for k, (_, type_) in enumerate(outputs):
        stored = "u32" if type_ == "bool" else type_
        lines.append(
            f"@group(0) @binding({len(inputs) + k}) var<storage, read_write> out_{k}: array<{stored}>;"
        )
    lines += [
        "@compute @workgroup_size(64)",
        "fn main(@builtin(global_invocation_id) id: vec3u) {",
        "    let i = id.x;",
        f"    let result = {call};",
    ]
    for k, (field, type_) in enumerate(outputs):
        value = f"result.{field}" if field else "result"
        lines.append(f"    out_{k}[i] = {f'select(0u, 1u, {value})' if type_ == 'bool' else value};")
    return "\n".join([*lines, "}"])


def struct_outputs(function: Function) -> list[tuple[str, str]]:
    if function.result in PLAIN or function.result == "bool":
        return [("", function.result)]
    return struct_fields(function.module, function.result)


def padded(values: np.ndarray) -> np.ndarray:
    """vec3 has a stride of four numbers."""
    if values.ndim == 2 and values.shape[1] == 3:
        return np.concatenate([values, np.zeros((len(values), 1), values.dtype)], axis=1)
    return values


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda f: f"{f.module}.{f.name}")
def test_gpu_and_twin_agree(function: Function, gpu: Any, tmp_path: Path) -> None:
    twin = function.twin
    if function.name in UNTWINNED:
        pytest.skip("reads a texture: tests/runtime checks it")
    assert twin is not None, f"runtime/twins/{function.module}.py has no {function.name}"
    names = [name for name, _ in function.parameters]
    assert list(inspect.signature(twin).parameters)[: len(names)] == names
    rng = np.random.default_rng(sum(function.name.encode()))
    inputs: list[tuple[str, str]] = []
    columns: list[np.ndarray] = []
    arguments: list[Any] = []
    call = []
    for name, type_ in function.parameters:
        first = len(inputs)
        if type_ in PLAIN:
            columns.append(draw(function, name, type_, rng))
            arguments.append(as_float64(columns[-1]))
            inputs.append((name, type_))
            call.append(f"in_{first}[i]")
        elif type_ in RECORDS:
            records = draw_records(function, type_, rng)
            columns.append(records)
            arguments.append(records)
            inputs.append((name, type_))
            call.append(f"in_{first}[i]")
        else:
            members = struct_fields(function.module, type_)
            drawn = {field: draw(function, field, t, rng, type_) for field, t in members}
            columns += drawn.values()
            inputs += members
            shape = getattr(importlib.import_module(f"runtime.twins.{function.module}"), type_)
            arguments.append(shape(**{field: as_float64(v) for field, v in drawn.items()}))
            call.append(f"{type_}({', '.join(f'in_{first + k}[i]' for k in range(len(members)))})")
    gpu_results = run_on_gpu(gpu, function, inputs, columns, f"{function.name}({', '.join(call)})", tmp_path)
    expected = row_by_row(twin, arguments) if takes_scalars(function) else twin(*arguments)
    parts = [getattr(expected, f.name) for f in fields(expected)] if is_dataclass(expected) else [expected]
    assert len(parts) == len(gpu_results)
    for got, want in zip(gpu_results, parts, strict=True):
        check(function, got, np.asarray(want))


def takes_scalars(function: Function) -> bool:
    """Twins that choose by an integer take one row at a time."""
    return function.name == "color_tone"


def row_by_row(twin: Callable[..., Any], arguments: list[Any]) -> np.ndarray:
    return np.array([twin(*(column[i] for column in arguments)) for i in range(ROWS)])


def as_float64(values: np.ndarray) -> np.ndarray:
    return values.astype(np.float64) if values.dtype == np.float32 else values


def draw_records(function: Function, name: str, rng: np.random.Generator) -> np.ndarray:
    """Random records of a shared struct; matrices are not drawn."""
    record = RECORDS[name]
    values = np.zeros(ROWS, record.dtype)
    for field in record.dtype.names or ():
        base, shape = record.dtype[field].subdtype or (record.dtype[field], ())
        if len(shape) < 2:
            kind = "f" if base.kind == "f" else "u"
            type_ = f"vec{shape[0]}{kind}" if shape else {"f": "f32", "u": "u32"}[kind]
            values[field] = draw(function, field, type_, rng, name)
    return values


def run_on_gpu(
    gpu: Any, function: Function, inputs: list, columns: list[np.ndarray], call: str, root: Path
) -> list[np.ndarray]:
    for name in ("lib", "world", "structs.wgsl"):
        (root / name).symlink_to(SHADERS / name)
    (root / "twin.wgsl").write_text(kernel_text(function, inputs, call))
    kernel = Kernel(gpu, "twin", root=root)
    buffers = {f"in_{i}": Buffer(gpu, padded(column), label=f"in_{i}") for i, column in enumerate(columns)}
    outputs = struct_outputs(function)
    results = {f"out_{k}": Buffer(gpu, 16 * ROWS, label=f"out_{k}") for k in range(len(outputs))}
    rec = Recorder(gpu, label="twin")
    with rec.compute("twin") as compute_pass:
        kernel.dispatch(compute_pass, ROWS // 64, SkyMap(gpu, Sky()).bindings(), **buffers, **results)
    rec.submit()
    values = []
    for k, (_, type_) in enumerate(outputs):
        dtype, width = (np.uint32, 1) if type_ == "bool" else PLAIN[type_]
        stride = 4 if width == 3 else width
        rows = results[f"out_{k}"].read(dtype, (ROWS, stride))[:, :width]
        values.append(rows[:, 0] if width == 1 else rows)
    return values


def check(function: Function, got: np.ndarray, want: np.ndarray) -> None:
    assert got.shape == want.shape
    if got.dtype == np.uint32 and function.name == "normal_pack":
        low, high = ((got >> s & 0xFFFF).astype(np.int64) - (want >> s & 0xFFFF) for s in (0, 16))
        steps = np.minimum(np.abs(np.stack([low, high])), 65536 - np.abs(np.stack([low, high])))
        assert steps.max() <= 1  # a rounding that fell the other way
        return
    if got.dtype == np.uint32:
        np.testing.assert_array_equal(got, want.astype(np.uint32))
        return
    assert np.all(np.isfinite(got))
    tolerance = TOLERANCE.get(function.name, 2e-5)
    error = np.abs(got - want) / np.maximum(np.abs(want), 1)
    assert error.max() <= tolerance, (
        f"{function.name}: {error.max():.2e} at row {np.unravel_index(error.argmax(), error.shape)}"
    )


def test_every_library_function_has_a_twin() -> None:
    libraries = {path.stem for path in (SHADERS / "lib").glob("*.wgsl")}
    assert libraries - BOUND <= set(MODULES), f"no twin module for {libraries - BOUND - set(MODULES)}"
    missing = [f"{f.module}.{f.name}" for f in FUNCTIONS if f.twin is None and f.name not in UNTWINNED]
    assert not missing
