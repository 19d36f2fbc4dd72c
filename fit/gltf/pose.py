"""Morph targets and skins in the pose of the node graph (glTF 2.0, sections 3.7.2.2 and 3.7.3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.gltf.errors import GltfError
from fit.gltf.notes import Notes
from fit.gltf.primitives import Primitive
from fit.scene import normal_matrix

Float64 = NDArray[np.float64]


def morph(primitive: Primitive, weights: tuple[float, ...]) -> Primitive:
    """The primitive with its targets mixed in by `weights`, one for each target."""
    moved = {"POSITION": primitive.positions.copy()}
    if primitive.normals is not None:
        moved["NORMAL"] = primitive.normals.copy()
    if primitive.colors is not None:
        moved["COLOR_0"] = primitive.colors.copy()
    moved |= {f"TEXCOORD_{i}": values.copy() for i, values in enumerate(primitive.texcoords)}
    for target, weight in zip(primitive.targets, weights, strict=True):
        for name, delta in target.items():
            moved[name][:, : delta.shape[1]] += weight * delta
    return replace(
        primitive,
        positions=moved["POSITION"],
        normals=moved.get("NORMAL"),
        colors=np.clip(moved["COLOR_0"], 0.0, 1.0) if "COLOR_0" in moved else None,
        texcoords=tuple(moved[f"TEXCOORD_{i}"] for i in range(len(primitive.texcoords))),
        targets=(),
    )


def skin(file: str, primitive: Primitive, joint_matrices: Float64, notes: Notes) -> Primitive:
    """The primitive in world space: each vertex through the weighted mean of its joints' matrices.

    Args:
        joint_matrices: (j, 4, 4), the joint's world matrix times its inverse bind matrix.

    Raises:
        GltfError: a vertex names a joint that the skin doesn't have.
    """
    assert primitive.joints is not None and primitive.weights is not None
    joints, weights = primitive.joints, _unit_weights(primitive.weights, notes)
    used = weights > 0
    if np.any((joints < 0) | (joints >= len(joint_matrices)), where=used):
        what = f"a vertex names joint {joints[used].max()}, the skin has {len(joint_matrices)} joints"
        raise GltfError(file, f"{primitive.place}.attributes.JOINTS_0", f"{what}; export the file again")
    blend = np.zeros((len(weights), 4, 4))
    for influence in range(joints.shape[1]):
        joint = np.where(used[:, influence], joints[:, influence], 0)
        blend += weights[:, influence, None, None] * joint_matrices[joint]
    positions = np.einsum("nij,nj->ni", blend[:, :3, :3], primitive.positions) + blend[:, :3, 3]
    normals = None
    if primitive.normals is not None:
        normals = np.einsum("nij,nj->ni", normal_matrix(blend[:, :3, :3]), primitive.normals)
    triangles = primitive.triangles.copy()
    mirrored = np.linalg.det(blend[:, :3, :3])[triangles].sum(axis=1) < 0
    triangles[mirrored] = triangles[mirrored][:, ::-1]
    return replace(
        primitive, positions=positions, normals=normals, triangles=triangles, joints=None, weights=None
    )


def _unit_weights(weights: Float64, notes: Notes) -> Float64:
    """Weights that add up to 1; a vertex without any follows its first joint."""
    clean = np.where(np.isfinite(weights) & (weights > 0), weights, 0.0)
    total = clean.sum(axis=1)
    lost = total <= 0
    notes.repair("vertices without skin weights", int(np.count_nonzero(lost)))
    clean[lost, 0] = 1.0
    return clean / np.where(lost, 1.0, total)[:, None]
