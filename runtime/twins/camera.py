"""Twin of shaders/lib/camera.wgsl: pixels, depths and positions. All take n rows."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
UInt32 = NDArray[np.uint32]


def camera_ndc(pixel: Array, size: Array) -> Array:
    """Normalised device coordinates (n, 2), y upward, of pixel coordinates (n, 2), row 0 on top."""
    return np.array([2.0, -2.0]) * pixel / size + np.array([-1.0, 1.0])


def camera_pixel(ndc: Array, size: Array) -> Array:
    """Pixel coordinates (n, 2) of normalised device coordinates (n, 2)."""
    return (ndc - np.array([-1.0, 1.0])) * size * np.array([0.5, -0.5])


def camera_distance(depth: Array, depth_map: Array, orthographic: UInt32) -> Array:
    """Distance (n,) along the viewing axis of stored depths (n,); depth_map (n, 2), orthographic (n,)."""
    difference = depth - depth_map[:, 0]
    return np.where(orthographic != 0, difference / depth_map[:, 1], depth_map[:, 1] / difference)


def camera_view_position(ndc: Array, distance: Array, extent: Array, orthographic: UInt32) -> Array:
    """View-space position (n, 3) at a distance (n,) along the viewing axis."""
    scale = np.where(orthographic != 0, 1.0, distance)[:, None]
    return np.concatenate([ndc * extent * scale, -distance[:, None]], axis=1)


def camera_view_direction(ndc: Array, extent: Array, orthographic: UInt32) -> Array:
    """View-space unit direction (n, 3) in which a pixel looks."""
    slope = np.where((orthographic != 0)[:, None], 0.0, ndc * extent)
    direction = np.concatenate([slope, -np.ones((len(slope), 1))], axis=1)
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)
