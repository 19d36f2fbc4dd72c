"""The node graph: transforms, scenes, instancing, skins, morph targets, cameras and lights."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fit.gltf import GltfError
from fit.scene import LightKind, transform_points

QUARTER_TURN_Y = [0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)]


def world_points(scene, instance=0):
    placed = scene.instances[instance]
    return transform_points(placed.world_from_local, scene.meshes[placed.mesh].positions)


def trs(translation, quaternion, scale):
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix() * np.asarray(scale)
    matrix[:3, 3] = translation
    return matrix


def test_transforms_multiply_down_the_graph(builder, load_built):
    outer = dict(translation=[1, 2, 3], rotation=[0.5, 0.5, 0.5, 0.5], scale=[2, 3, -4])
    inner = trs([5, 6, 7], [0.1, 0.2, 0.3, 0.9], [1, -1, 0.5])
    leaf = builder.node(mesh=builder.mesh(builder.primitive()), matrix=inner.T.ravel().tolist(), name="leaf")
    builder.node(children=[leaf], name="root", **outer)
    scene = load_built(builder)
    expected = trs(*outer.values()) @ inner
    assert np.allclose(scene.instances[0].world_from_local, expected)
    assert np.allclose(scene.nodes[0].local, inner)
    assert [(node.name, node.parent) for node in scene.nodes] == [("leaf", 1), ("root", -1)]


def test_quaternions_are_made_unit_length_and_zero_ones_counted(builder, load_built):
    mesh = builder.mesh(builder.primitive())
    builder.node(mesh=mesh, rotation=[0, 10, 0, 10])
    builder.node(mesh=mesh, rotation=[0, 0, 0, 0])
    scene = load_built(builder)
    turned, unturned = (instance.world_from_local for instance in scene.instances)
    assert np.allclose(turned, trs([0, 0, 0], QUARTER_TURN_Y, [1, 1, 1]))
    assert np.allclose(unturned, np.eye(4))
    assert scene.repairs["rotations of zero length read as none"] == 1


def test_scale_multiplies_every_length(builder, load_built):
    mesh = builder.mesh(builder.primitive())
    builder.extend("KHR_lights_punctual")
    lights = [{"type": "point", "intensity": 8, "range": 5}, {"type": "directional", "intensity": 3}]
    builder.document["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    builder.add("cameras", type="orthographic", orthographic={"xmag": 4, "ymag": 2, "znear": 0, "zfar": 9})
    child = builder.node(mesh=mesh, translation=[1, 0, 0])
    builder.node(children=[child], translation=[0, 10, 0], camera=0)
    for light in range(2):
        builder.node(extensions={"KHR_lights_punctual": {"light": light}})
    plain, scaled = load_built(builder), load_built(builder, scale=0.5)
    assert np.allclose(world_points(scaled), 0.5 * world_points(plain))
    assert np.allclose(scaled.bounds()[0], (0.5, 5, 0))
    point, sun = scaled.lights
    # Half the distance under a quarter of the intensity: the same irradiance at the same corner of the scene.
    assert (point.intensity, point.range, sun.intensity) == (2, 2.5, 3)
    assert (scaled.cameras[0].ymag, scaled.cameras[0].zfar, scaled.cameras[0].aspect_ratio) == (1, 4.5, 2)


@pytest.mark.parametrize("scale", [0.0, -1.0, math.nan, math.inf])
def test_bad_scale(builder, load_built, scale):
    builder.square()
    with pytest.raises(ValueError, match="scale must be a positive number"):
        load_built(builder, scale=scale)


@pytest.mark.parametrize(
    ("scene", "scenes", "drawn"),
    [
        (1, [[0], [1]], [1]),
        (None, [[1], [0]], [1]),
        (None, None, [0, 1, 2]),
        (None, [[1, 0, 1]], [1, 0]),
    ],
)
def test_default_scene(builder, load_built, scene, scenes, drawn):
    for _ in range(3):
        builder.square()
    if scenes is not None:
        builder.document["scenes"] = [{"nodes": nodes} for nodes in scenes]
    if scene is not None:
        builder.document["scene"] = scene
    loaded = load_built(builder)
    assert [instance.node for instance in loaded.instances] == drawn
    if scenes and len(scenes) > 1:
        assert "scenes that are not the default: 1" in loaded.ignored
        assert "meshes that the scene does not draw: 2" in loaded.ignored
    if scenes == [[1, 0, 1]]:
        assert loaded.repairs["nodes listed twice in the scene"] == 1


def test_hidden_nodes_and_what_is_below_are_not_drawn(builder, load_built):
    builder.square()
    below = builder.square()
    builder.node(children=[below], extensions={"KHR_node_visibility": {"visible": False}})
    scene = load_built(builder)
    assert [instance.node for instance in scene.instances] == [0]
    assert "nodes hidden by KHR_node_visibility, with all below: 1" in scene.ignored


def test_a_mesh_drawn_twice_is_stored_once(builder, load_built):
    mesh = builder.mesh(builder.primitive())
    for x in range(3):
        builder.node(mesh=mesh, translation=[x, 0, 0])
    scene = load_built(builder)
    assert len(scene.meshes) == 1
    assert [instance.world_from_local[0, 3] for instance in scene.instances] == [0, 1, 2]


def test_gpu_instancing(builder, load_built):
    rng = np.random.default_rng(1)
    translations = rng.normal(size=(5, 3)).astype(np.float32)
    rotations = Rotation.random(5, rng).as_quat().astype(np.float32)
    stored_rotations = np.round(rotations * 32767).astype(np.int16)
    scales = rng.uniform(0.5, 2, (5, 3)).astype(np.float32)
    attributes = {
        "TRANSLATION": builder.accessor(translations),
        "ROTATION": builder.accessor(stored_rotations, normalized=True),
        "SCALE": builder.accessor(scales),
        "_ID": builder.accessor(np.arange(5, dtype=np.float32)),
    }
    node = builder.square()
    definition = builder.document["nodes"][node]
    definition |= {
        "translation": [1, 2, 3],
        "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}},
    }
    scene = load_built(builder)
    above = trs([1, 2, 3], [0, 0, 0, 1], [1, 1, 1])
    for i, instance in enumerate(scene.instances):
        expected = above @ trs(translations[i], rotations[i], scales[i])
        assert np.allclose(instance.world_from_local, expected, atol=1e-4)
    assert (len(scene.instances), len(scene.meshes)) == (5, 1)
    assert scene.ignored == ("instance attribute _ID: 1",)


def test_gpu_instancing_with_a_translation_alone(builder, load_built):
    node = builder.square()
    attributes = {"TRANSLATION": builder.accessor(np.float32([[0, 0, 1], [0, 0, 2]]))}
    builder.document["nodes"][node]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    assert [i.world_from_local[2, 3] for i in load_built(builder).instances] == [1, 2]


def test_morph_weights_of_the_node_win_over_the_mesh(builder, load_built):
    move = builder.accessor(np.tile(np.float32([0, 0, 2]), (4, 1)))
    tilt = builder.accessor(np.tile(np.float32([1, 0, 0]), (4, 1)))
    primitive = builder.primitive(
        NORMAL=np.tile(np.float32([0, 0, 1]), (4, 1)), targets=[{"POSITION": move}, {"NORMAL": tilt}]
    )
    mesh = builder.mesh(primitive, weights=[0.5, 0])
    builder.node(mesh=mesh)
    builder.node(mesh=mesh, weights=[1, 1], translation=[0, 0, 10])
    builder.node(mesh=mesh, translation=[0, 0, 20])
    scene = load_built(builder)
    assert [world_points(scene, i)[0, 2] for i in range(3)] == [1, 12, 21]
    assert np.allclose(scene.meshes[1].normals, np.array([1, 0, 1]) / np.sqrt(2))
    assert len(scene.meshes) == 2


def test_morph_without_weights_rests(builder, load_built):
    move = builder.accessor(np.ones((4, 3), np.float32))
    builder.node(mesh=builder.mesh(builder.primitive(targets=[{"POSITION": move}])))
    assert np.allclose(load_built(builder).bounds(), [[0, 0, 0], [1, 1, 0]])


def test_wrong_count_of_morph_weights(builder, load_built):
    move = builder.accessor(np.ones((4, 3), np.float32))
    builder.node(mesh=builder.mesh(builder.primitive(targets=[{"POSITION": move}])), weights=[1, 2])
    with pytest.raises(GltfError, match=r"nodes\[0\]\.weights: 2 weights for 1 morph targets"):
        load_built(builder)


def skinned_square(builder, weights, joints=None, **skin):
    """A square skinned to two joints: nodes 0 and 1."""
    builder.node(translation=[0, 0, 5], name="still")
    builder.node(translation=[2, 0, 0], rotation=QUARTER_TURN_Y, name="turned")
    joints = np.tile(np.uint8([0, 1, 0, 0]), (4, 1)) if joints is None else joints
    mesh = builder.mesh(
        builder.primitive(
            NORMAL=np.tile(np.float32([0, 0, 1]), (4, 1)), JOINTS_0=joints, WEIGHTS_0=np.float32(weights)
        )
    )
    number = builder.add("skins", joints=[0, 1], **skin)
    builder.node(mesh=mesh, skin=number, translation=[100, 100, 100])


def test_skin_follows_its_joints_and_not_its_node(builder, load_built):
    bind = np.array([trs([0, 0, -5], [0, 0, 0, 1], [1, 1, 1]), np.eye(4)], np.float32)
    inverse_bind = builder.accessor(bind.transpose(0, 2, 1).reshape(2, 16))
    weights = [[1, 0, 0, 0], [0, 2, 0, 0], [0.5, 0.5, 0, 0], [0, 0, 0, 0]]
    skinned_square(builder, weights, inverseBindMatrices=inverse_bind)
    scene = load_built(builder)
    (mesh,) = scene.meshes
    still, turned = np.eye(4), trs([2, 0, 0], QUARTER_TURN_Y, [1, 1, 1])
    corners = np.array([[0, 0, 0, 1], [1, 0, 0, 1], [1, 1, 0, 1], [0, 1, 0, 1]], float)
    expected = [m @ c for m, c in zip([still, turned, (still + turned) / 2, still], corners, strict=True)]
    assert np.allclose(mesh.positions, np.array(expected)[:, :3])
    assert np.allclose(mesh.normals[:2], [[0, 0, 1], [1, 0, 0]])
    assert np.array_equal(scene.instances[0].world_from_local, np.eye(4))
    assert scene.repairs["vertices without skin weights"] == 1


def test_mirrored_skin_keeps_its_outside(builder, load_built):
    skinned_square(builder, [[1, 0, 0, 0]] * 4)
    builder.document["nodes"][0]["scale"] = [-1, 1, 1]
    (mesh,) = load_built(builder).meshes
    a, b, c = mesh.positions[mesh.triangles[0]]
    assert np.cross(b - a, c - a)[2] > 0
    assert np.allclose(mesh.normals, (0, 0, 1))


def test_skin_names_a_joint_that_is_not_there(builder, load_built):
    skinned_square(builder, [[1, 0, 0, 0]] * 4, joints=np.full((4, 4), 7, np.uint8))
    with pytest.raises(GltfError, match=r"attributes\.JOINTS_0: a vertex names joint 7, the skin has 2"):
        load_built(builder)


def test_cycles_are_refused(builder, load_built):
    builder.square()
    builder.node(children=[2])
    builder.node(children=[1])
    with pytest.raises(GltfError, match=r"nodes\[1\]: the node is its own ancestor"):
        load_built(builder)


def test_a_deep_graph_does_not_overflow(builder, load_built):
    builder.square()
    for below in range(20_000):
        builder.node(children=[below], translation=[0, 0, 1])
    assert load_built(builder).bounds()[0][2] == 20_000


def test_shared_children_are_copied_within_bounds(builder, load_built, monkeypatch):
    below = builder.square()
    for _ in range(10):
        below = builder.node(children=[below, below], translation=[0, 0, 1])
    scene = load_built(builder)
    assert len(scene.instances) == 2**10
    assert scene.repairs["nodes with several parents copied"] == 2**11 - 1 - 11
    monkeypatch.setattr("fit.gltf.nodes.MAX_NODES", 1000)
    with pytest.raises(GltfError, match="shared children make more than 1000 nodes"):
        load_built(builder)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"scale": [1e200, 1, 1]}, "its world transform is absurdly large"),
        ({"matrix": [1.0] * 16}, "its last row must be 0 0 0 1"),
        ({"matrix": [1.0] * 15}, "must be an array of 16 finite numbers"),
        ({"rotation": [0, 0, "0", 1]}, "must be an array of 4 finite numbers"),
        ({"children": [5]}, "index 5 points past the end, there are 1 nodes"),
        ({"children": "0"}, "must be an array, not '0'"),
        ({"mesh": -1}, "index -1 points past the end"),
        ({"mesh": True}, "must be the index of one of the meshes, not True"),
    ],
)
def test_damaged_nodes(builder, load_built, entry, message):
    node = builder.square()
    builder.document["nodes"][node] |= entry
    with pytest.raises(GltfError, match=r"nodes\[0\]") as caught:
        load_built(builder)
    assert message in str(caught.value)


def test_too_many_instances(builder, load_built, monkeypatch):
    monkeypatch.setattr("fit.gltf.loader.MAX_DRAWN_TRIANGLES", 5)
    mesh = builder.mesh(builder.primitive())
    for _ in range(3):
        builder.node(mesh=mesh)
    with pytest.raises(GltfError, match=r"nodes\[2\]: the scene draws more than 5 triangles"):
        load_built(builder)


def test_lights(builder, load_built):
    builder.square()
    lights = [
        {
            "type": "spot",
            "color": [1, 0.5, 0],
            "intensity": 7,
            "spot": {"outerConeAngle": 1.0},
            "name": "lamp",
        },
        {"type": "point", "range": 4},
    ]
    builder.extend("KHR_lights_punctual", required=True)
    builder.document["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    for light in (0, 1):
        builder.node(
            translation=[0, light, 0], extensions={"KHR_lights_punctual": {"light": light}}, name="at"
        )
    spot, point = load_built(builder).lights
    assert (spot.kind, spot.name, spot.color, spot.intensity) == (LightKind.SPOT, "lamp", (1, 0.5, 0), 7)
    assert (spot.inner_cone_angle, spot.outer_cone_angle, spot.range) == (0, 1, math.inf)
    assert (point.kind, point.name, point.intensity, point.range) == (LightKind.POINT, "at", 1, 4)
    assert point.world_from_local[1, 3] == 1


def test_cameras(builder, load_built):
    builder.square()
    builder.add("cameras", type="perspective", perspective={"yfov": 0.8, "znear": 0.1}, name="wide")
    builder.add("cameras", type="orthographic", orthographic={"xmag": 3, "ymag": 2, "znear": 0, "zfar": 10})
    builder.node(camera=0, translation=[0, 0, 9])
    builder.node(camera=1, name="plan")
    wide, plan = load_built(builder).cameras
    assert (wide.name, wide.yfov, wide.aspect_ratio, wide.znear, wide.zfar) == ("wide", 0.8, None, 0.1, None)
    assert wide.world_from_local[2, 3] == 9
    assert (plan.name, plan.yfov, plan.ymag, plan.aspect_ratio, plan.zfar) == ("plan", None, 2, 1.5, 10)
