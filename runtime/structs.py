"""Structs that Python and WGSL share: one annotated class gives the NumPy dtype and the WGSL text.

    class Frame(GpuStruct):
        clip_from_local: mat4x4f
        camera: vec3f
        frame_index: u32
        planes: Annotated[vec4f, 6]          # array<vec4f, 6>

    Frame.dtype                              # offsets by the rules of WGSL, padding included
    Frame.wgsl()                             # the text of the struct
    Frame.pack(clip_from_local=matrix, ...)  # one record, ready for Buffer.write

Offsets, sizes and alignments follow WGSL 14.4.1 ("Alignment and Size"). Matrices are given the way NumPy
users write them, row by row (`matrix @ column_vector`); packing turns them to WGSL's column order.

`runtime/layouts.py` lists every struct of the product; `python -m runtime.structs` writes them to
`shaders/structs.wgsl`.
"""

from __future__ import annotations

import os
import sys
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

STRUCTS_FILE = Path(__file__).parent / "shaders" / "structs.wgsl"
VECTOR_ALIGNMENTS = {1: 4, 2: 8, 3: 16, 4: 16}
RESERVED_NAMES = ("dtype", "layout", "pack", "pack_array", "wgsl")


@dataclass(frozen=True)
class Layout:
    """How WGSL lays a type out: `align` and `size` in bytes. `shape`: of the value that `pack` takes."""

    name: str
    align: int
    size: int
    dtype: np.dtype
    shape: tuple[int, ...] = ()
    fields: tuple[Field, ...] = ()

    @property
    def stride(self) -> int:
        """Bytes from one array element to the next."""
        return _round_up(self.size, self.align)


class GpuType:
    """A WGSL scalar, vector or matrix."""

    layout: ClassVar[Layout]

    def __init_subclass__(cls, code: str, shape: tuple[int, ...] = (), name: str | None = None) -> None:
        align = VECTOR_ALIGNMENTS[shape[-1] if shape else 1]
        held = (shape[0], align // 4) if len(shape) == 2 else shape  # a matrix is padded column by column
        dtype = np.dtype((code, held))
        cls.layout = Layout(name or cls.__name__, align, dtype.itemsize, dtype, shape)


class f32(GpuType, code="<f4"): ...


class u32(GpuType, code="<u4"): ...


class i32(GpuType, code="<i4"): ...


class atomic_u32(GpuType, code="<u4", name="atomic<u32>"): ...


class vec2f(GpuType, code="<f4", shape=(2,)): ...


class vec3f(GpuType, code="<f4", shape=(3,)): ...


class vec4f(GpuType, code="<f4", shape=(4,)): ...


class vec2u(GpuType, code="<u4", shape=(2,)): ...


class vec3u(GpuType, code="<u4", shape=(3,)): ...


class vec4u(GpuType, code="<u4", shape=(4,)): ...


class vec2i(GpuType, code="<i4", shape=(2,)): ...


class vec3i(GpuType, code="<i4", shape=(3,)): ...


class vec4i(GpuType, code="<i4", shape=(4,)): ...


class mat3x3f(GpuType, code="<f4", shape=(3, 3)): ...


class mat4x4f(GpuType, code="<f4", shape=(4, 4)): ...


@dataclass(frozen=True)
class Field:
    """One member of a struct; `count` is None unless it is an array."""

    name: str
    type: type[GpuType] | type[GpuStruct]
    count: int | None
    offset: int

    @property
    def size(self) -> int:
        return self.type.layout.size if self.count is None else self.type.layout.stride * self.count

    @property
    def wgsl_type(self) -> str:
        name = self.type.layout.name
        return name if self.count is None else f"array<{name}, {self.count}>"

    @property
    def is_padded_array(self) -> bool:
        """Whether WGSL puts padding between the elements (array<vec3f, n>)."""
        return self.count is not None and self.type.layout.stride != self.type.layout.size

    @property
    def dtype(self) -> np.dtype:
        """Of the field inside the record; a padded array's elements have one field, `value`."""
        element = self.type.layout.dtype
        if self.is_padded_array:
            element = np.dtype(
                {"names": ["value"], "formats": [element], "itemsize": self.type.layout.stride}
            )
        return element if self.count is None else np.dtype((element, (self.count,)))


class GpuStruct:
    """Base of the structs that Python and WGSL share. Subclasses only annotate their members."""

    layout: ClassVar[Layout]
    dtype: ClassVar[np.dtype]

    def __init_subclass__(cls) -> None:
        cls.layout = _lay_out(cls)
        cls.dtype = cls.layout.dtype

    @classmethod
    def wgsl(cls) -> str:
        """The struct as WGSL text, each member with its byte offset."""
        members = [f"    {field.name}: {field.wgsl_type}," for field in cls.layout.fields]
        width = max(len(member) for member in members)
        lines = [
            f"{member:<{width}}  // {field.offset}"
            for member, field in zip(members, cls.layout.fields, strict=True)
        ]
        return "\n".join([f"struct {cls.layout.name} {{  // {cls.layout.size} bytes", *lines, "}"])

    @classmethod
    def pack(cls, **values: Any) -> np.ndarray:
        """One record: an array of shape () and type `dtype`.

        Every member is named. A matrix is (3, 3) or (4, 4), row by row; an array has its count as first
        axis; a nested struct is a record or a dict of its members, an array of them is records. TypeError
        says what is amiss.
        """
        return cls.pack_array(1, **{name: _one_row(value) for name, value in values.items()}).reshape(())

    @classmethod
    def pack_array(cls, count: int, /, **columns: Any) -> np.ndarray:
        """(count,) records from one column for each member, each of `count` rows, or of one row for all."""
        names = [field.name for field in cls.layout.fields]
        missing = [f"missing {name}" for name in names if name not in columns]
        unknown = [f"unknown {name}" for name in columns if name not in names]
        if missing or unknown:
            faults = "; ".join(missing + unknown)
            raise TypeError(f"{cls.__name__}: {faults}; its members are {', '.join(names)}")
        records = np.zeros(count, cls.dtype)
        for field in cls.layout.fields:
            target = records[field.name]
            _store(target["value"] if field.is_padded_array else target, field, columns[field.name], cls)
        return records


def _lay_out(cls: type[GpuStruct]) -> Layout:
    fields: list[Field] = []
    end = 0
    for name, hint in _hints(cls).items():
        where = f"{cls.__name__}.{name}"
        is_array = hasattr(hint, "__metadata__")
        element, count = (hint.__origin__, hint.__metadata__[0]) if is_array else (hint, None)
        if name in RESERVED_NAMES:
            raise TypeError(f"{where}: GpuStruct has an attribute of that name; choose another")
        if not (isinstance(element, type) and issubclass(element, GpuType | GpuStruct)):
            raise TypeError(f"{where}: {element!r} is no GPU type")
        if is_array and not (isinstance(count, int) and count > 0):
            raise TypeError(f"{where}: an array needs a positive count, not {count!r}")
        field = Field(name, element, count, _round_up(end, element.layout.align))
        fields.append(field)
        end = field.offset + field.size
    if not fields:
        raise TypeError(f"{cls.__name__} has no members")
    align = max(field.type.layout.align for field in fields)
    size = _round_up(end, align)
    record = np.dtype(
        {
            "names": [field.name for field in fields],
            "formats": [field.dtype for field in fields],
            "offsets": [field.offset for field in fields],
            "itemsize": size,
        }
    )
    return Layout(cls.__name__, align, size, record, fields=tuple(fields))


def _hints(cls: type) -> Mapping[str, Any]:
    """The class's own annotations, evaluated where it was written."""
    own = type(cls.__name__, (), {"__annotations__": cls.__annotations__, "__module__": cls.__module__})
    return typing.get_type_hints(own, vars(sys.modules[cls.__module__]), include_extras=True)


def _one_row(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _one_row(part) for name, part in value.items()}
    return np.asarray(value)[None]


def _store(target: np.ndarray, field: Field, column: Any, owner: type[GpuStruct]) -> None:
    """Writes a column into the records' member."""
    where = f"{owner.__name__}.{field.name}"
    rows = target.shape[:1] if field.count is None else (target.shape[0], field.count)
    if issubclass(field.type, GpuStruct):
        if isinstance(column, Mapping) and field.count is None:
            column = field.type.pack_array(rows[0], **column)
        values = np.asarray(column)
        if values.dtype != field.type.dtype:
            raise TypeError(f"{where} takes records of {field.type.__name__}")
        target[...] = values
        return
    values = np.asarray(column)
    if target.dtype.kind in "ui" and values.dtype.kind not in "uib":
        raise TypeError(f"{where} holds integers, not {values.dtype}")
    shape = rows[1:] + field.type.layout.shape
    if values.shape[1:] != shape or values.shape[:1] not in (rows[:1], (1,)):
        raise TypeError(f"{where} takes shape {shape}, not {values.shape[1:]}")
    if len(field.type.layout.shape) == 2:
        target[..., : shape[-1]] = values.swapaxes(-1, -2)
    else:
        target[...] = values


def _round_up(value: int, multiple: int) -> int:
    return -(-value // multiple) * multiple


def generate(structs: Iterable[type[GpuStruct]]) -> str:
    """The text of `shaders/structs.wgsl`.

    Raises TypeError when two structs share a name, or one contains another that is not listed before it.
    """
    listed: list[str] = []
    texts = [
        "// Generated from runtime/layouts.py by `python -m runtime.structs`: edit the classes instead.\n"
    ]
    for struct in structs:
        for field in struct.layout.fields:
            if issubclass(field.type, GpuStruct) and field.type.__name__ not in listed:
                raise TypeError(f"{struct.__name__}.{field.name}: list {field.type.__name__} before it")
        if struct.__name__ in listed:
            raise TypeError(f"two structs are named {struct.__name__}")
        listed.append(struct.__name__)
        texts.append(struct.wgsl() + "\n")
    return "\n".join(texts)


def write(structs: Iterable[type[GpuStruct]], path: Path = STRUCTS_FILE) -> None:
    """Writes `generate(structs)` to `path`, in one step."""
    beside = path.with_suffix(".tmp")
    beside.write_text(generate(structs), encoding="utf-8", newline="\n")
    os.replace(beside, path)


if __name__ == "__main__":
    # Run as a script this module is a second copy of itself: its names are taken from the first.
    from runtime import layouts, structs

    structs.write(layouts.STRUCTS)
