"""Cameras: where they stand, how they project, and the frame record that every shader reads.

Depth is reversed (1 on the near plane, 0 far away), so float32 keeps its relative precision at any distance.
Shaders work in local space: world minus the scene's origin, subtracted here in float64.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.scene import Camera, Float64, Scene
from runtime.structs import GpuStruct, f32, mat4x4f, u32, vec2f, vec2u, vec3f

DEFAULT_FOV = 50.0
"""Vertical field of view in degrees where nothing else is said."""

ORTHOGRAPHIC_REACH = 1e4
"""Far plane of an orthographic camera without one, metres behind its near plane."""


class Frame(GpuStruct):
    clip_from_local: mat4x4f
    previous_clip_from_local: mat4x4f
    local_from_view: mat4x4f
    camera: vec3f
    frame_index: u32
    extent: vec2f
    depth_map: vec2f
    size: vec2u
    orthographic: u32
    near: f32
    previous_local_from_view: mat4x4f
    previous_extent: vec2f
    previous_depth_map: vec2f


@dataclass(frozen=True)
class Projection:
    """How view space (looking along -Z, Y up) maps to the picture.

    extent: tangents of the half angles of view (x, y), or half the width and height in metres.
    depth_map (a, b): depth = a + b / distance, or a + b * distance when orthographic.
    """

    extent: tuple[float, float]
    depth_map: tuple[float, float]
    orthographic: bool
    near: float

    @property
    def clip_from_view(self) -> Float64:
        """The (4, 4) matrix; normalised device depth is 1 on the near plane and 0 far away."""
        (width, height), (a, b) = self.extent, self.depth_map
        matrix = np.zeros((4, 4))
        matrix[0, 0], matrix[1, 1] = 1 / width, 1 / height
        if self.orthographic:
            matrix[2, 2], matrix[2, 3], matrix[3, 3] = -b, a, 1
        else:
            matrix[2, 2], matrix[2, 3], matrix[3, 2] = -a, b, -1
        return matrix


def perspective(fov: float, aspect: float, near: float, far: float | None = None) -> Projection:
    """A pinhole: `fov` vertical in radians, `aspect` width over height; no far plane when `far` is None."""
    slope = float(np.tan(fov / 2))
    if far is None or not np.isfinite(far):
        depth_map = (0.0, near)
    else:
        depth_map = (-near / (far - near), near * far / (far - near))
    return Projection((slope * aspect, slope), depth_map, False, near)


def orthographic(half_width: float, half_height: float, near: float, far: float) -> Projection:
    """A parallel projection; lengths in metres."""
    return Projection((half_width, half_height), (far / (far - near), -1 / (far - near)), True, near)


def projection(camera: Camera, size: tuple[int, int]) -> Projection:
    """The camera's projection onto a picture of (width, height) pixels. The picture's own aspect ratio
    counts.

    Raises:
        ValueError: the camera has neither `yfov` nor `ymag`.
    """
    aspect = size[0] / size[1]
    if camera.yfov is not None:
        return perspective(camera.yfov, aspect, camera.znear, camera.zfar)
    if camera.ymag is not None:
        far = camera.zfar if camera.zfar else camera.znear + ORTHOGRAPHIC_REACH
        return orthographic(camera.ymag * aspect, camera.ymag, camera.znear, far)
    raise ValueError(f"camera {camera.name!r} has neither yfov nor ymag: give it one")


def look_at(position: Float64, target: Float64, fov: float = DEFAULT_FOV, near: float = 0.01) -> Camera:
    """A camera at `position` (3,) looking at `target` (3,), +Y up; `fov` is vertical, in degrees.

    Raises:
        ValueError: position and target are the same point, or fov is not between 0 and 180.
    """
    if not 0 < fov < 180:
        raise ValueError(f"a field of view lies between 0 and 180 degrees, not at {fov}")
    return Camera("look_at", world_from_view(position, target), yfov=float(np.radians(fov)), znear=near)


def world_from_view(position: Float64, target: Float64) -> Float64:
    """Rigid (4, 4) matrix of a view from `position` towards `target`, +Y up (+Z where it looks along Y)."""
    position, target = np.asarray(position, np.float64), np.asarray(target, np.float64)
    backward = position - target
    length = float(np.linalg.norm(backward))
    if not length > 0 or not np.isfinite(length):
        raise ValueError(f"a camera at {position.tolist()} cannot look at {target.tolist()}")
    backward = backward / length
    up = np.array([0.0, 1.0, 0.0]) if abs(backward[1]) < 0.9999 else np.array([0.0, 0.0, 1.0])
    right = np.cross(up, backward)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :4] = np.column_stack([right, np.cross(backward, right), backward, position])
    return matrix


def overview(scene: Scene, aspect: float = 16 / 9, fov: float = DEFAULT_FOV) -> Camera:
    """A camera outside of the scene that sees all of its bounding box, from the front, right and above."""
    lower, upper = scene.bounds()
    center, radius = (lower + upper) / 2, max(float(np.linalg.norm(upper - lower)) / 2, 1e-6)
    half_angle = np.radians(fov) / 2
    half_angle = min(half_angle, np.arctan(np.tan(half_angle) * aspect))
    away = np.array([0.5, 0.4, 1.0]) / np.linalg.norm([0.5, 0.4, 1.0])
    return look_at(center + away * radius / np.sin(half_angle), center, fov, near=radius * 1e-3)


def local_from_view(camera: Camera, origin: Float64) -> Float64:
    """The camera's rigid placement (4, 4) around `origin` (3,); scale in its node is dropped."""
    matrix = camera.world_from_local.astype(np.float64).copy()
    backward = matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    right = np.cross(matrix[:3, 1], backward)
    right /= np.linalg.norm(right)
    matrix[:3, :3] = np.column_stack([right, np.cross(backward, right), backward])
    matrix[:3, 3] -= origin
    return matrix


def clip_from_local(camera: Camera, size: tuple[int, int], origin: Float64) -> Float64:
    """Local positions to clip space, (4, 4)."""
    return projection(camera, size).clip_from_view @ np.linalg.inv(local_from_view(camera, origin))


def frame_record(
    camera: Camera, previous: Camera, size: tuple[int, int], origin: Float64, index: int
) -> np.ndarray:
    """The `Frame` that the shaders read; `previous` is the camera of the frame before."""
    view, lens = local_from_view(camera, origin), projection(camera, size)
    previous_lens = projection(previous, size)
    return Frame.pack(
        clip_from_local=clip_from_local(camera, size, origin),
        previous_clip_from_local=clip_from_local(previous, size, origin),
        local_from_view=view,
        camera=view[:3, 3],
        frame_index=index,
        extent=lens.extent,
        depth_map=lens.depth_map,
        size=np.array(size, np.uint32),
        orthographic=int(lens.orthographic),
        near=lens.near,
        previous_local_from_view=local_from_view(previous, origin),
        previous_extent=previous_lens.extent,
        previous_depth_map=previous_lens.depth_map,
    )


def frustum_planes(clip_from_local: Float64) -> Float64:
    """The left, right, lower, upper and near plane (5, 4) of what a camera sees, as normals that look inwards
    and an offset: dot(plane, (p, 1)) is the distance of p inside (Gribb and Hartmann 2001)."""
    x, y, z, w = clip_from_local
    planes = np.stack([w + x, w - x, w + y, w - y, w - z])
    planes /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    return planes
