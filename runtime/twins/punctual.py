"""Twin of shaders/lib/punctual.wgsl: suns, spots and points without shadows.

A `light` is (n,) records, or one, of `runtime.lights.Light`.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

PUNCTUAL_SUN, PUNCTUAL_SPOT, PUNCTUAL_POINT = range(3)
PUNCTUAL_SMALLEST_DISTANCE = 1e-4


def punctual_window(distance: Array, range: Array) -> Array:
    """The extension's window (n,): 1 near the lamp, 0 past its range; a range of 0 stands for none."""
    ratio = distance / np.where(range > 0, range, 1)
    return np.where(range > 0, np.clip(1 - ratio**4, 0, 1), 1.0)


def punctual_cone(cosine: Array, angle_scale: Array, angle_offset: Array) -> Array:
    """The extension's squared falloff (n,) from the inner to the outer cone."""
    return np.clip(cosine * angle_scale + angle_offset, 0, 1) ** 2


def punctual_direction(light: np.ndarray, position: Array) -> Array:
    """Unit vectors (n, 3) from positions (n, 3) towards a light."""
    way = light["position"] - position
    towards = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), PUNCTUAL_SMALLEST_DISTANCE)
    return np.where((light["kind"] == PUNCTUAL_SUN)[..., None], -light["axis"], towards)


def punctual_distance(light: np.ndarray, position: Array) -> Array:
    """Metres (n,) from positions to a light; a sun is infinitely far."""
    distance = np.linalg.norm(light["position"] - position, axis=1)
    return np.where(light["kind"] == PUNCTUAL_SUN, 3.0e38, distance)


def punctual_attenuation(light: np.ndarray, position: Array) -> Array:
    """Share (n,) of a light's strength that reaches a surface facing it: irradiance is color times this."""
    distance = np.linalg.norm(light["position"] - position, axis=1)
    distance = np.maximum(distance, PUNCTUAL_SMALLEST_DISTANCE)
    reach = punctual_window(distance, light["range"]) / distance**2
    cosine = -(light["axis"] * punctual_direction(light, position)).sum(axis=1)
    cone = punctual_cone(cosine, light["angle_scale"], light["angle_offset"])
    share = np.where(light["kind"] == PUNCTUAL_SPOT, reach * cone, reach)
    return np.where(light["kind"] == PUNCTUAL_SUN, 1.0, share)
