"""Files made to break a reader: whatever the bytes, the outcome is a `Scene` or a `GltfError`, and soon."""

from __future__ import annotations

import json
import time
import tracemalloc
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fit.gltf import GltfError, load
from fit.scene import Scene

SECONDS = 5.0
BYTES = 1 << 28


def rich_file(builder):
    """A small file that uses most of what the reader knows."""
    normals = np.tile(np.float32([0, 0, 1]), (4, 1))
    texcoords = np.float32([[0, 0], [1, 0], [1, 1], [0, 1]])
    png = (
        b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01\x08\x06\0\0\0\x1f\x15\xc4\x89\0\0\0\rIDATx\xda"
        b"c\xf8\xcf\xc0\xf0\x1f\0\x05\0\x01\xff\x89\x99=\x1d\0\0\0\0IEND\xaeB`\x82"
    )
    image = builder.add("images", bufferView=builder.view(png))
    texture = builder.add("textures", source=image, sampler=builder.add("samplers", wrapS=33071))
    material = builder.add(
        "materials",
        pbrMetallicRoughness={
            "baseColorTexture": {"index": texture, "extensions": {"KHR_texture_transform": {"rotation": 1}}}
        },
        emissiveFactor=[1, 1, 1],
    )
    sparse = {
        "count": 1,
        "indices": {"bufferView": builder.view(b"\2"), "componentType": 5121},
        "values": {"bufferView": builder.view(np.float32([0, 0, 1]).tobytes())},
    }
    move = builder.add("accessors", componentType=5126, count=4, type="VEC3", sparse=sparse)
    plain = builder.primitive(
        NORMAL=normals, TEXCOORD_0=texcoords, material=material, targets=[{"POSITION": move}]
    )
    skinned = builder.primitive(JOINTS_0=np.zeros((4, 4), np.uint8), WEIGHTS_0=np.ones((4, 4), np.float32))
    strip = builder.primitive(indices=None, mode=5, COLOR_0=np.ones((4, 3), np.float32))
    instances = {"TRANSLATION": builder.accessor(np.zeros((2, 3), np.float32))}
    builder.node(
        mesh=builder.mesh(plain, weights=[0.5]),
        extensions={"EXT_mesh_gpu_instancing": {"attributes": instances}},
    )
    builder.node(mesh=builder.mesh(skinned), skin=builder.add("skins", joints=[0]), children=[0])
    builder.node(mesh=builder.mesh(strip), rotation=[0, 0, 0, 1], children=[1])
    builder.add("cameras", type="perspective", perspective={"yfov": 1, "znear": 0.1})
    builder.document["nodes"][0]["camera"] = 0
    builder.document["scenes"] = [{"nodes": [2]}]
    return builder


def outcome(path):
    """Load a file; the outcome must be a scene whose arrays fit together, or a `GltfError`."""
    start = time.monotonic()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            scene = load(path)
    except GltfError as error:
        assert str(error).startswith(str(path))
        return error
    finally:
        assert time.monotonic() - start < SECONDS
    assert isinstance(scene, Scene)
    for mesh in scene.meshes:
        assert mesh.triangles.max(initial=0) < len(mesh.positions) == len(mesh.normals)
        assert np.isfinite(mesh.positions).all()
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1)
    assert all(np.isfinite(instance.world_from_local).all() for instance in scene.instances)
    assert len(scene.images) == len({texture.image for texture in scene.textures})
    return scene


@pytest.fixture(scope="module")
def fuzzed(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz") / "fuzzed.glb"


fuzz = settings(max_examples=400, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


def test_the_file_to_fuzz_is_whole(builder, fuzzed):
    scene = outcome(rich_file(builder).write(fuzzed))
    assert scene.triangle_count == 2 * 2 + 2 + 2
    assert scene.ignored == ()


@fuzz
@given(edits=st.lists(st.tuples(st.integers(0, 1 << 16), st.integers(0, 255)), min_size=1, max_size=8))
def test_changed_bytes(new_builder, fuzzed, edits):
    data = bytearray(rich_file(new_builder()).glb())
    for position, value in edits:
        data[position % len(data)] = value
    fuzzed.write_bytes(data)
    outcome(fuzzed)


@fuzz
@given(start=st.integers(0, 1 << 16), length=st.integers(0, 200), patch=st.binary(max_size=50))
def test_replaced_stretches(new_builder, fuzzed, start, length, patch):
    data = rich_file(new_builder()).glb()
    start %= len(data)
    fuzzed.write_bytes(data[:start] + patch + data[start + length :])
    outcome(fuzzed)


ODD_NUMBERS = [-1, 0, 1, 2, 3, 1.5, 255, 65536, 2**31, 2**53, 2**70, 10**400, -1e308, 1e308, 5120, 5125, 5126]
ODD_OTHERS = [None, True, "", "x", "VEC4", [], {}, [0], [0, 1], [[]], [{}], {"POSITION": 0}, {"count": 2**40}]
ODD_VALUES = st.sampled_from(ODD_NUMBERS + ODD_OTHERS)


def places(value, path=()):
    """Paths of all values in a JSON document."""
    found = [path] if path else []
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in items:
        found += places(child, (*path, key))
    return found


@fuzz
@given(data=st.data())
def test_odd_json_values(new_builder, fuzzed, data):
    builder = rich_file(new_builder())
    for _ in range(data.draw(st.integers(1, 3))):
        path = data.draw(st.sampled_from(places(builder.document)))
        owner = builder.document
        for key in path[:-1]:
            owner = owner[key]
        owner[path[-1]] = json.loads(json.dumps(data.draw(ODD_VALUES)))
    fuzzed.write_bytes(builder.glb())
    outcome(fuzzed)


@pytest.mark.parametrize(
    "value",
    [np.nan, np.inf, -np.inf, 3e38, -3e38, 1e-45],
    ids=["nan", "inf", "-inf", "huge", "-huge", "tiny"],
)
@pytest.mark.parametrize(
    "attribute", ["POSITION", "NORMAL", "TEXCOORD_0", "COLOR_0", "WEIGHTS_0", "JOINTS_0"]
)
@pytest.mark.parametrize("share", [1, 4])
def test_odd_floats(builder, tmp_path, attribute, value, share):
    widths = {"POSITION": 3, "NORMAL": 3, "TEXCOORD_0": 2, "COLOR_0": 4, "WEIGHTS_0": 4, "JOINTS_0": 4}
    arrays = {name: np.full((4, width), 0.5, np.float32) for name, width in widths.items()}
    arrays["JOINTS_0"][:] = 0
    arrays["POSITION"][:] = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    arrays[attribute][:share] = value
    primitive = builder.primitive(positions=arrays.pop("POSITION"), **arrays)
    move = builder.accessor(np.full((4, 3), value, np.float32))
    primitive["targets"] = [{"POSITION": move}]
    builder.node(mesh=builder.mesh(primitive, weights=[0.0]), skin=builder.add("skins", joints=[0]))
    found = outcome(builder.write(tmp_path / "odd.glb"))
    for mesh in found.meshes if isinstance(found, Scene) else ():
        assert all(np.isfinite(values).all() for values in (*mesh.texcoords, mesh.colors))


def bomb_of_views(builder):
    """Ten thousand primitives, each of all of one large buffer."""
    many = builder.accessor(np.zeros((200_000, 3), np.float32))
    primitives = [builder.primitive(positions=many, indices=None) for _ in range(10_000)]
    builder.node(mesh=builder.mesh(*primitives))


def bomb_of_targets(builder):
    many = builder.accessor(np.zeros((200_000, 3), np.float32))
    builder.node(
        mesh=builder.mesh(
            builder.primitive(positions=many, indices=None, targets=[{"POSITION": many}] * 10_000)
        )
    )


def bomb_of_zeros(builder):
    zeros = [builder.add("accessors", componentType=5126, count=1 << 25, type="VEC3") for _ in range(8)]
    builder.node(mesh=builder.mesh(*[builder.primitive(positions=number) for number in zeros]))


def bomb_of_instances(builder):
    node = builder.square()
    zeros = builder.add("accessors", componentType=5126, count=1 << 25, type="VEC3")
    builder.document["nodes"][node]["extensions"] = {
        "EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": zeros}}
    }


def bomb_of_nodes(builder):
    below = builder.square()
    for _ in range(60):
        below = builder.node(children=[below, below])


@pytest.mark.parametrize(
    ("bomb", "message"),
    [
        (bomb_of_views, "unfolds to more than"),
        (bomb_of_targets, "unfolds to more than"),
        (bomb_of_zeros, "asks for absurdly many values"),
        (bomb_of_instances, "instances; simplify it"),
        (bomb_of_nodes, "shared children make more than"),
    ],
)
def test_bombs(builder, tmp_path, monkeypatch, bomb, message):
    """A file of a few megabytes at most must not take gigabytes; the real limits are only scaled down."""
    monkeypatch.setattr("fit.gltf.primitives.MAX_VALUES", 1 << 20)
    monkeypatch.setattr("fit.gltf.accessors.MAX_MADE_VALUES", 1 << 20)
    monkeypatch.setattr("fit.gltf.loader.MAX_INSTANCES", 1 << 10)
    monkeypatch.setattr("fit.gltf.nodes.MAX_NODES", 1 << 12)
    bomb(builder)
    file = builder.write(tmp_path / "bomb.glb")
    tracemalloc.start()
    try:
        error = outcome(file)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert isinstance(error, GltfError)
    assert any(text in str(error) for text in (message, "asks for absurdly many values"))
    assert peak < BYTES
