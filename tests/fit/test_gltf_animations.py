"""Animations as the reader finds them: samplers, channels, and what is refused, mended or left out."""

from __future__ import annotations

import numpy as np
import pytest

from fit import motion
from fit.gltf import GltfError, load
from fit.scene import Interpolation

TIMES = np.array([0.0, 1.0], np.float32)
MOVES = np.array([[0, 0, 0], [4, 0, 0]], np.float32)


def animate(builder, *channels, **entry):
    """An animation of (node, path, times, values, interpolation) channels."""
    samplers, targets = [], []
    for node, path, times, values, interpolation in channels:
        samplers.append(
            {
                "input": builder.accessor(times),
                "output": builder.accessor(values),
                "interpolation": interpolation,
            }
        )
        targets.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": path}})
    return builder.add("animations", samplers=samplers, channels=targets, **entry)


def test_a_node_moves_and_what_is_not_animated_rests(builder, load_built):
    node = builder.node(mesh=builder.mesh(builder.primitive()), scale=[2, 2, 2], translation=[9, 9, 9])
    animate(builder, (node, "translation", TIMES, MOVES, "LINEAR"), name="slide")
    scene = load_built(builder)
    (animation,) = scene.animations
    assert (animation.name, animation.duration) == ("slide", 1.0)
    placed = motion.posed(scene, 0.5).instances[0].world_from_local
    assert np.allclose(placed, [[2, 0, 0, 2], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]])
    assert scene.ignored == ()


def test_metres_of_roots_are_scaled_with_the_scene(builder, load_built):
    child = builder.square()
    root = builder.node(children=[child])
    animate(
        builder,
        (root, "translation", TIMES, MOVES, "LINEAR"),
        (child, "translation", TIMES, MOVES, "LINEAR"),
    )
    scene = load_built(builder, scale=0.01)
    assert motion.posed(scene, 1).instances[0].world_from_local[0] == pytest.approx((0.01, 0, 0, 0.08))


def test_splines_and_normalised_integers_are_read(builder, load_built):
    node = builder.square()
    quaternions = np.array([[0, 0, 0, 127], [0, 0, 127, 0]], np.int8)
    tangents = np.array([[9, 9, 9], [0, 0, 0], [1, 2, 3], [4, 5, 6], [1, 0, 0], [9, 9, 9]], np.float32)
    animate(
        builder,
        (node, "rotation", TIMES, quaternions, "STEP"),
        (node, "scale", TIMES, tangents, "CUBICSPLINE"),
    )
    builder.document["accessors"][-3]["normalized"] = True
    (found,) = load_built(builder).animations[0].motions
    assert found.rotation.interpolation is Interpolation.STEP
    assert found.rotation.values.tolist() == [[0, 0, 0, 1], [0, 0, 1, 0]]
    assert found.scale.interpolation is Interpolation.CUBIC_SPLINE
    assert found.scale.values[1].tolist() == [[4, 5, 6], [1, 0, 0], [9, 9, 9]]


def test_keys_out_of_order_are_dropped_and_counted(builder, load_built):
    times = np.array([0, 2, 2, 1, 3], np.float32)
    node = builder.square()
    animate(builder, (node, "translation", times, np.arange(15, dtype=np.float32).reshape(5, 3), "LINEAR"))
    scene = load_built(builder)
    assert scene.animations[0].motions[0].translation.times.tolist() == [0, 2, 3]
    assert scene.repairs["animation keys that are not later than the one before"] == 2


def test_what_moves_no_node_is_named(builder, load_built):
    node = builder.square()
    fixed = builder.node(matrix=np.eye(4).ravel().tolist())
    animate(
        builder,
        (node, "weights", TIMES, TIMES, "LINEAR"),
        (fixed, "translation", TIMES, MOVES, "LINEAR"),
    )
    scene = load_built(builder)
    assert scene.animations == ()
    assert scene.ignored == (
        "animated morph weights, which keep their rest: 1",
        "animations of nodes that have a matrix, which glTF forbids: 1",
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda a: a["samplers"][0].update(output=0),
            r"samplers\[0\]\.output: has 1 values, not 2 for 2 keys",
        ),
        (
            lambda a: a["samplers"][0].update(interpolation="BEZIER"),
            r"samplers\[0\]\.interpolation: 'BEZIER' is not one of STEP",
        ),
        (lambda a: a["samplers"][0].update(input=99), r"samplers\[0\]\.input: index 99 points past the end"),
        (
            lambda a: a["channels"][0].update(sampler=5),
            r"channels\[0\]\.sampler: index 5 points past the end",
        ),
        (
            lambda a: a["channels"][0]["target"].update(path="colour"),
            r"channels\[0\]\.target\.path: 'colour' is not one of",
        ),
        (lambda a: a["channels"][0].pop("target"), r"channels\[0\]\.target: required but missing"),
        (lambda a: a["samplers"][0].update(input=1), r"samplers\[0\]\.input: holds NaN or infinity"),
    ],
)
def test_damage_is_named_by_its_place(builder, load_built, change, message):
    builder.accessor(np.zeros((1, 3), np.float32))
    builder.accessor(np.array([0, np.inf], np.float32))
    animate(builder, (builder.square(), "translation", TIMES, MOVES, "LINEAR"))
    change(builder.document["animations"][0])
    with pytest.raises(GltfError, match=rf"built\.glb: animations\[0\]\.{message}"):
        load_built(builder)


def test_a_trucks_wheels_turn_about_their_axle(shared_assets):
    scene = load(shared_assets / "CesiumMilkTruck" / "CesiumMilkTruck.gltf")
    of_node = motion.movers(scene)
    wheels = [i for i, one in enumerate(scene.instances) if of_node[one.node] >= 0]
    assert [scene.nodes[scene.instances[i].node].name for i in wheels] == ["node 4", "node 2"]
    later = motion.posed(scene, 0.3 * motion.duration(scene))
    for i in wheels:
        rest, turned = scene.instances[i].world_from_local, later.instances[i].world_from_local
        assert np.allclose(rest[:3, 3], turned[:3, 3])
        assert np.abs(rest - turned).max() > 0.5
