"""Accessors: component types, shapes, normalisation, strides, sparse values, and what must be refused."""

from __future__ import annotations

import numpy as np
import pytest

from fit.gltf import GltfError, load
from fit.gltf.accessors import Accessors
from fit.gltf.container import read_document
from fit.gltf.resources import Resources


@pytest.fixture
def read_accessor(tmp_path):
    """One accessor of a builder's document, read directly."""

    def read(builder, index, *types):
        document = read_document(builder.write(tmp_path / "accessor.glb"))
        return Accessors(document, Resources(document)).floats(index, *types)

    return read


@pytest.mark.parametrize("dtype", ["i1", "u1", "<i2", "<u2", "<u4", "<f4"])
@pytest.mark.parametrize("width", [1, 2, 3, 4])
def test_component_types_and_vectors(builder, read_accessor, dtype, width):
    values = np.arange(5 * width, dtype=dtype).reshape(5, width)
    stored = builder.accessor(values if width > 1 else values[:, 0])
    read = read_accessor(builder, stored)
    assert read.dtype == np.float64
    assert np.array_equal(read.reshape(5, width), values)


@pytest.mark.parametrize(
    ("stored", "expected"),
    [
        (np.array([-128, -127, 0, 127], "i1"), [-1, -1, 0, 1]),
        (np.array([0, 51, 255], "u1"), [0, 0.2, 1]),
        (np.array([-32768, -32767, 16384, 32767], "<i2"), [-1, -1, 16384 / 32767, 1]),
        (np.array([0, 13107, 65535], "<u2"), [0, 0.2, 1]),
        (np.array([0.25, -3], "<f4"), [0.25, -3]),
    ],
)
def test_normalized(builder, read_accessor, stored, expected):
    assert np.allclose(
        read_accessor(builder, builder.accessor(stored, normalized=True)), expected, atol=1e-12
    )


def test_normalized_32_bit_integers_are_refused(builder, read_accessor):
    stored = builder.accessor(np.array([1, 2], "<u4"), normalized=True)
    with pytest.raises(GltfError, match=r"accessors\[0\]\.normalized: 32-bit integers"):
        read_accessor(builder, stored)


@pytest.mark.parametrize(
    ("kind", "dtype", "column_bytes"),
    [
        ("MAT2", "u1", 4),
        ("MAT2", "<u2", 4),
        ("MAT2", "<f4", 8),
        ("MAT3", "i1", 4),
        ("MAT3", "<i2", 8),
        ("MAT3", "<f4", 12),
        ("MAT4", "u1", 4),
        ("MAT4", "<f4", 16),
    ],
)
def test_matrix_columns_start_at_multiples_of_four_bytes(builder, read_accessor, kind, dtype, column_bytes):
    size = int(kind[-1])
    matrices = np.arange(2 * size * size).reshape(2, size, size)
    data = b""
    for matrix in matrices:
        for column in matrix.T:
            data += column.astype(dtype).tobytes().ljust(column_bytes, b"\xff")
    names = {"i1": 5120, "u1": 5121, "<i2": 5122, "<u2": 5123, "<f4": 5126}
    stored = builder.add(
        "accessors", bufferView=builder.view(data), componentType=names[dtype], count=2, type=kind
    )
    assert np.array_equal(read_accessor(builder, stored), matrices)


def test_interleaved_and_offset(builder, read_accessor):
    vertices = np.zeros(4, np.dtype([("position", "<f4", 3), ("texcoord", "<u2", 2)]))
    vertices["position"] = np.arange(12).reshape(4, 3)
    vertices["texcoord"] = np.arange(8).reshape(4, 2) * 1000
    view = builder.view(vertices.tobytes(), byteStride=16)
    positions = builder.add("accessors", bufferView=view, componentType=5126, count=4, type="VEC3")
    texcoords = builder.add(
        "accessors", bufferView=view, byteOffset=12, componentType=5123, count=4, type="VEC2"
    )
    assert np.array_equal(read_accessor(builder, positions), vertices["position"])
    assert np.array_equal(read_accessor(builder, texcoords), vertices["texcoord"])


def test_no_buffer_view_means_zeros(builder, read_accessor):
    stored = builder.add("accessors", componentType=5126, count=3, type="VEC3")
    assert np.array_equal(read_accessor(builder, stored), np.zeros((3, 3)))


@pytest.mark.parametrize("index_type", ["u1", "<u2", "<u4"])
@pytest.mark.parametrize("with_base", [True, False])
def test_sparse(builder, read_accessor, index_type, with_base):
    base = np.arange(12, dtype="<f4").reshape(4, 3) if with_base else np.zeros((4, 3), "<f4")
    sparse = {
        "count": 2,
        "indices": {
            "bufferView": builder.view(np.array([1, 3], index_type).tobytes()),
            "componentType": {"u1": 5121, "<u2": 5123, "<u4": 5125}[index_type],
        },
        "values": {"bufferView": builder.view(np.full((2, 3), -7, "<f4").tobytes())},
    }
    if with_base:
        stored = builder.accessor(base, sparse=sparse)
    else:
        stored = builder.add("accessors", componentType=5126, count=4, type="VEC3", sparse=sparse)
    base[[1, 3]] = -7
    assert np.array_equal(read_accessor(builder, stored), base)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"count": 5}, "5 elements end at byte 60 of bufferViews"),
        ({"count": 2**40}, "elements end at byte"),
        ({"byteOffset": 4}, "4 elements end at byte 52"),
        ({"count": -1}, "-1 is out of range"),
        ({"count": 1.5}, "must be an integer"),
        ({"componentType": 5130}, "5130 is not one of 5120"),
        ({"type": "VEC5"}, "is expected"),
        ({"type": "VEC2"}, "'VEC2' where VEC3 is expected"),
        ({"bufferView": 99}, "index 99 points past the end, there are 1 bufferViews"),
        ({"sparse": {"count": 9, "indices": {}, "values": {}}}, "9 values for an accessor of 4"),
    ],
)
def test_damaged_accessors(builder, read_accessor, change, message):
    stored = builder.accessor(np.zeros((4, 3), np.float32), **change)
    with pytest.raises(GltfError, match=r"accessors\[0\]") as caught:
        read_accessor(builder, stored, "VEC3")
    assert message in str(caught.value)


def test_sparse_index_out_of_range(builder, read_accessor):
    sparse = {
        "count": 1,
        "indices": {"bufferView": builder.view(b"\x09"), "componentType": 5121},
        "values": {"bufferView": builder.view(bytes(12))},
    }
    stored = builder.accessor(np.zeros((4, 3), np.float32), sparse=sparse)
    with pytest.raises(GltfError, match="index 9 is out of range, the accessor has 4 elements"):
        read_accessor(builder, stored)


def test_stride_smaller_than_an_element(builder, read_accessor):
    view = builder.view(bytes(48), byteStride=8)
    stored = builder.add("accessors", bufferView=view, componentType=5126, count=4, type="VEC3")
    with pytest.raises(
        GltfError, match=r"bufferViews\[0\]\.byteStride: 8 bytes are less than one element of 12"
    ):
        read_accessor(builder, stored)


def test_absurd_counts_without_data_are_refused_before_anything_is_allocated(builder, read_accessor):
    stored = builder.add("accessors", componentType=5126, count=2**50, type="MAT4")
    with pytest.raises(GltfError, match="asks for absurdly many values"):
        read_accessor(builder, stored)


def test_view_past_its_buffer(builder, tmp_path):
    node = builder.square()
    builder.document["bufferViews"][0]["byteLength"] = 10_000
    with pytest.raises(GltfError, match=r"bufferViews\[0\]: bytes 0 to 10000 run past the end of the buffer"):
        load(builder.write(tmp_path / "past.glb"))
    assert node == 0
