"""Accuracy against what others wrote: trimesh's reader, and the ranges that the files themselves declare."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from fit.gltf import load
from fit.gltf.container import read_document
from fit.scene import transform_points

# Files that trimesh reads right: no quantisation, sparse values, fans, GPU instances, skins or morph weights.
TRIMESH_FILES = [
    "2CylinderEngine/2CylinderEngine.gltf",
    "Bevy_CubesLights/Cubes.glb",
    "Bevy_PalmTree/PalmTree.gltf",
    "BoxInterleaved/BoxInterleaved.glb",
    "CesiumMilkTruck/CesiumMilkTruck.gltf",
    "ClearCoatTest/ClearCoatTest.gltf",
    "DuplicateMeshes/duplicate_meshes.gltf",
    "FlightHelmet/FlightHelmet.gltf",
    "Godot_LivingRoom/living_room.glb",
    "MirroredTriangle/one_face_123_mirror.gltf",
    "NestedTransforms/nested.glb",
    "NoIndices_3StoryBuilding/no_indices_3storybuilding.glb",
    "OMI_BallPit/ball_pit.gltf",
    "Physics_JointTypes/JointTypes.glb",
    "PrimitiveMode_04/Mesh_PrimitiveMode_04.gltf",
    "PrimitiveMode_14/Mesh_PrimitiveMode_14.gltf",
    "SheenChair_MixedLighting/SheenChair_MixedLighting.glb",
    "Sponza/Sponza.gltf",
    "StanfordBunny/StanfordBunny.glb",
    "TwoCubes_idx8/TwoCubes.glb",
    "WebXR_Garage/garage.gltf",
]


def find(shared_assets, name):
    """The file, or the only glTF file of its folder where it goes by another name."""
    file = shared_assets / name
    return file if file.exists() else next(p for p in file.parent.iterdir() if p.suffix in (".gltf", ".glb"))


def world_triangles(scene):
    return np.concatenate(
        [
            transform_points(i.world_from_local, scene.meshes[i.mesh].positions)[
                scene.meshes[i.mesh].triangles
            ]
            for i in scene.instances
        ]
    )


def trimesh_triangles(file):
    found = trimesh.load_scene(file, process=False)
    parts = []
    for node in found.graph.nodes_geometry:
        world, name = found.graph[node]
        part = found.geometry[name]
        parts.append(transform_points(np.asarray(world), np.asarray(part.vertices))[part.faces])
    return np.concatenate(parts)


@pytest.mark.parametrize("name", TRIMESH_FILES)
def test_positions_agree_with_trimesh(shared_assets, name):
    file = find(shared_assets, name)
    ours, theirs = world_triangles(load(file)), trimesh_triangles(file)
    assert len(ours) == len(theirs)
    size = np.ptp(theirs.reshape(-1, 3), axis=0).max()
    assert np.allclose(ours.min((0, 1)), theirs.min((0, 1)), atol=1e-6 * size)
    assert np.allclose(ours.max((0, 1)), theirs.max((0, 1)), atol=1e-6 * size)
    # The sum over all corners, weighted by position, moves when any triangle is lost, moved or turned round.
    a, b, c = np.moveaxis(ours, 1, 0)
    p, q, r = np.moveaxis(theirs, 1, 0)
    ours_moment = np.einsum("ni,nj->ij", np.cross(b - a, c - a), a + b + c)
    theirs_moment = np.einsum("ni,nj->ij", np.cross(q - p, r - p), p + q + r)
    scale = np.linalg.norm(np.cross(q - p, r - p), axis=1).sum() * np.abs(theirs).max() * 3
    assert np.abs(ours_moment - theirs_moment).max() < 1e-6 * scale
    assert np.allclose(np.sort(ours.ravel()), np.sort(theirs.ravel()), atol=1e-6 * size)


DECLARED = [
    "BoxInterleaved/BoxInterleaved.glb",
    "Duck/Duck.gltf",
    "FlightHelmet/FlightHelmet.gltf",
    "ManifoldSpace_SparseInterleaved/space.glb",
    "SimpleSparseAccessor/SimpleSparseAccessor.gltf",
    "Sponza/Sponza.gltf",
    "TextureTransformTest/TextureTransformTest.gltf",
    "TwoCubes_idx8/TwoCubes.glb",
]


@pytest.mark.parametrize("name", DECLARED)
def test_positions_fill_the_declared_range(shared_assets, name):
    """Each primitive's positions lie within its accessor's min and max, and together they reach both."""
    file = find(shared_assets, name)
    document = read_document(file)
    scene = load(file)
    by_place = {}
    for number, mesh in enumerate(document.meshes):
        primitives = mesh.objects("primitives")
        title = mesh.string("name", f"mesh {number}")
        for i, primitive in enumerate(primitives):
            accessor = document.accessors[primitive.values["attributes"]["POSITION"]].values
            by_place.setdefault(title if len(primitives) == 1 else f"{title}.{i}", []).append(accessor)
    checked = 0
    for mesh in scene.meshes:
        for accessor in by_place[mesh.name]:
            if len(by_place[mesh.name]) > 1 or "min" not in accessor:
                continue
            assert np.allclose(
                mesh.positions.min(axis=0), accessor["min"], atol=1e-5 * (1 + np.abs(accessor["min"]))
            )
            assert np.allclose(
                mesh.positions.max(axis=0), accessor["max"], atol=1e-5 * (1 + np.abs(accessor["max"]))
            )
            checked += 1
    assert checked


def test_gpu_instances_agree_with_scipy(shared_assets):
    """TeapotsGalore, read by hand: float accessors, rotations through SciPy."""
    folder = shared_assets / "TeapotsGalore_Instancing"
    document = json.loads((folder / "teapots_galore.gltf").read_text())
    buffers = [(folder / buffer["uri"]).read_bytes() for buffer in document["buffers"]]

    def read(index):
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        width = int(accessor["type"][-1])
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        values = np.frombuffer(buffers[view["buffer"]], "<f4", accessor["count"] * width, start)
        return values.reshape(-1, width).astype(float)

    scene = load(folder / "teapots_galore.gltf")
    for node in (3, 4):
        instances = [i.world_from_local for i in scene.instances if i.node == node]
        accessors = document["nodes"][node]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]
        local = np.tile(np.eye(4), (len(instances), 1, 1))
        local[:, :3, :3] = Rotation.from_quat(read(accessors["ROTATION"])).as_matrix()
        local[:, :3, :3] *= read(accessors["SCALE"])[:, None, :]
        local[:, :3, 3] = read(accessors["TRANSLATION"])
        above = np.eye(4)
        while node is not None:
            matrix = np.array(document["nodes"][node].get("matrix", np.eye(4).ravel())).reshape(4, 4).T
            above = matrix @ above
            node = next((i for i, n in enumerate(document["nodes"]) if node in n.get("children", [])), None)
        assert np.allclose(instances, above @ local, atol=1e-6)


def test_images_of_sponza_are_decoded_once(shared_assets, monkeypatch):
    decoded = []
    monkeypatch.setattr(
        "fit.gltf.images._decode", lambda image: decoded.append(image) or np.zeros((1, 1, 4), np.uint8)
    )
    scene = load(shared_assets / "Sponza" / "Sponza.gltf")
    document = json.loads((shared_assets / "Sponza" / "Sponza.gltf").read_text())
    used = set()
    for material in document["materials"]:
        rough = material["pbrMetallicRoughness"]
        used |= {
            rough[key]["index"] for key in ("baseColorTexture", "metallicRoughnessTexture") if key in rough
        }
    expected = len({document["textures"][i]["source"] for i in used})
    assert len(decoded) == len(scene.images) == expected
