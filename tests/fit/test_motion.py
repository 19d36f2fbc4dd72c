"""Curves, chains of nodes that move, and primitives that move with them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from fit import export, motion
from fit.primitives import (
    Kind,
    PrimitiveSet,
    make_box,
    make_cylinder,
    make_half_space,
    make_plane,
    make_sphere,
)
from fit.scene import Animation, Curve, Instance, Interpolation, Motion, Node, Scene

EYE = np.eye(4)


def constant(*values):
    return Curve(np.zeros(1), np.array([values], float))


def still(node, **curves):
    rest = {"translation": constant(0, 0, 0), "rotation": constant(0, 0, 0, 1), "scale": constant(1, 1, 1)}
    return Motion(node, **(rest | curves))


def line(*values, times=(0.0, 2.0)):
    return Curve(np.array(times), np.array(values, float))


def scene_of(nodes, motions, instances=()):
    return Scene(
        Path("made.glb"), nodes=nodes, animations=(Animation("all", motions),), instances=tuple(instances)
    )


def test_linear_and_step_curves_hold_their_ends():
    curve = line((0, 0), (4, 8), times=(1, 3))
    for seconds, expected in ((0, (0, 0)), (1, (0, 0)), (2, (2, 4)), (3, (4, 8)), (9, (4, 8))):
        assert np.allclose(motion.value_at(curve, seconds), expected)
    step = replace(curve, interpolation=Interpolation.STEP)
    assert motion.value_at(step, 2.999).tolist() == [0, 0]
    assert motion.value_at(step, 3).tolist() == [4, 8]


def test_rotations_follow_the_shorter_arc():
    keys = Rotation.from_rotvec([[0, 0, 0], [0.3, 1.2, -0.4], [0.1, -2.0, 0.5]])
    quaternions = keys.as_quat()
    quaternions[1] *= -1  # the same rotation, the long way round
    curve = Curve(np.array([0.0, 1.0, 4.0]), quaternions)
    truth = Slerp(curve.times, keys)
    for seconds in np.linspace(0, 4, 23):
        found = Rotation.from_quat(motion.value_at(curve, seconds, turns=True))
        assert (found.inv() * truth(seconds)).magnitude() < 1e-9


def test_splines_are_hermite():
    rng = np.random.default_rng(1)
    times = np.array([0.5, 1.0, 3.0])
    values = rng.normal(size=(3, 3, 3))
    values[:, 0] = values[:, 2]  # one tangent at each key, as SciPy has it
    truth = CubicHermiteSpline(times, values[:, 1], values[:, 2])
    curve = Curve(times, values, Interpolation.CUBIC_SPLINE)
    for seconds in np.linspace(0.5, 3.0, 17):
        assert np.allclose(motion.value_at(curve, seconds), truth(seconds))
    assert np.allclose(motion.value_at(curve, 99), values[2, 1])


def test_a_childs_motion_comes_on_top_of_its_parents_even_if_it_is_listed_first():
    offset = EYE.copy()
    offset[:3, 3] = (0, 0, 5)
    nodes = (Node("leaf", 1, offset, offset), Node("arm", 2, EYE, EYE), Node("root", -1, EYE, EYE))
    quarter = Rotation.from_rotvec([0, np.pi / 2, 0]).as_quat()
    scene = scene_of(
        nodes,
        (still(2, translation=line((0, 0, 0), (2, 0, 0))), still(1, rotation=line((0, 0, 0, 1), quarter))),
    )
    assert motion.movers(scene).tolist() == [1, 1, 2]
    assert motion.node_matrices(scene, 2)[0][:3, 3] == pytest.approx((2 + 5, 0, 0))
    assert motion.posed(scene, 1).nodes[0].world_from_local[:3, 3] == pytest.approx(
        (1 + 5 * np.sqrt(0.5), 0, 5 * np.sqrt(0.5))
    )


def test_a_posed_scene_moves_instances_but_no_skins():
    copy = EYE.copy()
    copy[:3, 3] = (0, 1, 0)
    scene = scene_of(
        (Node("n", -1, EYE, EYE),),
        (still(0, translation=line((0, 0, 0), (2, 0, 0))),),
        (Instance(0, 0, copy, copy), Instance(0, 0, EYE, None)),
    )
    followed, skinned = motion.posed(scene, 2).instances
    assert followed.world_from_local[:3, 3].tolist() == [2, 1, 0]
    assert np.array_equal(skinned.world_from_local, EYE)


def test_each_primitive_moves_with_its_own_node():
    turned = EYE.copy()
    turned[:3, :3] = Rotation.from_rotvec([0.2, 0.3, 0.1]).as_matrix() * 2
    turned[:3, 3] = (3, 0, 0)
    nodes = (Node("stands", -1, EYE, EYE), Node("moves", -1, turned, turned))
    later = Rotation.from_rotvec([0, 0, 1.0])
    scene = scene_of(nodes, (still(1, rotation=constant(*later.as_quat()), scale=constant(4, 4, 4)),))
    ball = make_sphere((3, 1, 0), 0.5)
    box = make_box((0.1, 0.2, 0.3), (1, 2, 3), (0.1, 0.2, 0.3, np.sqrt(1 - 0.14)))
    given = replace(PrimitiveSet.concatenate([box, ball]), nodes=(-1, 1))
    now = motion.posed_primitives(given, scene, 0).validate()
    assert np.array_equal(now.positions[0], box.positions[0]) and np.array_equal(
        now.rotations[0], box.rotations[0]
    )
    local = np.linalg.inv(turned) @ (3, 1, 0, 1)
    assert now.positions[1] == pytest.approx(later.apply(4 * local[:3]))
    assert now.sizes[1] == pytest.approx((2, 2, 2))


def test_uneven_scales_stretch_what_can_be_stretched():
    scale = np.diag([2.0, 1.0, 1.0, 1.0])
    parts = [
        make_box(size=(1, 1, 1)),
        make_sphere(radius=0.5),
        make_cylinder(radius=0.5, height=1),
        make_plane(size_x=1, size_z=1, thickness=0.04),
        make_half_space(),
    ]
    parts = PrimitiveSet.concatenate(parts)
    stretched = motion.moved(parts, np.repeat(scale[None], 5, axis=0)).validate()
    assert stretched.sizes[0] == pytest.approx((2, 1, 1))
    assert stretched.sizes[1] == pytest.approx((4 / 3,) * 3)
    assert stretched.sizes[2] == pytest.approx((1.5, 1, 1.5))
    assert np.isinf(stretched.sizes[4, 0])
    upright = motion.moved(parts, np.repeat(np.diag([1.0, 2.0, 1.0, 1.0])[None], 5, axis=0)).validate()
    assert upright.kinds[3] == Kind.BOX


def test_a_mirror_swaps_faces_and_nothing_remains_of_what_is_scaled_to_nothing():
    colors = np.linspace(0, 1, 18).reshape(6, 3)
    box = make_box((1, 0, 0), albedo=colors)
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    seen = motion.moved(box, mirror[None])
    # The face that looks along +x in the world was the one that looked along -x.
    looks = seen.rotation_matrices()[0][:, 0] * [1, 0, 0]
    face = 0 if looks[0] > 0 else 1
    assert np.allclose(seen.albedo[0, face], colors[1])
    assert len(motion.moved(box, np.diag([0.0, 0.0, 0.0, 1.0])[None])) == 0


@pytest.mark.parametrize("suffix", [".npz", ".glb"])
def test_files_keep_which_node_a_primitive_moves_with(tmp_path, suffix):
    parts = [make_box((k, 0, 0), name=f"part {k}") for k in range(4)]
    given = replace(PrimitiveSet.concatenate(parts), nodes=(7, -1, 12345, 7))
    export.write(given, tmp_path / f"set{suffix}")
    read = export.read(tmp_path / f"set{suffix}")
    assert read.nodes == (7, -1, 12345, 7)
    assert np.array_equal(read.positions, given.positions) and read.names == given.names


def test_a_set_for_another_scene_is_refused():
    scene = scene_of((Node("only", -1, EYE, EYE),), (still(0),))
    with pytest.raises(ValueError, match=r"node 3, made\.glb has 1 nodes: convert the scene again"):
        motion.posed_primitives(replace(make_box(), nodes=(3,)), scene, 0)
    with pytest.raises(ValueError, match="2 nodes for 1 primitives"):
        replace(make_box(), nodes=(1, 2)).validate()
