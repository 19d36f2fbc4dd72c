"""Each hard file of the shared assets loads with the right triangles, or fails with a named error."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from fit.gltf import GltfError, load

# An integer is the number of triangles drawn, a text is part of the error.
HARD_CASES: dict[str, int | str] = {
    "ACMEBox_UnknownExt": "extensionsRequired[0]: the file requires the unknown extension ACME_gizmo",
    "AnimatedMorphCube": 12,
    "BadArray": "meshes[0].primitives: must be an array",
    "BadNumber": "materials[0].normalTexture.scale: must be a finite number, not 'not a number'",
    "BadObject": "materials[0].pbrMetallicRoughness: must be an object",
    "Bevy_CubesLights": 36,
    "Bevy_PalmTree": 10124,
    "BoxBadNormals": 12,
    "BoxInterleaved": 12,
    "BoxMeshopt_glb": "EXT_meshopt_compression is not supported; convert the file with `npx",
    "BoxNotManifold": 12,
    "BoxTexcoords": 12,
    "BoxWithInfinites": "meshes[0].primitives[0].attributes.POSITION: every position is NaN or infinite",
    "Box_Draco": 12,
    "BustedSTL": 3878,
    "ClearCoatTest": 37116,
    "CrayLeft": 576,
    "CubeScaledInstances": 48,
    "DegenerateFaces": 4,
    "DenseSphere_DracoQuantized": 30720,
    "DuplicateMeshes": 1568,
    "EmptyNodes": "the scene draws no triangle",
    "EmptySTL": "is not a glTF file but .stl; convert it first",
    "GLTF1_BoxTextured": "asset.version: glTF version 1.0 is not supported",
    "HullBody": 5460,
    "IndexOutOfRange": "meshes[0].primitives[0].indices: index 255 in accessors[0] points past the 24",
    "InfNanOBJ": "is not a glTF file but .obj; convert it first",
    "LightmapRoom_NoIndex": 78,
    "LightsPunctualSample": 1724,
    "ManifoldPerf": 34496,
    "ManifoldSpace_SparseInterleaved": 12,
    "MirroredTriangle": 1,
    "MissingBin": "buffers[0].uri: 'BoxTextured0.bin' is missing",
    "MorphPrimitivesTest": 32,
    "MultiUVTest": 12,
    "MultipleTetrahedrons": 20,
    "NestedTransforms": 36,
    "NoIndices_3StoryBuilding": 72,
    "NoScene": "the scene draws no triangle",
    "NonManifoldWrap": 12,
    "NotConvex": 96,
    "OMI_BallPit": 21168,
    "OMI_ShapeOnly_Box": "the scene draws no triangle (it holds extension OMI_physics_body: 2",
    "OMI_SwingAndSlide": 7692,
    "Offset2": 1116,
    "OpenSCADNonManifold": 1442,
    "Physics_ColliderMatrix_00": 160,
    "Physics_ColliderMatrix_08": 350,
    "Physics_ColliderMatrix_16": 342,
    "Physics_ColliderMatrix_24": 84,
    "Physics_ColliderMatrix_32": 342,
    "Physics_Filtering": 232,
    "Physics_Friction": 8901,
    "Physics_JointTypes": 240,
    "Physics_ShapeTypes": 8120,
    "PointCloudOnly": "the scene draws no triangle (it holds POINTS primitives: 2",
    "PrimitiveMode_00": "the scene draws no triangle (it holds POINTS primitives: 1",
    "PrimitiveMode_02": "the scene draws no triangle (it holds LINE_LOOP primitives: 1",
    "PrimitiveMode_04": 2,
    "PrimitiveMode_06": 2,
    "PrimitiveMode_08": "the scene draws no triangle (it holds LINES primitives: 1",
    "PrimitiveMode_10": "the scene draws no triangle (it holds LINE_STRIP primitives: 1",
    "PrimitiveMode_12": 2,
    "PrimitiveMode_14": 2,
    "RecursiveNodes": "nodes[0]: the node is its own ancestor",
    "SelfIntersectA": 17160,
    "SimpleSkin": 8,
    "SimpleSparseAccessor": 12,
    "SoupSTL": 100,
    "SphereWithCircleTexture": 1280,
    "StanfordBunny_meshopt": "EXT_meshopt_compression is not supported",
    "TeapotsGalore_Instancing": 7656770,
    "TestNM": 170,
    "TestScene_MaterialsCommon": 1096,
    "TextureTransformTest": 24,
    "ThreeMeshesOneNoMaterial": 36,
    "TwoCubes_idx8": 24,
    "UnicodeFilename": 2,
    "VertexColorTest": 36,
}


@pytest.fixture(scope="module")
def manifest(shared_assets) -> dict[str, dict[str, str]]:
    with (shared_assets / "MANIFEST.csv").open(newline="", encoding="utf-8") as stream:
        return {row["name"]: row for row in csv.DictReader(stream)}


def test_the_table_names_every_hard_case(manifest):
    assert sorted(HARD_CASES) == sorted(name for name, row in manifest.items() if row["category"] == "hard")


@pytest.mark.parametrize("name", HARD_CASES)
def test_hard_case(name, manifest, shared_assets):
    file = shared_assets / name / manifest[name]["primary_file"]
    expected = HARD_CASES[name]
    if isinstance(expected, str):
        with pytest.raises(GltfError) as caught:
            load(file)
        assert expected in str(caught.value)
        assert str(caught.value).startswith(f"{file}: ")
        return
    scene = load(file)
    assert scene.triangle_count == expected == int(manifest[name]["triangles_drawn"])
    for mesh in scene.meshes:
        assert np.isfinite(mesh.positions).all()
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1.0)
        assert mesh.triangles.max() < len(mesh.positions) == len(mesh.normals)


# The manifest leaves morph weights, skins, sparse values, shared nodes, instances' scales and two files out.
BOUNDS_BEYOND_MANIFEST = {
    "CubeScaledInstances": ([-2, 0, 0], [4, 6, 4]),
    "MorphPrimitivesTest": ([-0.5, 0, -0.5], [0.5, 0.1, 0.5]),
    "PrimitiveMode_12": ([-0.5, -0.5, 0], [0.5, 0.5, 0]),
    "SimpleSkin": ([-0.5, 0, 0], [0.5, 2, 0]),
    "SimpleSparseAccessor": ([0, 0, 0], [6, 4, 0]),
    "TeapotsGalore_Instancing": ([-339.4113, 0, -339.4113], [339.4113, 13.2981, 339.4113]),
    "UnicodeFilename": ([0, 0, 0], [1, 1, 0]),
}


@pytest.mark.parametrize("name", [name for name, expected in HARD_CASES.items() if isinstance(expected, int)])
def test_bounds(name, manifest, shared_assets):
    row = manifest[name]
    if name in BOUNDS_BEYOND_MANIFEST:
        expected = BOUNDS_BEYOND_MANIFEST[name]
    else:
        expected = tuple([float(value) for value in row[key].split()] for key in ("bounds_min", "bounds_max"))
    assert np.allclose(load(shared_assets / name / row["primary_file"]).bounds(), expected, atol=1e-4)


def test_gpu_instances_stay_one_mesh(shared_assets):
    scene = load(shared_assets / "TeapotsGalore_Instancing" / "teapots_galore.gltf")
    assert (len(scene.meshes), len(scene.instances)) == (2, 958 + 941 + 1)


def test_rest_of_the_assets_loads(manifest, shared_assets):
    """Every object and scene has the manifest's triangles, but for two compressed files and one .obj."""
    refused = {}
    for name, row in manifest.items():
        if row["category"] == "hard":
            continue
        try:
            count = load(shared_assets / name / row["primary_file"]).triangle_count
        except GltfError as error:
            refused[name] = str(error)
        else:
            assert count == int(row["triangles_drawn"]), name
    assert sorted(refused) == ["Ingenuity", "JapaneseBridgeGarden", "TM_WallHole"]
    assert "npx @gltf-transform/cli copy" in refused["Ingenuity"]
    assert "trimesh" in refused["TM_WallHole"]
