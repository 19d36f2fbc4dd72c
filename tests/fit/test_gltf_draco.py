"""KHR_draco_mesh_compression against DracoPy itself."""

from __future__ import annotations

import json
import struct
import sys

import numpy as np
import pytest

from fit.gltf import GltfError, load

DracoPy = pytest.importorskip("DracoPy")
EXTENSION = "KHR_draco_mesh_compression"
TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.uint32)


def compressed(builder, data, *, fallback=False, required=True):
    """A primitive of the tetrahedron, compressed as `data`."""
    if fallback:
        primitive = builder.primitive(positions=TETRAHEDRON * 9, indices=FACES.astype(np.uint16).ravel())
    else:
        positions = builder.add("accessors", componentType=5126, count=4, type="VEC3")
        indices = builder.add("accessors", componentType=5123, count=12, type="SCALAR")
        primitive = builder.primitive(positions=positions, indices=indices)
    draco = {"bufferView": builder.view(data), "attributes": {"POSITION": 0}}
    primitive["extensions"] = {EXTENSION: draco}
    builder.extend(EXTENSION, required=required)
    builder.node(mesh=builder.mesh(primitive))
    return draco


def corner_sets(points, faces):
    return sorted(tuple(sorted(map(tuple, np.round(points[face], 3).tolist()))) for face in faces)


def test_decoded_triangles(builder, load_built):
    compressed(builder, DracoPy.encode(TETRAHEDRON, FACES))
    (mesh,) = load_built(builder).meshes
    assert corner_sets(mesh.positions, mesh.triangles) == corner_sets(TETRAHEDRON, FACES)


def test_stored_values_are_preferred_where_draco_is_optional(builder, load_built):
    compressed(builder, b"never read", fallback=True, required=False)
    assert np.allclose(load_built(builder).bounds()[1], 9)


def test_without_dracopy_the_error_names_the_extra(builder, load_built, monkeypatch):
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    compressed(builder, DracoPy.encode(TETRAHEDRON, FACES))
    with pytest.raises(
        GltfError, match=r'needs the package DracoPy; install it with `pip install "sdfprim\[draco\]"`'
    ):
        load_built(builder)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"attributes": {"POSITION": 9}}, "the compressed data has no attribute 9"),
        ({"attributes": None}, "attributes: must be an object"),
        ({"bufferView": 9}, "index 9 points past the end"),
    ],
)
def test_damaged_extension(builder, load_built, change, message):
    compressed(builder, DracoPy.encode(TETRAHEDRON, FACES)).update(change)
    with pytest.raises(GltfError, match=rf"meshes\[0\]\.primitives\[0\]\.extensions\.{EXTENSION}") as caught:
        load_built(builder)
    assert message in str(caught.value)


def test_damaged_data(builder, load_built):
    compressed(builder, DracoPy.encode(TETRAHEDRON, FACES)[:40])
    with pytest.raises(GltfError, match="the compressed data is damaged"):
        load_built(builder)


@pytest.mark.parametrize(
    ("asset", "divisor"),
    [("Box_Draco/Box_Draco.glb", 1), ("DenseSphere_DracoQuantized/DenseSphere.glb", 32767)],
)
def test_assets_agree_with_dracopy(shared_assets, asset, divisor):
    data = (shared_assets / asset).read_bytes()
    (size,) = struct.unpack_from("<I", data, 12)
    document = json.loads(data[20 : 20 + size])
    binary = data[28 + size :]
    (mesh,) = load(shared_assets / asset).meshes
    (primitive,) = document["meshes"][0]["primitives"]
    extension = primitive["extensions"][EXTENSION]
    view = document["bufferViews"][extension["bufferView"]]
    start = view.get("byteOffset", 0)
    reference = DracoPy.decode(binary[start : start + view["byteLength"]])
    points = reference.get_attribute_by_unique_id(extension["attributes"]["POSITION"])["data"] / divisor
    assert np.allclose(mesh.positions[mesh.triangles], points[reference.faces], atol=1e-7)
    accessor = document["accessors"][primitive["attributes"]["POSITION"]]
    step = 2e-3  # Draco rounds to its own grid; the declared range is that of the source
    assert np.allclose(mesh.positions.min(axis=0), np.array(accessor["min"]) / divisor, atol=step)
    assert np.allclose(mesh.positions.max(axis=0), np.array(accessor["max"]) / divisor, atol=step)
