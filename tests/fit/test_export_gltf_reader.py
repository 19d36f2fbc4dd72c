"""Reading .glb and .gltf back: edited by hand, through Blender, and by tools that know nothing of us."""

from __future__ import annotations

import base64
import contextlib
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fit import export, rotation
from fit.export.glb import build_glb, read_container
from fit.primitives import (
    Kind,
    PrimitiveSet,
    make_box,
    make_cylinder,
    make_half_space,
    make_plane,
    make_sphere,
)

BLENDER = Path(__file__).parent / "data"
"""Written by Blender 5.0's own glTF exporter from `every_kind()`; data/make_in_blender.py does it."""

QUARTER = (0, 0, np.sqrt(0.5), np.sqrt(0.5))


def every_kind() -> PrimitiveSet:
    """The set that the Blender files were made from: numbers that are exact in float32."""
    faces = np.arange(18).reshape(6, 3) / 32
    turn = (0.5, -0.5, 0.5, 0.5)
    wall = np.tile([0.75, 0.75, 0.75], (6, 1))
    wall[2] = (0.75, 0.125, 0.125)
    return PrimitiveSet.concatenate(
        [
            make_box((1, 2, 3), (4, 5, 6), turn, faces, faces[::-1] * 8),
            make_sphere((0, 9, 0), 0.75, (0.25, 0.5, 0.125), (0.5, 0.25, 0), "lamp"),
            make_cylinder((-5, 0, 0), 0.25, 2.0, turn, faces),
            make_plane((0, 0, -4), 3, 2, 0.0625, turn, wall, name="wall"),
            make_half_space((0, -2, 0), (0, 0, 0, 1), (0.25, 0.25, 0.25)),
            make_box((7, 0, 0), (1, 2, 3), albedo=(0.5, 0.5, 0.5), name="crate"),
        ]
    )


@pytest.fixture
def edited(tmp_path) -> Callable[..., PrimitiveSet]:
    """Writes a set, changes the file's JSON by a function, and reads it; notes go to the list given."""

    def trip(primitives: PrimitiveSet, change: Callable[[dict], None], notes: list[str] | None = None):
        export.write(primitives, tmp_path / "set.glb")
        container = read_container(tmp_path / "set.glb")
        change(container.document)
        (tmp_path / "set.glb").write_bytes(build_glb(container.document, container.binary))
        found: list[str] = []
        result = export.read(tmp_path / "set.glb", found)
        if notes is None:
            assert found == []
        else:
            notes += found
        return result

    return trip


def agree(a: PrimitiveSet, b: PrimitiveSet, rtol: float = 0.0) -> None:
    """Asserts that two sets are the same primitives in the same order, up to a relative difference."""
    np.testing.assert_array_equal(a.kinds, b.kinds)
    assert a.names == b.names
    for field in ("positions", "sizes", "albedo", "emission"):
        np.testing.assert_allclose(getattr(a, field), getattr(b, field), rtol=rtol, atol=rtol)
    assert np.abs(np.sum(a.rotations * b.rotations, axis=1)).min() >= 1 - max(rtol, 1e-15)


def child(document: dict, i: int) -> dict:
    """The node that shows primitive i."""
    collider = document["nodes"][document["scenes"][0]["nodes"][i]]
    return document["nodes"][collider["children"][0]]


def without_shapes(document: dict) -> None:
    del document["extensions"]
    document["extensionsUsed"] = ["KHR_materials_emissive_strength"]
    for node in document["nodes"]:
        node.pop("extensions", None)


def without_extras(document: dict) -> None:
    document["asset"].pop("extras")
    for node in document["nodes"]:
        node.pop("extras", None)


def without_names(document: dict) -> None:
    for entry in document["nodes"] + document["meshes"]:
        entry.pop("name")


def test_dropped_shapes_leave_unit_meshes_and_extras(edited):
    agree(edited(every_kind(), without_shapes), every_kind(), 1e-12)


def test_dropped_shapes_and_names_leave_the_extras_kind(edited):
    def change(document):
        without_shapes(document)
        without_names(document)

    agree(edited(every_kind(), change), every_kind(), 1e-12)


def test_dropped_shapes_and_extras_leave_the_meshes_names(edited):
    def change(document):
        without_shapes(document)
        without_extras(document)

    agree(edited(every_kind(), change), every_kind(), 1e-12)


def test_dropped_extras_leave_the_shapes(edited):
    agree(edited(every_kind(), without_extras), every_kind(), 1e-12)


def test_dropped_meshes_leave_colliders_and_extras(edited):
    def change(document):
        for node in document["nodes"]:
            node.pop("mesh", None)
        for part in ("meshes", "materials", "accessors", "bufferViews", "buffers"):
            document.pop(part)

    agree(edited(every_kind(), change), every_kind())


def test_a_moved_mesh_counts_rather_than_its_collider(edited):
    """In a viewer the artist moves, turns and scales what is seen: the child of the collider."""

    def change(document):
        child(document, 0).update(translation=[1, 0, 0], scale=[4, 5, 7])
        child(document, 1).update(scale=[3, 3, 3])
        child(document, 5).update(rotation=list(QUARTER))

    found, before = edited(every_kind(), change), every_kind()
    np.testing.assert_allclose(found.sizes[0], [4, 5, 7])
    axis = before.rotation_matrices()[0][:, 0]
    np.testing.assert_allclose(found.positions[0], before.positions[0] + axis)
    np.testing.assert_allclose(found.sizes[1], [3, 3, 3])
    np.testing.assert_allclose(np.abs(found.rotations[5] @ QUARTER), 1)
    agree(found.select([2, 3, 4]), before.select([2, 3, 4]))
    np.testing.assert_array_equal(found.albedo, before.albedo)


def test_a_moved_parent_moves_all_below(edited):
    """Nodes gathered under a new root that turns, moves and scales, given as a matrix."""
    matrix = np.eye(4)
    matrix[:3, :3] = 2 * rotation.matrices_from_quaternions(QUARTER)
    matrix[:3, 3] = (10, 0, 0)

    def change(document):
        document["nodes"].append(
            {"matrix": matrix.T.ravel().tolist(), "children": document["scenes"][0]["nodes"]}
        )
        document["scenes"][0]["nodes"] = [len(document["nodes"]) - 1]

    agree(edited(every_kind(), change), every_kind().transformed(matrix), 1e-12)


@pytest.mark.parametrize("strip", [lambda d: None, without_shapes], ids=["with shapes", "without"])
def test_mirrored_nodes_keep_each_colour_on_its_side(edited, strip):
    box = make_box((1, 2, 3), (2, 4, 6), albedo=np.arange(18).reshape(6, 3) / 32)

    def change(document):
        strip(document)
        document["nodes"][0]["scale"] = [-1, 1, 1]

    found = edited(box, change)
    np.testing.assert_allclose(found.sizes, box.sizes)
    outward = found.rotation_matrices()[0] @ np.diag([1.0, 1, 1])
    for face in range(6):
        normal = outward[:, face // 2] * (1 - 2 * (face % 2))
        axis = int(np.argmax(np.abs(normal)))
        world_face = 2 * axis + (normal[axis] < 0)
        mirrored = {0: 1, 1: 0}.get(world_face, world_face)
        np.testing.assert_allclose(found.albedo[0, face], box.albedo[0, mirrored])


def test_a_changed_material_counts_rather_than_the_extras(edited):
    def change(document):
        part = document["meshes"][child(document, 3)["mesh"]]["primitives"][1]
        material = document["materials"][part["material"]]
        material["pbrMetallicRoughness"]["baseColorFactor"] = [0, 0, 1, 1]
        material["emissiveFactor"] = [1, 1, 0]
        material["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": 3}}

    found, before = edited(every_kind(), change), every_kind()
    np.testing.assert_array_equal(found.albedo[3, 2], [0, 0, 1])
    np.testing.assert_array_equal(found.emission[3, 2], [3, 3, 0])
    np.testing.assert_array_equal(found.albedo[3, 3], before.albedo[3, 3])
    np.testing.assert_allclose(found.albedo[3, 0], (found.albedo[3, 2] + found.albedo[3, 3]) / 2)
    np.testing.assert_array_equal(found.albedo[:3], before.albedo[:3])


def test_rounding_of_a_material_is_no_change(edited):
    def change(document):
        for material in document["materials"]:
            factor = material["pbrMetallicRoughness"]["baseColorFactor"]
            material["pbrMetallicRoughness"]["baseColorFactor"] = [min(v + 3e-7, 1) for v in factor]

    np.testing.assert_array_equal(edited(every_kind(), change).albedo, every_kind().albedo)


def test_parts_joined_or_split_by_tools_keep_their_faces(edited):
    """All triangles in one part: every face takes that material. Faces are told by normals, not by order."""

    def change(document):
        parts = document["meshes"][child(document, 0)["mesh"]]["primitives"]
        parts.reverse()
        parts[0]["material"], parts[5]["material"] = parts[5]["material"], parts[0]["material"]

    found, before = edited(every_kind(), change), every_kind()
    np.testing.assert_array_equal(found.albedo[0], before.albedo[0][[5, 1, 2, 3, 4, 0]])


def test_a_copied_mesh_is_a_second_primitive(edited):
    def change(document):
        copy = dict(child(document, 5), translation=[0, 5, 0])
        document["nodes"].append(copy)
        document["nodes"][document["scenes"][0]["nodes"][5]]["children"].append(len(document["nodes"]) - 1)

    found = edited(every_kind(), change)
    assert len(found) == 7
    np.testing.assert_allclose(found.positions[5:], [[7, 0, 0], [7, 5, 0]])


def test_deleted_nodes_are_gone(edited):
    def change(document):
        document["scenes"][0]["nodes"] = document["scenes"][0]["nodes"][:2]

    agree(edited(every_kind(), change), every_kind().select([0, 1]))


def test_renamed_nodes_keep_their_new_name(edited):
    def change(document):
        document["nodes"][0]["name"] = "door"
        document["nodes"][2]["name"] = "lamp.001"

    assert edited(every_kind(), change).names[:3] == ("door", "lamp", "")


def test_a_plane_made_thick_becomes_a_box(edited):
    notes: list[str] = []

    def change(document):
        child(document, 3)["scale"][1] = 0.5

    found = edited(every_kind(), change, notes)
    assert found.kinds[3] == Kind.BOX and found.sizes[3].tolist() == pytest.approx([3, 0.5, 2])
    assert notes == ["nodes[6] 'wall': too thick for a plane; taken as a box"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: child(d, 1).update(scale=[1, 2, 1]), r"'lamp mesh': is a sphere scaled unevenly"),
        (lambda d: child(d, 0).update(scale=[0, 1, 1]), r"'box_0000 mesh': is scaled to nothing"),
        (lambda d: child(d, 0).update(rotation=list(QUARTER)) or _stretch(d), r"is sheared; undo the uneven"),
        (lambda d: d["meshes"][0].update(name="sdfprim_sphere"), r"a mesh that is no sphere any more"),
        (lambda d: d["nodes"][0].update(translation=["a", 0, 0]), r"nodes\[0\] 'box_0000': is malformed"),
        (lambda d: d["nodes"][1].update(children=[0]), r"has two parents or is its own ancestor"),
        (lambda d: d["nodes"][0].update(children=[99]), r"nodes: hold no 99, which a parent names"),
        (lambda d: d["scenes"][0].update(nodes=[0, 0]), r"has two parents or is its own ancestor"),
        (lambda d: d.update(scene=5), r"scenes: are malformed"),
        (lambda d: d.update(nodes={}), r"nodes: is no list"),
        (lambda d: d["accessors"][0].update(count=10**9), r"accessors\[0\]: reaches beyond its buffer"),
        (lambda d: d["accessors"][0].update(componentType=1), r"accessors\[0\]: is malformed"),
        (lambda d: d["accessors"][0].pop("bufferView"), r"accessors\[0\]: is sparse"),
        (lambda d: _shape(d, 0).update(box={"size": [1, 2]}), r"'box_0000': is malformed"),
        (lambda d: _shape(d, 1).update(sphere={"radius": "big"}), r"'lamp': is malformed"),
        (lambda d: d["extensions"].clear(), r"'box_0000': is malformed: 'KHR_implicit_shapes'"),
        (
            lambda d: d["nodes"][0]["extras"]["sdfprim"].update(version=2),
            r"is of version 2; this program reads version 1",
        ),
        (lambda d: d["asset"].update(version="1.0"), r"asset\.version: is not 2"),
    ],
)
def test_broken_files_are_named_errors(edited, change, message):
    with pytest.raises(export.FormatError, match=message):
        edited(every_kind(), change)


def _stretch(document: dict) -> None:
    document["nodes"][0]["rotation"] = [0, 0, 0, 1]
    child(document, 0)["rotation"] = rotation.normalized([0, 0, 1, 2]).tolist()
    document["nodes"][0]["scale"] = [1, 3, 1]


def _shape(document: dict, i: int) -> dict:
    return document["extensions"]["KHR_implicit_shapes"]["shapes"][i]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "JSON: can't be parsed"),
        (b"[]", "asset: is missing"),
        (b"glTF\2\0\0\0", "header: is cut short"),
        (b"glTF\1\0\0\0\xff\0\0\0" + bytes(20), "header: says version 1, 255 bytes, but 32 are there"),
        (b"glTF\2\0\0\0\x20\0\0\0\xff\xff\0\0JSON" + bytes(12), "chunk at byte 12: is cut short"),
        (b"glTF\2\0\0\0\x20\0\0\0\x0c\0\0\0BIN\0" + bytes(12), "chunks: hold no JSON"),
        (b"[" * 100_000, "JSON: can't be parsed"),
        (b'{"asset": {"version": "2.0"}}', "nodes: hold no primitive, neither a KHR_implicit_shapes"),
    ],
)
def test_broken_containers_are_named_errors(tmp_path, content, message):
    path = tmp_path / "set.glb"
    path.write_bytes(content)
    with pytest.raises(export.FormatError, match=message) as error:
        export.read(path)
    assert str(error.value).startswith(str(path))


def as_gltf(folder: Path, uri: str | None) -> Path:
    """A written set as .gltf, its buffer embedded or, for a URI, in that file."""
    export.write(every_kind(), folder / "set.glb")
    container = read_container(folder / "set.glb")
    embedded = "data:application/octet-stream;base64," + base64.b64encode(container.binary).decode()
    container.document["buffers"][0]["uri"] = embedded if uri is None else uri
    (folder / "set.gltf").write_text(json.dumps(container.document))
    (folder / "set data.bin").write_bytes(container.binary)
    return folder / "set.gltf"


@pytest.mark.parametrize("uri", [None, "set%20data.bin"])
def test_gltf_with_embedded_or_separate_data(tmp_path, uri):
    agree(export.read(as_gltf(tmp_path, uri), []), every_kind())


@pytest.mark.parametrize(
    ("uri", "message"),
    [
        ("../set%20data.bin", r"buffers\[0\]: leads out of the file's folder"),
        ("none.bin", r"buffers\[0\]: names none\.bin, which is not there"),
        ("data:;base64,a", r"buffers\[0\]: holds broken base64"),
    ],
)
def test_gltf_with_data_out_of_reach(tmp_path, uri, message):
    with pytest.raises(export.FormatError, match=message):
        export.read(as_gltf(tmp_path, uri), [])


@pytest.mark.parametrize("file", ["shapes_dropped.glb", "scale_applied.glb"])
def test_a_trip_through_blender_changes_nothing(file):
    """Blender drops the shapes and, by default, the extras; "Apply Scale" moves sizes into the meshes."""
    notes: list[str] = []
    found = export.read(BLENDER / file, notes)
    assert notes == []
    agree(in_order_of(found, every_kind()), every_kind(), 1e-6)


def test_an_edit_in_blender_is_what_is_read():
    """The crate was moved by 1 m up, doubled and painted red; the lamp's empty was moved 5 m along x."""
    found = in_order_of(export.read(BLENDER / "edited.glb", []), every_kind())
    before = every_kind()
    agree(found.select([0, 2, 3, 4]), before.select([0, 2, 3, 4]), 1e-6)
    np.testing.assert_allclose(found.positions[5], [7, 1, 0], atol=1e-6)
    np.testing.assert_allclose(found.sizes[5], [2, 4, 6], rtol=1e-6)
    np.testing.assert_allclose(found.albedo[5], np.tile([1, 0, 0], (6, 1)), atol=1e-6)
    np.testing.assert_allclose(found.positions[1], [5, 9, 0], atol=1e-6)
    np.testing.assert_allclose(found.albedo[1], before.albedo[1], atol=1e-6)


def in_order_of(found: PrimitiveSet, reference: PrimitiveSet) -> PrimitiveSet:
    """Blender sorts by name: put the primitives back in the reference's order, by kind and size."""

    def keys(s: PrimitiveSet) -> list[tuple]:
        names = s.names or ("",) * len(s)
        return [(names[i], int(s.kinds[i]), bool(s.is_half_space[i])) for i in range(len(s))]

    known = keys(found)
    assert sorted(known) == sorted(keys(reference))
    return found.select([known.index(key) for key in keys(reference)])


def plain(path: Path, nodes: list[dict], shapes: list[dict], **rest) -> Path:
    """A file of another tool: colliders only."""
    document = {"asset": {"version": "2.0"}, "nodes": nodes, **rest}
    document["extensions"] = {"KHR_implicit_shapes": {"shapes": shapes}}
    path.write_bytes(build_glb(document, b""))
    return path


def collider(shape: int, **rest) -> dict:
    bodies = {"collider": {"geometry": {"shape": shape}}}
    return {"extensions": {"KHR_physics_rigid_bodies": bodies}, **rest}


def test_plain_colliders_of_other_tools(tmp_path):
    """Defaults of the extension's draft, scaled nodes, and what is no primitive named in the notes."""
    shapes = [
        {"type": "box"},
        {"type": "sphere", "sphere": {}},
        {"type": "cylinder", "cylinder": {"height": 3}},
        {"type": "plane", "plane": {"sizeX": 4, "sizeZ": 0.5}},
        {"type": "plane"},
        {"type": "capsule", "capsule": {}},
        {"type": "cylinder", "cylinder": {"radiusTop": 0}},
        {"type": "plane", "plane": {"sizeX": 4}},
    ]
    nodes = [collider(i, name=str(i)) for i in range(8)]
    nodes[0]["scale"] = [1, 2, 3]
    nodes.append(collider(1, name="egg", scale=[1, 2, 1]))
    nodes.append({"extensions": {"KHR_physics_rigid_bodies": {"collider": {"geometry": {"mesh": 0}}}}})
    nodes.append(
        {"extensions": {"KHR_physics_rigid_bodies": {"collider": {"shape": 0}}}, "name": "old draft"}
    )
    notes: list[str] = []
    found = export.read(plain(tmp_path / "set.glb", nodes, shapes), notes)
    assert found.kinds.tolist() == [Kind.BOX, Kind.SPHERE, Kind.CYLINDER, Kind.PLANE, Kind.PLANE, Kind.BOX]
    np.testing.assert_allclose(found.sizes[:4], [[1, 2, 3], [1, 1, 1], [0.5, 3, 0.5], [4, 0.005, 0.5]])
    assert found.is_half_space.tolist() == [False] * 4 + [True, False]
    assert np.all(found.albedo == 0.5) and not found.emission.any()
    told = [n for n in notes if "no material" not in n]
    assert told == [
        "nodes[3] '3': a plane without thickness; taken as 0.005 m thick",
        "nodes[5] '5': a capsule is no primitive; left out",
        "nodes[6] '6': a cone is no primitive; left out",
        "nodes[7] '7': a plane that is endless one way is no primitive; left out",
        "nodes[8] 'egg': is a sphere scaled unevenly, to [1.0, 2.0, 1.0]; scale it evenly across; left out",
        "nodes[9]: a mesh or hull collider is no primitive; left out",
    ]


def test_notes_become_warnings_when_nobody_takes_them(tmp_path):
    path = plain(tmp_path / "set.glb", [collider(0), collider(1)], [{"type": "box"}, {"type": "capsule"}])
    with pytest.warns(UserWarning) as told:
        assert len(export.read(path)) == 1
    assert any("a capsule is no primitive; left out" in str(warning.message) for warning in told)


def test_a_file_of_nothing_but_capsules_is_an_error_that_says_so(tmp_path):
    path = plain(tmp_path / "set.glb", [collider(0)], [{"type": "capsule"}])
    with pytest.raises(export.FormatError, match=r"hold no primitive.*a capsule is no primitive"):
        export.read(path, [])


def test_a_plain_collider_takes_the_colours_of_the_mesh_it_carries(tmp_path):
    """A cube of 2 m with a red +x half, the collider a box around it: each face its own colour."""
    export.write(make_box(size=(2, 2, 2), albedo=np.eye(6, 3) * 0.5 + 0.25), tmp_path / "set.glb")
    container = read_container(tmp_path / "set.glb")
    without_extras(container.document)
    container.document["meshes"][0]["name"] = "Cube"
    container.document["nodes"][1]["translation"] = [0.5, 0, 0]
    (tmp_path / "set.glb").write_bytes(build_glb(container.document, container.binary))
    found = export.read(tmp_path / "set.glb", [])
    np.testing.assert_array_equal(found.positions, [[0, 0, 0]])
    np.testing.assert_allclose(found.albedo[0], np.eye(6, 3) * 0.5 + 0.25)


def test_colours_of_several_meshes_are_weighed_by_area(tmp_path):
    """A black cube of 2 m and a white one of 1 m under one collider: a fifth of each face's area is white."""
    cubes = PrimitiveSet.concatenate(
        [make_box(size=(2, 2, 2), albedo=(0, 0, 0)), make_box(albedo=(1, 1, 1), emission=(5, 5, 5))]
    )
    export.write(cubes, tmp_path / "set.glb")
    container = read_container(tmp_path / "set.glb")
    without_extras(container.document)
    for mesh in container.document["meshes"]:
        mesh["name"] = "Cube"
    container.document["nodes"][0]["children"] = [1, 3]
    container.document["scenes"][0]["nodes"] = [0]
    (tmp_path / "set.glb").write_bytes(build_glb(container.document, container.binary))
    found = export.read(tmp_path / "set.glb", [])
    np.testing.assert_allclose(found.albedo, np.full((1, 6, 3), 0.2), rtol=1e-6)
    np.testing.assert_allclose(found.emission, np.full((1, 6, 3), 1.0), rtol=1e-6)


def test_the_physics_samples_of_the_draft(shared_assets):
    """eoineoineoin's own sample: boxes, cylinders, a sphere; capsules, a cone and hulls are named."""
    notes: list[str] = []
    found = export.read(shared_assets / "Physics_ShapeTypes" / "ShapeTypes.glb", notes)
    counts = np.bincount(found.kinds, minlength=4).tolist()
    assert counts == [1, 1, 5, 0]
    np.testing.assert_allclose(found.sizes[0], [0.52855003, 1, 0.52855003], rtol=1e-6)
    np.testing.assert_allclose(found.positions[0], [2.31274104, 3.55570388, 2.96197009], rtol=1e-6)
    assert sum("capsule" in n for n in notes) == 2 and sum("cone" in n for n in notes) == 1
    assert sum("mesh or hull" in n for n in notes) == 4


def test_random_damage_is_an_error_or_harmless(tmp_path):
    """Any value of the JSON replaced by another, or bytes flipped: a FormatError or a set, nothing else."""
    export.write(every_kind(), tmp_path / "set.glb")
    sound = read_container(as_gltf(tmp_path, None))
    rng = np.random.default_rng(0)
    values = [None, True, -1, 0, 7, 1e300, float("nan"), "text", [], {}, [[]], [1, 2], {"a": 1}, 10**30]
    for _ in range(80):
        document = json.loads(json.dumps(sound.document))
        entry, parent, key = document, None, None
        while isinstance(entry, dict | list) and entry and rng.random() < 0.9:
            parent, key = entry, rng.choice(len(entry))
            key = list(entry)[key] if isinstance(entry, dict) else int(key)
            entry = entry[key]
        if parent is not None:
            parent[key] = values[rng.integers(len(values))]
        (tmp_path / "set.gltf").write_text(json.dumps(document))
        text = bytearray((tmp_path / "set.glb").read_bytes())
        text[rng.integers(len(text))] ^= 1 << int(rng.integers(8))
        (tmp_path / "flipped.glb").write_bytes(text)
        for file in ("set.gltf", "flipped.glb"):
            with contextlib.suppress(export.FormatError):
                export.read(tmp_path / file, []).validate()
