"""Backdrops: unlit meshes that surround all else from afar, as a sky dome or painted hills do.

They are pictures of light from far away. As walls they would shut it out, and set the size that cells and
tolerances are shares of: a hall under a dome was twelve cells wide.
"""

from __future__ import annotations

import numpy as np

from fit.scene import Float64, Mesh, Scene, transform_points
from fit.triangle import plane_frames, squared_distances

FAR = 4.0
"""Radii of the rest from its centre, within which no face of a backdrop lies."""


def find_backdrops(scene: Scene) -> tuple[int, ...]:
    """Instances that are unlit, farther from the centre of what lies within than `FAR` times its radius, and
    around it: their bounds hold that centre. From the largest inwards, while something is left within."""
    if not any(_is_unlit(scene, i) for i in range(len(scene.instances))):
        return ()
    boxes = {i: _bounds(scene, i) for i in range(len(scene.instances)) if len(_mesh(scene, i).triangles)}
    found: list[int] = []
    for index in sorted(boxes, key=lambda i: -float(np.linalg.norm(boxes[i][1] - boxes[i][0]))):
        rest = [box for i, box in boxes.items() if i != index and i not in found]
        if not rest or not _is_unlit(scene, index):
            break
        lower, upper = np.min([box[0] for box in rest], axis=0), np.max([box[1] for box in rest], axis=0)
        center, radius = (lower + upper) / 2, float(np.linalg.norm(upper - lower)) / 2
        around = np.all((boxes[index][0] <= center) & (center <= boxes[index][1]))
        if not around or _distance(scene, index, center) < FAR * radius:
            break
        found.append(index)
    return tuple(found)


def backdrop_notes(scene: Scene) -> tuple[str, ...]:
    """What the report says of the backdrops that are left out."""
    names = [_name(scene, i) for i in find_backdrops(scene)]
    return tuple(
        f"{name!r} is unlit and surrounds all else from afar: it counts as a picture of the sky, no wall"
        for name in names
    )


def _name(scene: Scene, instance: int) -> str:
    node = scene.instances[instance].node
    return (scene.nodes[node].name if node >= 0 else "") or _mesh(scene, instance).name


def _mesh(scene: Scene, instance: int) -> Mesh:
    return scene.meshes[scene.instances[instance].mesh]


def _is_unlit(scene: Scene, instance: int) -> bool:
    material = _mesh(scene, instance).material
    return 0 <= material < len(scene.materials) and scene.materials[material].unlit


def _vertices(scene: Scene, instance: int) -> Float64:
    """Corners (t, 3, 3) in the world."""
    mesh = _mesh(scene, instance)
    return transform_points(scene.instances[instance].world_from_local, mesh.positions)[mesh.triangles]


def _bounds(scene: Scene, instance: int) -> tuple[Float64, Float64]:
    corners = _vertices(scene, instance)
    return corners.min(axis=(0, 1)), corners.max(axis=(0, 1))


def _distance(scene: Scene, instance: int, point: Float64) -> float:
    """Of a point (3,) from the triangles of an instance."""
    frames = plane_frames(_vertices(scene, instance))
    return float(np.sqrt(squared_distances(np.tile(point, (len(frames), 1)), frames).min()))
