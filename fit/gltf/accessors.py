"""Accessors -> arrays: every component type and shape, normalised, sparse (glTF 2.0, section 3.6.2)."""

from __future__ import annotations

from collections.abc import Sized
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.gltf.container import Document
from fit.gltf.json_object import JsonObject
from fit.gltf.resources import Resources

COMPONENT_TYPES = {
    5120: np.dtype("i1"),
    5121: np.dtype("u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
}
Rows = NDArray[np.integer] | None

SPARSE_INDEX_TYPES = {key: COMPONENT_TYPES[key] for key in (5121, 5123, 5125)}
SHAPES = {
    "SCALAR": (1, 1),
    "VEC2": (1, 2),
    "VEC3": (1, 3),
    "VEC4": (1, 4),
    "MAT2": (2, 2),
    "MAT3": (3, 3),
    "MAT4": (4, 4),
}
"""Columns and rows of each accessor type; a vector is one column."""

MAX_MADE_VALUES = 1 << 27
"""Numbers that a file may ask for without storing them (no buffer view means zeros), or copied (sparse)."""


class Accessors:
    """Reads accessors of one document. Arrays come back C-contiguous, fresh for each call."""

    def __init__(self, document: Document, resources: Resources) -> None:
        self.document = document
        self.resources = resources
        self._made_values = 0
        self._made: dict[int, NDArray[Any]] = {}

    def definition(self, index: int) -> JsonObject:
        return self.document.accessors[index]

    def count(self, index: int) -> int:
        """Elements the accessor declares."""
        return self.definition(index).integer("count")

    def is_backed(self, index: int) -> bool:
        """Whether the file stores values for it (Draco attributes may come without)."""
        return "bufferView" in self.definition(index)

    def floats(self, index: int, *types: str, rows: Rows = None) -> NDArray[np.float64]:
        """Values as float64, normalised where the accessor says so.

        Args:
            types: the accessor types that fit here, "VEC3" for one.
            rows: the elements to read, all of them without.

        Returns:
            (count,) for SCALAR, (count, n) for vectors, (count, rows, columns) for matrices.

        Raises:
            GltfError: a value of the wrong type, or data that is not in the buffers.
        """
        accessor = self._checked(index, types)
        elements = self._elements(index, accessor)
        return self._shaped(accessor, normalize(elements if rows is None else elements[rows], accessor))

    def integers(self, index: int, *types: str) -> NDArray[np.int64]:
        """Values as int64, shapes as in `floats`.

        Raises:
            GltfError: as in `floats`, and for floating-point accessors.
        """
        accessor = self._checked(index, types)
        elements = self._elements(index, accessor)
        if elements.dtype.kind == "f":
            raise accessor.error("must hold integers, not floats; export the file again", "componentType")
        return self._shaped(accessor, elements.astype(np.int64))

    def _checked(self, index: int, types: tuple[str, ...]) -> JsonObject:
        accessor = self.definition(index)
        kind = accessor.string("type")
        if types and kind not in types:
            raise accessor.error(
                f"{kind!r} where {' or '.join(types)} is expected; export the file again", "type"
            )
        return accessor

    def _shaped(self, accessor: JsonObject, elements: NDArray[Any]) -> NDArray[Any]:
        columns, rows = accessor.choice("type", SHAPES)
        if columns > 1:
            return np.ascontiguousarray(elements.transpose(0, 2, 1))
        return np.ascontiguousarray(elements[:, 0, 0] if rows == 1 else elements[:, 0])

    def _elements(self, index: int, accessor: JsonObject) -> NDArray[Any]:
        """The stored values (count, columns, rows) with sparse substitution done; do not write to them."""
        if index in self._made:
            return self._made[index]
        dtype = accessor.choice("componentType", COMPONENT_TYPES)
        columns, rows = accessor.choice("type", SHAPES)
        count = accessor.integer("count")
        view = accessor.reference("bufferView", len(self.document.buffer_views), "bufferViews")
        sparse = accessor.object("sparse")
        if view is None or sparse is not None:
            self._made_values += count * columns * rows
            if self._made_values > MAX_MADE_VALUES:
                raise accessor.error("asks for absurdly many values that the file does not store", "count")
        if view is None:
            elements = np.zeros((count, columns, rows), dtype)
        else:
            elements = self._strided(accessor, view, dtype, count, columns, rows)
        if sparse is not None:
            elements = self._substitute(sparse, elements)
        if view is None or sparse is not None:
            self._made[index] = elements
        return elements

    def _strided(
        self, accessor: JsonObject, view: int, dtype: np.dtype[Any], count: int, columns: int, rows: int
    ) -> NDArray[Any]:
        """A view of the buffer's bytes; nothing is copied, and nothing past the end is touched."""
        data = self.resources.buffer_view(view)
        # Columns of a matrix start at multiples of four bytes (glTF 2.0, section 3.6.2.4).
        column_stride = rows * dtype.itemsize if columns == 1 else -(-rows * dtype.itemsize // 4) * 4
        packed = columns * column_stride
        used = (columns - 1) * column_stride + rows * dtype.itemsize
        definition = self.document.buffer_views[view]
        stride = definition.integer("byteStride", packed, minimum=1) if "byteStride" in definition else packed
        if stride < used:
            raise definition.error(f"{stride} bytes are less than one element of {used}", "byteStride")
        offset = accessor.integer("byteOffset", 0)
        end = offset + (count - 1) * stride + used if count else 0
        if end > len(data):
            what = f"{count} elements end at byte {end} of {definition.path}, which has {len(data)}"
            raise accessor.error(f"{what}; the file is damaged, export it again", "count")
        strides = (stride, column_stride, dtype.itemsize)
        return np.ndarray((count, columns, rows), dtype, data, offset, strides)

    def _substitute(self, sparse: JsonObject, base: NDArray[Any]) -> NDArray[Any]:
        count = sparse.integer("count")
        if count == 0:
            return base
        if count > len(base):
            raise sparse.error(f"{count} values for an accessor of {len(base)}", "count")
        where, values = sparse.object("indices"), sparse.object("values")
        if where is None or values is None:
            raise sparse.error("needs both indices and values")
        views = len(self.document.buffer_views)
        index_type = where.choice("componentType", SPARSE_INDEX_TYPES)
        index_view = where.required_reference("bufferView", views, "bufferViews")
        indices = self._strided(where, index_view, index_type, count, 1, 1)[:, 0, 0]
        if indices.max(initial=0) >= len(base):
            raise where.error(f"index {indices.max()} is out of range, the accessor has {len(base)} elements")
        value_view = values.required_reference("bufferView", views, "bufferViews")
        elements = base.copy()
        elements[indices] = self._strided(values, value_view, base.dtype, count, *base.shape[1:])
        return elements


def normalize(values: NDArray[Any], accessor: JsonObject) -> NDArray[np.float64]:
    """Stored values as float64, in [0, 1] or [-1, 1] where the accessor is normalised (section 3.6.2.2).

    Raises:
        GltfError: a normalised accessor of 32-bit integers, which glTF forbids.
    """
    dtype = accessor.choice("componentType", COMPONENT_TYPES)
    floats = values.astype(np.float64)
    if not accessor.boolean("normalized") or dtype.kind == "f":
        return floats
    if dtype.itemsize == 4:
        raise accessor.error("32-bit integers can't be normalised; export the file again", "normalized")
    floats /= np.iinfo(dtype).max
    return np.maximum(floats, -1.0)


def check_length(owner: JsonObject, name: str, values: Sized, expected: int) -> None:
    """Refuse the attribute `name` of `owner` if it doesn't have `expected` values.

    Raises:
        GltfError: the counts differ.
    """
    if len(values) != expected:
        what = f"has {len(values)} values where {expected} are expected; export the file again"
        raise owner.error(what, name)
