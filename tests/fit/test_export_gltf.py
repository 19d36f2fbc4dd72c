"""The .prims.glb that we write: its JSON, its meshes, and what others make of it."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fit import export, rotation, sdf
from fit.export.glb import read_container
from fit.export.unit_meshes import UNIT_MESHES
from fit.primitives import (
    PrimitiveSet,
    make_box,
    make_cylinder,
    make_half_space,
    make_plane,
    make_sphere,
)


def every_kind() -> PrimitiveSet:
    rng = np.random.default_rng(1)
    turns = rotation.normalized(rng.normal(size=(4, 4)))
    red_and_white = np.full((6, 3), 0.9)
    red_and_white[2] = (0.8, 0.1, 0.1)
    return PrimitiveSet.concatenate(
        [
            make_box((1, 2, 3), (4, 5, 6), turns[0], rng.random((6, 3)), rng.random((6, 3)) * 40),
            make_sphere((0, 9, 0), 0.7, (0.2, 0.3, 0.4), (0.5, 0.25, 0), "lamp"),
            make_cylinder((-5, 0, 0), 0.3, 2.0, turns[1], (0.1, 0.1, 0.1)),
            make_plane((0, 0, -4), 3, 2, 0.02, turns[2], red_and_white, name="wall"),
            make_half_space((0, -2, 0), turns[3], (0.3, 0.3, 0.3)),
        ]
    )


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("glb") / "set.prims.glb"
    export.write(every_kind(), path)
    return path


@pytest.fixture(scope="module")
def document(written) -> dict:
    return read_container(written).document


def test_colliders_are_where_the_drafts_put_them(document):
    shapes = document["extensions"]["KHR_implicit_shapes"]["shapes"]
    assert shapes == [
        {"type": "box", "box": {"size": [4.0, 5.0, 6.0]}},
        {"type": "sphere", "sphere": {"radius": 0.7}},
        {"type": "cylinder", "cylinder": {"height": 2.0, "radiusBottom": 0.3, "radiusTop": 0.3}},
        {"type": "plane", "plane": {"sizeX": 3.0, "sizeZ": 2.0, "doubleSided": True}},
        {"type": "plane", "plane": {"doubleSided": False}},
    ]
    colliders = [document["nodes"][root] for root in document["scenes"][0]["nodes"]]
    geometry = [
        c["extensions"]["KHR_physics_rigid_bodies"]["collider"]["geometry"]["shape"] for c in colliders
    ]
    assert geometry == [0, 1, 2, 3, 4]
    assert document["extensionsUsed"] == [
        "KHR_implicit_shapes",
        "KHR_physics_rigid_bodies",
        "KHR_materials_emissive_strength",
    ]
    assert "extensionsRequired" not in document


def test_the_collider_has_the_place_and_its_child_the_size(document):
    primitives = every_kind()
    for i, root in enumerate(document["scenes"][0]["nodes"]):
        collider = document["nodes"][root]
        assert "scale" not in collider and "matrix" not in collider and "mesh" not in collider
        assert collider["translation"] == primitives.positions[i].tolist()
        assert collider["rotation"] == primitives.rotations[i].tolist()
        (child,) = (document["nodes"][c] for c in collider["children"])
        assert set(child) == {"name", "mesh", "scale"}
        if i < 4:
            assert child["scale"] == primitives.sizes[i].tolist()
    lower, upper = primitives.bounds()
    assert child["scale"] == pytest.approx([2 * np.linalg.norm(upper - lower), 1, child["scale"][0]])


def test_extras_hold_our_own_facts(document):
    facts = [document["nodes"][r]["extras"]["sdfprim"] for r in document["scenes"][0]["nodes"]]
    assert [f["kind"] for f in facts] == ["box", "sphere", "cylinder", "plane", "half_space"]
    assert [f["name"] for f in facts] == ["", "lamp", "", "wall", ""]
    assert [f["version"] for f in facts] == [1] * 5
    assert [f.get("thickness") for f in facts] == [None, None, None, 0.02, None]
    np.testing.assert_array_equal(np.float32([f["albedo"] for f in facts]), every_kind().albedo)
    names = [document["nodes"][r]["name"] for r in document["scenes"][0]["nodes"]]
    assert names == ["box_0000", "lamp", "cylinder_0002", "wall", "half_space_0004"]


def test_equal_colours_share_a_material_and_a_part(document):
    """Six colours make six parts, one makes one; the wall's sides and rim make four."""
    parts = [m["primitives"] for m in document["meshes"]]
    assert [len(p) for p in parts] == [6, 1, 1, 4, 1]
    wall = [p["material"] for p in parts[3]]
    assert len(set(wall)) == 3 and wall[0] == wall[3]
    assert all(m["pbrMetallicRoughness"]["metallicFactor"] == 0 for m in document["materials"])
    glowing = [m for m in document["materials"] if "extensions" in m]
    assert len(glowing) == 6, "only emission above 1 needs a strength"
    assert all(max(m["emissiveFactor"]) <= 1 for m in document["materials"])
    shown = [
        np.array(m["emissiveFactor"]) * m["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"]
        for m in glowing
    ]
    np.testing.assert_array_equal(shown, every_kind().emission[0].astype(float))


def test_a_thousand_equal_boxes_share_one_mesh(tmp_path):
    row = PrimitiveSet.concatenate([make_box((i, 0, 0)) for i in range(1000)])
    export.write(row, tmp_path / "row.glb")
    document = read_container(tmp_path / "row.glb").document
    assert len(document["meshes"]) == len(document["materials"]) == 1
    assert (tmp_path / "row.glb").stat().st_size < 1_200_000


@pytest.mark.parametrize(
    ("kind", "volume"),
    [("box", 1.0), ("plane", 1.0), ("sphere", 0.984 * np.pi / 6), ("cylinder", 0.9936 * np.pi / 4)],
)
def test_unit_meshes_are_closed_and_face_outwards(kind, volume):
    unit = UNIT_MESHES[kind]
    np.testing.assert_array_equal(unit.positions.min(axis=0), [-0.5] * 3)
    np.testing.assert_array_equal(unit.positions.max(axis=0), [0.5] * 3)
    np.testing.assert_allclose(np.linalg.norm(unit.normals, axis=1), 1, atol=1e-6)
    mesh = trimesh.Trimesh(unit.positions, unit.triangles)
    assert mesh.is_watertight and mesh.volume == pytest.approx(volume, rel=1e-3)
    facing = np.sum(mesh.face_normals[:, None] * unit.normals[unit.triangles], axis=2)
    assert facing.min() > 0.9, "vertex normals agree with the winding"


@pytest.mark.parametrize("kind", ["box", "cylinder", "half_space"])
def test_unit_mesh_triangles_are_sorted_by_face(kind):
    unit = UNIT_MESHES[kind]
    for face in range(6):
        normals = unit.normals[unit.triangles[unit.starts[face] : unit.starts[face + 1]]]
        straight = kind != "cylinder" or face in (2, 3)
        if straight and len(normals):
            expected = np.zeros(3)
            expected[face // 2] = 1 - 2 * (face % 2)
            np.testing.assert_array_equal(normals.reshape(-1, 3), np.tile(expected, (normals.size // 3, 1)))
    counts = {"box": [2] * 6, "cylinder": [64, 0, 30, 30, 0, 0], "half_space": [0, 0, 2, 0, 0, 0]}
    assert np.diff(unit.starts).tolist() == counts[kind]


def test_a_viewer_shows_the_primitives_where_they_are(written):
    """trimesh, which knows nothing of us, puts every vertex on a boundary, all over it."""
    primitives = every_kind()
    scene = trimesh.load(written, force="scene").to_mesh()
    owner = np.abs(sdf.distance(primitives, scene.vertices))
    assert owner.min(axis=1).max() < 1e-5
    lower, upper = primitives.boxes()
    for i in range(4):
        own = scene.vertices[owner[:, i] < 1e-5]
        tolerance = 0.02 * primitives.sizes[i].max() if i in (1, 2) else 1e-5
        np.testing.assert_allclose(own.min(axis=0), lower[i], atol=tolerance)
        np.testing.assert_allclose(own.max(axis=0), upper[i], atol=tolerance)


def test_our_own_loader_shows_its_colours(written):
    """fit.gltf reads the file as any scene: every triangle, with the materials' colours and emission."""
    from fit import gltf

    scene = gltf.load(written)
    triangles = {"box": 12, "sphere": 960, "cylinder": 124, "plane": 12, "half_space": 2}
    assert scene.triangle_count == sum(triangles.values())
    brightest = max(max(m.emission) for m in scene.materials)
    assert brightest == pytest.approx(every_kind().emission.max(), rel=1e-6)


VALIDATE = """
const validator = require("gltf-validator");
const bytes = new Uint8Array(require("fs").readFileSync(process.argv[2]));
validator.validateBytes(bytes).then(report => console.log(JSON.stringify(report.issues)));
"""


@pytest.fixture(scope="session")
def validator(tmp_path_factory):
    """The Khronos validator as a function from a file to its messages; installed in a temporary folder."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if not node or not npm:
        pytest.skip("no node and npm: install Node.js to check our files with the Khronos validator")
    folder = tmp_path_factory.mktemp("validator")
    install = [npm, "install", "--no-audit", "--no-fund", "--prefix", folder, "gltf-validator@2.0.0-dev.3.10"]
    try:
        done = subprocess.run(install, capture_output=True, text=True, timeout=120)
    except subprocess.TimeoutExpired:
        pytest.skip("npm did not answer within two minutes, so gltf-validator could not be installed")
    if done.returncode != 0:
        pytest.skip(f"npm could not install gltf-validator (no network?): {done.stderr.strip()[-200:]}")
    (folder / "validate.js").write_text(VALIDATE)

    def validate(path: Path) -> list[dict]:
        command = [node, folder / "validate.js", path]
        result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
        return json.loads(result.stdout)["messages"]

    return validate


def test_the_khronos_validator_has_nothing_to_say(validator, written, tmp_path):
    """But that it does not know the two drafts' extensions yet."""
    export.write(PrimitiveSet.empty(), tmp_path / "empty.glb")
    assert validator(tmp_path / "empty.glb") == []
    messages = validator(written)
    assert {m["code"] for m in messages} == {"UNSUPPORTED_EXTENSION"}
    assert all(m["pointer"] in ("/extensionsUsed/0", "/extensionsUsed/1") for m in messages)


def test_the_validator_would_tell(validator, written, tmp_path):
    """It reports a broken file, so its silence above means something."""
    content = written.read_bytes().replace(b'"metallicFactor":0.0', b'"metallicFactor":7.0', 1)
    (tmp_path / "broken.glb").write_bytes(content)
    assert "VALUE_NOT_IN_RANGE" in {m["code"] for m in validator(tmp_path / "broken.glb")}
