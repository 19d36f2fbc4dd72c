"""Cameras, and lights of KHR_lights_punctual."""

from __future__ import annotations

import math
from dataclasses import replace

from fit.gltf.container import Document
from fit.gltf.json_object import JsonObject
from fit.gltf.nodes import NodeGraph
from fit.scene import Camera, Float64, Light, LightKind, Node

LIGHTS_EXTENSION = "KHR_lights_punctual"
KINDS = {kind.value: kind for kind in LightKind}


def read_lights(document: Document, graph: NodeGraph, drawn: list[int], scale: float) -> tuple[Light, ...]:
    """A light for each drawn node that carries one.

    `scale` mends a file whose unit is not the metre, so that the picture stays the same: ranges grow with the
    lengths, and the intensities of point and spot lights with their square, for irradiance falls with it.
    """
    extension = document.root.extension(LIGHTS_EXTENSION)
    definitions = extension.objects("lights") if extension else []
    found = []
    for index in drawn:
        use = document.nodes[graph.definitions[index]].extension(LIGHTS_EXTENSION)
        if use is not None:
            light = definitions[use.required_reference("light", len(definitions), "lights")]
            found.append(replace(_light(light, graph.nodes[index], scale), node=index))
    return tuple(found)


def _light(definition: JsonObject, node: Node, scale: float) -> Light:
    kind = definition.choice("type", KINDS)
    r, g, b = definition.numbers("color", 3, (1.0, 1.0, 1.0))
    intensity = definition.number("intensity", 1.0, minimum=0.0)
    inner, outer = 0.0, math.pi / 4
    spot = definition.object("spot") if kind is LightKind.SPOT else None
    if spot is not None:
        inner = spot.number("innerConeAngle", 0.0, minimum=0.0)
        outer = min(spot.number("outerConeAngle", math.pi / 4, minimum=0.0), math.pi / 2)
    return Light(
        name=definition.string("name", node.name),
        kind=kind,
        color=(r, g, b),
        intensity=intensity if kind is LightKind.DIRECTIONAL else intensity * scale**2,
        world_from_local=node.world_from_local,
        range=definition.number("range", minimum=0.0) * scale if "range" in definition else math.inf,
        inner_cone_angle=inner,
        outer_cone_angle=outer,
    )


def read_cameras(document: Document, graph: NodeGraph, drawn: list[int], scale: float) -> tuple[Camera, ...]:
    """A camera for each drawn node that carries one; its lengths are multiplied by `scale`."""
    found = []
    for index in drawn:
        number = document.nodes[graph.definitions[index]].reference(
            "camera", len(document.cameras), "cameras"
        )
        if number is not None:
            definition = document.cameras[number]
            name = definition.string("name", graph.nodes[index].name)
            camera = _camera(definition, name, graph.nodes[index].world_from_local, scale)
            found.append(replace(camera, node=index))
    return tuple(found)


def _camera(definition: JsonObject, name: str, world_from_local: Float64, scale: float) -> Camera:
    kind = definition.choice("type", {"perspective": "perspective", "orthographic": "orthographic"})
    lens = definition.object(kind)
    if lens is None:
        raise definition.error("required but missing", kind)
    zfar = lens.number("zfar", minimum=0.0) * scale if "zfar" in lens else None
    if kind == "perspective":
        return Camera(
            name,
            world_from_local,
            yfov=lens.number("yfov", minimum=1e-6, maximum=math.pi),
            aspect_ratio=lens.number("aspectRatio", minimum=1e-6) if "aspectRatio" in lens else None,
            znear=lens.number("znear", 0.01, minimum=0.0) * scale,
            zfar=zfar,
        )
    xmag, ymag = abs(lens.number("xmag")), abs(lens.number("ymag"))
    if min(xmag, ymag) == 0:
        raise lens.error("xmag and ymag can't be zero")
    znear = lens.number("znear", minimum=0.0) * scale
    return Camera(name, world_from_local, ymag=ymag * scale, aspect_ratio=xmag / ymag, znear=znear, zfar=zfar)
