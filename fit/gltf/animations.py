"""Animations -> curves of the nodes' translations, rotations and scales (glTF 2.0, section 3.11)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fit.gltf.accessors import Accessors
from fit.gltf.container import Document
from fit.gltf.json_object import JsonObject
from fit.gltf.nodes import NodeGraph, rest_transform
from fit.gltf.notes import Notes
from fit.scene import Animation, Curve, Float64, Interpolation, Motion

INTERPOLATIONS = {each.value: each for each in Interpolation}
TYPES = {"translation": "VEC3", "rotation": "VEC4", "scale": "VEC3"}
"""The paths that move nodes, and the type of their values."""

POINTER_PATH = "pointer"


def read_animations(
    document: Document, graph: NodeGraph, accessors: Accessors, scale: float, notes: Notes
) -> tuple[Animation, ...]:
    """Every animation that moves a node; `scale` multiplies what moves roots, as `read_nodes` has it.

    Morph weights, and what KHR_animation_pointer animates, stay as they are, and so do skins; notes say so.

    Raises:
        GltfError: a channel or sampler that is damaged.
    """
    joints = {
        joint for skin in document.skins for joint in skin.references("joints", len(document.nodes), "nodes")
    }
    found = []
    for number, definition in enumerate(document.root.objects("animations")):
        curves = _read_channels(document, definition, accessors, notes)
        motions = [
            _motion(document, graph, node, curves[graph.definitions[node]], scale)
            for node in range(len(graph.nodes))
            if graph.definitions[node] in curves
        ]
        notes.ignore("animated joints, whose skins keep their pose", len(joints & curves.keys()))
        if motions:
            found.append(Animation(definition.string("name", f"animation {number}"), tuple(motions)))
    return tuple(found)


def _read_channels(
    document: Document, animation: JsonObject, accessors: Accessors, notes: Notes
) -> dict[int, dict[str, Curve]]:
    """Curves by the file's node and by path."""
    samplers = animation.objects("samplers")
    curves: dict[int, dict[str, Curve]] = {}
    for channel in animation.objects("channels"):
        sampler = samplers[channel.required_reference("sampler", len(samplers), "samplers")]
        target = channel.object("target")
        if target is None:
            raise channel.error("required but missing", "target")
        path = target.string("path")
        node = target.reference("node", len(document.nodes), "nodes")
        if path == "weights":
            notes.ignore("animated morph weights, which keep their rest")
        elif path == POINTER_PATH or node is None:
            notes.ignore("animated properties that are not a node's place")
        elif path not in TYPES:
            raise target.error(
                f"{path!r} is not one of {', '.join((*TYPES, 'weights', POINTER_PATH))}", "path"
            )
        elif "matrix" in document.nodes[node].values:
            notes.ignore("animations of nodes that have a matrix, which glTF forbids")
        else:
            curve = _read_curve(sampler, TYPES[path], accessors, notes)
            notes.repair(
                "animation channels of one target, the last taken", int(path in curves.get(node, {}))
            )
            curves.setdefault(node, {})[path] = curve
    return curves


def _read_curve(sampler: JsonObject, kind: str, accessors: Accessors, notes: Notes) -> Curve:
    interpolation: Interpolation = sampler.choice("interpolation", INTERPOLATIONS, Interpolation.LINEAR.value)
    size = len(accessors.document.accessors)
    times = accessors.floats(sampler.required_reference("input", size, "accessors"), "SCALAR")
    values = accessors.floats(sampler.required_reference("output", size, "accessors"), kind)
    if len(times) == 0:
        raise sampler.error("has no key; export the file again", "input")
    parts = 3 if interpolation is Interpolation.CUBIC_SPLINE else 1
    if len(values) != parts * len(times):
        wanted = f"{parts * len(times)} for {len(times)} keys of {interpolation}"
        raise sampler.error(f"has {len(values)} values, not {wanted}; export the file again", "output")
    for key, numbers in (("input", times), ("output", values)):
        if not np.isfinite(numbers).all():
            raise sampler.error("holds NaN or infinity; export the file again", key)
    if parts == 3:
        values = values.reshape(len(times), 3, -1)
    rising = times > np.concatenate([[-np.inf], np.maximum.accumulate(times)[:-1]])
    notes.repair("animation keys that are not later than the one before", int(np.count_nonzero(~rising)))
    curve = Curve(times[rising], values[rising], interpolation)
    return _turning_curve(curve, notes) if kind == "VEC4" else curve


def _turning_curve(curve: Curve, notes: Notes) -> Curve:
    """Quaternions of unit length; tangents of splines keep theirs."""
    values = curve.values.copy()
    keys = values[:, 1] if curve.interpolation is Interpolation.CUBIC_SPLINE else values
    lengths = np.linalg.norm(keys, axis=1, keepdims=True)
    lost = lengths[:, 0] < 1e-12
    notes.repair("rotations of zero length read as none", int(np.count_nonzero(lost)))
    keys[:] = np.where(lost[:, None], (0.0, 0.0, 0.0, 1.0), keys / np.where(lost[:, None], 1.0, lengths))
    return replace(curve, values=values)


def _motion(
    document: Document, graph: NodeGraph, node: int, curves: Mapping[str, Curve], scale: float
) -> Motion:
    """The node's motion; what has no curve rests where the file has it. Roots are resized."""
    rest = rest_transform(document.nodes[graph.definitions[node]])
    moved = {path: curves.get(path, _constant(value)) for path, value in zip(TYPES, rest, strict=True)}
    moved["rotation"] = _turning_curve(moved["rotation"], Notes())  # a rest without length is counted already
    if graph.nodes[node].parent < 0:
        for path in ("translation", "scale"):
            moved[path] = replace(moved[path], values=scale * moved[path].values)
    return Motion(node, moved["translation"], moved["rotation"], moved["scale"])


def _constant(value: Float64) -> Curve:
    return Curve(np.zeros(1), value[None])
