"""Where a scene's nodes are at a time, and with them its meshes, lights, cameras and primitives.

Curves are glTF's (2.0, section 3.11 and appendix C). All animations of a scene play at once, from 0 seconds
on; where two move one node, the later has it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from fit.primitives import PLANE_THICKNESS_LIMIT, Kind, PrimitiveSet
from fit.rotation import matrices_from_quaternions, quaternions_from_matrices
from fit.scene import Animation, Camera, Curve, Float64, Interpolation, Light, Motion, Scene

Int64 = NDArray[np.int64]
Carried = TypeVar("Carried", Light, Camera)

LEAST_SIZE = 1e-9
"""Metres: what an animation makes smaller is gone."""

LARGEST_CONDITION = 1e12
"""Of a node's matrix at rest: above it the node is flat, and its inverse noise."""

NEARLY_PARALLEL = 1 - 1e-9
"""Cosine of half the angle between two quaternions, above which a straight line is a slerp."""


def duration(scene: Scene) -> float:
    """Seconds until the last key of all animations; 0 where nothing moves."""
    return max((animation.duration for animation in scene.animations), default=0.0)


def value_at(curve: Curve, seconds: float, *, turns: bool = False) -> Float64:
    """The curve's value (n,) at a time; of a rotation (`turns`), a unit quaternion xyzw.

    STEP, LINEAR (`turns`: slerp along the shorter arc) and CUBICSPLINE (Hermite, tangents a second) as in
    appendix C.
    """
    times, values = curve.times, curve.values
    is_spline = curve.interpolation is Interpolation.CUBIC_SPLINE
    keys = values[:, 1] if is_spline else values
    before = int(np.searchsorted(times, seconds, side="right")) - 1
    if before < 0 or before >= len(times) - 1 or curve.interpolation is Interpolation.STEP:
        value = keys[max(before, 0)]
    else:
        span = float(times[before + 1] - times[before])
        t = (seconds - float(times[before])) / span
        if is_spline:
            value = _hermite(
                keys[before], span * values[before, 2], keys[before + 1], span * values[before + 1, 0], t
            )
        elif turns:
            value = _slerp(keys[before], keys[before + 1], t)
        else:
            value = (1 - t) * keys[before] + t * keys[before + 1]
    return value / np.linalg.norm(value) if turns else value


def _hermite(start: Float64, leave: Float64, end: Float64, arrive: Float64, t: float) -> Float64:
    return (
        (2 * t**3 - 3 * t**2 + 1) * start
        + (t**3 - 2 * t**2 + t) * leave
        + (3 * t**2 - 2 * t**3) * end
        + (t**3 - t**2) * arrive
    )


def _slerp(start: Float64, end: Float64, t: float) -> Float64:
    cosine = float(start @ end)
    end, cosine = (-end, -cosine) if cosine < 0 else (end, cosine)
    if cosine > NEARLY_PARALLEL:
        return (1 - t) * start + t * end
    angle = np.arccos(cosine)
    blend: Float64 = (np.sin((1 - t) * angle) * start + np.sin(t * angle) * end) / np.sin(angle)
    return blend


def local_matrix(motion: Motion, seconds: float) -> Float64:
    """parent_from_node (4, 4) of a node at a time."""
    matrix = np.eye(4)
    turn = matrices_from_quaternions(value_at(motion.rotation, seconds, turns=True))
    matrix[:3, :3] = turn * value_at(motion.scale, seconds)
    matrix[:3, 3] = value_at(motion.translation, seconds)
    return matrix


def node_matrices(scene: Scene, seconds: float) -> Float64:
    """world_from_local (n, 4, 4) of every node at a time."""
    world = np.array([node.world_from_local for node in scene.nodes]).reshape(-1, 4, 4)
    motions = _motions(scene.animations)
    for node in _downwards(scene):
        above = scene.nodes[node].parent
        local = local_matrix(motions[node], seconds) if node in motions else scene.nodes[node].local
        world[node] = world[above] @ local if above >= 0 else local
    return world


def movers(scene: Scene) -> Int64:
    """For each node the nearest of it and its ancestors that an animation moves, (n,); -1 where none does.

    Nodes with the same one move as one body.
    """
    motions = _motions(scene.animations)
    nearest = np.full(len(scene.nodes), -1, np.int64)
    for node in _downwards(scene):
        above = scene.nodes[node].parent
        nearest[node] = node if node in motions else nearest[above]
    return nearest


def posed(scene: Scene, seconds: float) -> Scene:
    """The scene at a time: nodes, meshes, lights and cameras moved. Skins and morph targets stay at rest."""
    if not scene.animations:
        return scene
    world = node_matrices(scene, seconds)
    motions = _motions(scene.animations)
    nodes = [replace(node, world_from_local=world[i]) for i, node in enumerate(scene.nodes)]
    for i, motion in motions.items():
        nodes[i] = replace(nodes[i], local=local_matrix(motion, seconds))
    return replace(
        scene,
        nodes=tuple(nodes),
        instances=tuple(
            one
            if one.node_from_local is None
            else replace(one, world_from_local=world[one.node] @ one.node_from_local)
            for one in scene.instances
        ),
        lights=tuple(_carried(one, world) for one in scene.lights),
        cameras=tuple(_carried(one, world) for one in scene.cameras),
    )


def posed_primitives(primitives: PrimitiveSet, scene: Scene, seconds: float) -> PrimitiveSet:
    """The set at a time: each primitive moved as its node has moved since the scene's rest.

    A node that is scaled to nothing takes its primitives out of the set.

    Raises:
        ValueError: a primitive belongs to a node that the scene does not have, or that has no size at rest.
    """
    if not primitives.nodes:
        return primitives
    nodes = np.array(primitives.nodes)
    if nodes.max() >= len(scene.nodes):
        raise ValueError(
            f"a primitive belongs to node {nodes.max()}, {scene.source} has {len(scene.nodes)} nodes: "
            "convert the scene again"
        )
    rest = np.array([node.world_from_local for node in scene.nodes])
    moves = np.repeat(np.eye(4)[None], len(primitives), axis=0)
    now = node_matrices(scene, seconds)
    for node in np.unique(nodes[nodes >= 0]):
        if np.linalg.cond(rest[node]) > LARGEST_CONDITION:
            raise ValueError(
                f"{scene.source}: node {node} ({scene.nodes[node].name!r}) has no size at rest, so its "
                "primitives can't follow it; give it a scale"
            )
        moves[nodes == node] = now[node] @ np.linalg.inv(rest[node])
    return moved(primitives, moves)


def moved(primitives: PrimitiveSet, matrices: Float64) -> PrimitiveSet:
    """Each primitive through an affine matrix of its own, (n, 4, 4); what is left without size is dropped.

    Primitives can't shear. Each takes the rotation nearest to what the matrix makes of its axes, and along
    each axis the length that it makes of it; round ones, which must stay even, take the mean. A plane that
    grows too thick for one becomes a box. What the identity moves keeps its last bit.
    """
    rows = np.flatnonzero((matrices != np.eye(4)).any(axis=(1, 2)))
    one = primitives.select(rows)
    linear = matrices[rows, :3, :3] @ one.rotation_matrices()
    stretch = np.linalg.norm(linear, axis=1)
    for kind, axes in ((Kind.SPHERE, [0, 1, 2]), (Kind.CYLINDER, [0, 2])):
        same = np.flatnonzero(one.kinds == kind)[:, None]
        stretch[same, axes] = stretch[same, axes].mean(axis=1, keepdims=True)
    stretch[one.is_half_space] = 1.0
    left, _, right = np.linalg.svd(linear)
    turns = left @ right
    mirrored = np.linalg.det(turns) < 0
    turns[mirrored, :, 0] *= -1  # a mirrored solid is the solid with the faces of one axis swapped
    faces = np.where(mirrored[:, None], [1, 0, 2, 3, 4, 5], [0, 1, 2, 3, 4, 5])[..., None]
    sizes = one.sizes * stretch
    thick = (one.kinds == Kind.PLANE) & (sizes[:, 1] > PLANE_THICKNESS_LIMIT * sizes[:, [0, 2]].min(axis=1))
    place = np.einsum("nij,nj->ni", matrices[rows, :3, :3], one.positions) + matrices[rows, :3, 3]
    now = {
        "kinds": np.where(thick, Kind.BOX, one.kinds).astype(np.uint8),
        "positions": place,
        "rotations": quaternions_from_matrices(turns),
        "sizes": sizes,
        "albedo": np.take_along_axis(one.albedo, faces, axis=1),
        "emission": np.take_along_axis(one.emission, faces, axis=1),
    }
    arrays = {name: getattr(primitives, name).copy() for name in now}
    for name, values in now.items():
        arrays[name][rows] = values
    result = replace(primitives, **arrays)
    return result.select((result.sizes > LEAST_SIZE).all(axis=1) | result.is_half_space)


def _carried(one: Carried, world: Float64) -> Carried:
    """A light or camera where its node is."""
    return replace(one, world_from_local=world[one.node]) if one.node >= 0 else one


def _motions(animations: Sequence[Animation]) -> dict[int, Motion]:
    return {motion.node: motion for animation in animations for motion in animation.motions}


def _downwards(scene: Scene) -> list[int]:
    """Nodes that are moved, and all below them, parents before children."""
    moved = _motions(scene.animations).keys()
    below: dict[int, list[int]] = {}
    for i, node in enumerate(scene.nodes):
        below.setdefault(node.parent, []).append(i)
    waiting = [i for i in sorted(moved, reverse=True) if not _hangs_below(scene, i, moved)]
    order: list[int] = []
    while waiting:
        order.append(waiting.pop())
        waiting.extend(reversed(below.get(order[-1], [])))
    return order


def _hangs_below(scene: Scene, node: int, nodes: Collection[int]) -> bool:
    """Whether one of `nodes` is an ancestor of `node`."""
    above = scene.nodes[node].parent
    while above >= 0 and above not in nodes:
        above = scene.nodes[above].parent
    return above >= 0
