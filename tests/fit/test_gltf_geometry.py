"""Primitives: topologies, indices, attributes, normals, repairs, quantisation, shared buffers."""

from __future__ import annotations

import numpy as np
import pytest

from fit.gltf import GltfError

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
STRIP = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0]], np.float32)
FAN = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
UP_Z = (0.0, 0.0, 1.0)


def areas_facing(mesh, axis=UP_Z):
    """Signed areas (m,) of the triangles as seen along `axis`."""
    a, b, c = np.moveaxis(mesh.positions[mesh.triangles], 1, 0)
    return np.cross(b - a, c - a) @ axis / 2


@pytest.mark.parametrize("indexed", [None, "u1", "<u2", "<u4"])
@pytest.mark.parametrize(
    ("mode", "positions", "areas"),
    [
        (4, TRIANGLE[[0, 1, 2, 2, 1, 0]], [0.5, -0.5]),
        (5, STRIP, [0.5, 0.5, 0.5]),
        (6, FAN, [0.5, 0.5]),
    ],
)
def test_topologies(builder, load_built, mode, positions, areas, indexed):
    indices = None if indexed is None else np.arange(len(positions), dtype=indexed)
    builder.square(positions=positions, indices=indices, mode=mode)
    (mesh,) = load_built(builder).meshes
    assert np.allclose(areas_facing(mesh), areas)


def test_fan_and_strip_by_spec(builder, load_built):
    """Corner order of section 3.7.2.1: strip (i, i + 1 + i % 2, i + 2 - i % 2), fan (i + 1, i + 2, 0)."""
    marks = np.arange(5, dtype=np.float32)
    normals = np.tile(np.float32(UP_Z), (5, 1))
    for mode, expected in ((5, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]), (6, [[1, 2, 0], [2, 3, 0], [3, 4, 0]])):
        positions = np.stack([marks, marks**2, 0 * marks], axis=1)
        builder.square(positions=positions, indices=None, mode=mode, NORMAL=normals)
        mesh = load_built(builder).meshes[-1]
        assert np.array_equal(mesh.positions[mesh.triangles][:, :, 0], expected)


def test_points_and_lines_are_counted(builder, load_built):
    builder.square()
    for mode in (0, 0, 1, 2, 3):
        builder.square(mode=mode, indices=None)
    scene = load_built(builder)
    assert scene.triangle_count == 2
    assert set(scene.ignored) == {
        "POINTS primitives: 2",
        "LINES primitives: 1",
        "LINE_LOOP primitives: 1",
        "LINE_STRIP primitives: 1",
    }


def test_left_over_corners_are_reported(builder, load_built):
    builder.square(indices=np.array([0, 1, 2, 0, 2], np.uint8))
    scene = load_built(builder)
    assert scene.triangle_count == 1
    assert scene.repairs["corners that form no triangle"] == 2


def test_flat_normals_where_there_are_none(builder, load_built):
    roof = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    builder.square(positions=roof, indices=np.array([0, 1, 2, 0, 3, 1], np.uint8))
    scene = load_built(builder)
    (mesh,) = scene.meshes
    assert np.allclose(mesh.normals[mesh.triangles[0]], (0, 0, 1))
    assert np.allclose(mesh.normals[mesh.triangles[1]], (0, 1, 0))
    assert scene.repairs == {"meshes whose missing normals were computed": 1}


def test_bad_normals_are_taken_from_the_triangles(builder, load_built):
    normals = np.array([[0, 0, 0], [np.nan, 0, 0], [np.inf, 0, 0], [0, 3, 4]], np.float32)
    builder.square(NORMAL=normals)
    scene = load_built(builder)
    assert np.allclose(scene.meshes[0].normals, [UP_Z, UP_Z, UP_Z, (0, 0.6, 0.8)])
    assert scene.repairs == {"normals without direction replaced": 3}


def test_non_finite_positions_take_their_triangles_along(builder, load_built):
    positions = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [np.nan, 1, 0], [np.inf, 0, 0]], np.float32)
    triangles = np.array([0, 1, 2, 0, 2, 3, 1, 2, 4], np.uint8)
    colors = np.linspace(0, 1, 15, dtype=np.float32).reshape(5, 3)
    builder.square(positions=positions, indices=triangles, COLOR_0=colors)
    scene = load_built(builder)
    (mesh,) = scene.meshes
    assert np.array_equal(mesh.positions[mesh.triangles[0]], positions[:3])
    assert np.allclose(mesh.colors[mesh.triangles[0]][:, :3], colors[:3])
    assert scene.triangle_count == 1
    assert scene.repairs["vertices at NaN or infinity dropped"] == 2
    assert scene.repairs["triangles at NaN or infinity dropped"] == 2


def test_all_positions_non_finite(builder, load_built):
    builder.square(positions=np.full((4, 3), np.nan, np.float32))
    with pytest.raises(
        GltfError, match=r"meshes\[0\]\.primitives\[0\]\.attributes\.POSITION: every position"
    ):
        load_built(builder)


def test_zero_area_triangles_are_kept_and_counted(builder, load_built):
    builder.square(indices=np.array([0, 1, 2, 0, 0, 1, 2, 2, 2], np.uint8))
    scene = load_built(builder)
    assert scene.triangle_count == 3
    assert scene.repairs["triangles of zero area kept"] == 2
    assert np.allclose(np.linalg.norm(scene.meshes[0].normals, axis=1), 1)


def test_texcoord_sets_and_colors(builder, load_built):
    first = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    builder.square(
        NORMAL=np.tile(np.float32(UP_Z), (4, 1)),
        TEXCOORD_0=first,
        TEXCOORD_1=builder.accessor((first * 65535).astype(np.uint16), normalized=True),
        TEXCOORD_2=builder.accessor((first * 255).astype(np.uint8), normalized=True),
        COLOR_0=builder.accessor(np.full((4, 4), 51, np.uint8), normalized=True),
        COLOR_1=np.zeros((4, 3), np.float32),
        _CUSTOM=np.zeros(4, np.float32),
    )
    scene = load_built(builder)
    (mesh,) = scene.meshes
    assert [np.allclose(values, first) for values in mesh.texcoords] == [True] * 3
    assert np.allclose(mesh.colors, 0.2)
    assert set(scene.ignored) == {"attribute COLOR_1: 1", "attribute _CUSTOM: 1"}


def test_colors_without_alpha_are_opaque(builder, load_built):
    builder.square(COLOR_0=np.full((4, 3), 0.5, np.float32))
    assert np.allclose(load_built(builder).meshes[0].colors, (0.5, 0.5, 0.5, 1))


def test_non_finite_texcoords_become_zero(builder, load_built):
    texcoords = np.array([[0, 0], [np.nan, 0], [1, 1], [0, np.inf]], np.float32)
    builder.square(NORMAL=np.tile(np.float32(UP_Z), (4, 1)), TEXCOORD_0=texcoords)
    scene = load_built(builder)
    assert np.array_equal(scene.meshes[0].texcoords[0], [[0, 0], [0, 0], [1, 1], [0, 0]])
    assert scene.repairs == {"non-finite texture coordinates set to 0": 2}


@pytest.mark.parametrize(
    ("dtype", "normalized", "expected"),
    [("<u2", False, 4000), ("<i2", True, 4000 / 32767), ("i1", False, 100), ("u1", True, 100 / 255)],
)
def test_quantized_positions(builder, load_built, dtype, normalized, expected):
    size = {"<u2": 4000, "<i2": 4000, "i1": 100, "u1": 100}[dtype]
    corners = np.array([[0, 0, 0], [size, 0, 0], [0, size, 0]], dtype)
    builder.extend("KHR_mesh_quantization", required=True)
    builder.square(
        positions=builder.accessor(corners, normalized=normalized),
        indices=None,
        NORMAL=builder.accessor(np.array([[0, 0, 127]] * 3, "i1"), normalized=True),
    )
    lower, upper = load_built(builder).bounds()
    assert np.allclose(lower, 0)
    assert np.allclose(upper, (expected, expected, 0))


def test_only_used_vertices_of_a_shared_buffer_are_kept(builder, load_built):
    many = np.random.default_rng(0).normal(size=(1000, 3)).astype(np.float32)
    shared = builder.accessor(many)
    normals = builder.accessor(np.tile(np.float32(UP_Z), (1000, 1)))
    for start in (0, 500):
        indices = np.arange(start, start + 6, dtype=np.uint16)[::-1]
        builder.square(positions=shared, indices=indices, NORMAL=normals)
    for mesh, start in zip(load_built(builder).meshes, (0, 500), strict=True):
        assert len(mesh.positions) == 6
        assert np.allclose(mesh.positions[mesh.triangles].reshape(-1, 3), many[start : start + 6][::-1])


def test_index_out_of_range(builder, load_built):
    builder.square(indices=np.array([0, 1, 4], np.uint32))
    with pytest.raises(
        GltfError, match=r"meshes\[0\]\.primitives\[0\]\.indices: index 4 in accessors\[1\] points past the 4"
    ):
        load_built(builder)


def test_float_indices_are_refused(builder, load_built):
    builder.square(indices=np.array([0, 1, 2], np.float32))
    with pytest.raises(GltfError, match=r"accessors\[1\]\.componentType: must hold integers"):
        load_built(builder)


def test_attribute_counts_must_agree(builder, load_built):
    builder.square(NORMAL=np.tile(np.float32(UP_Z), (3, 1)))
    with pytest.raises(GltfError, match=r"attributes\.NORMAL: has 3 values where 4 are expected"):
        load_built(builder)


def test_empty_primitives_are_counted(builder, load_built):
    builder.square()
    builder.square(indices=builder.accessor(np.zeros(0, np.uint16)))
    builder.node(mesh=builder.add("meshes", primitives=[{"attributes": {}}]))
    scene = load_built(builder)
    assert scene.triangle_count == 2
    assert set(scene.ignored) == {"primitives without triangles: 1", "primitives without positions: 1"}


def test_mesh_names(builder, load_built):
    builder.node(mesh=builder.mesh(builder.primitive(), name="one"))
    builder.node(mesh=builder.mesh(builder.primitive(), builder.primitive(), name="two"))
    builder.square()
    assert [mesh.name for mesh in load_built(builder).meshes] == ["one", "two.0", "two.1", "mesh 2"]


def test_a_file_can_not_unfold_without_bound(builder, load_built, monkeypatch):
    monkeypatch.setattr("fit.gltf.primitives.MAX_VALUES", 20)
    shared = builder.accessor(np.zeros((4, 3), np.float32))
    for _ in range(4):
        builder.square(positions=shared)
    with pytest.raises(GltfError, match="the file unfolds to more than 20 vertices or triangle corners"):
        load_built(builder)
