"""A Mitsuba sensor whose pixels are points of surfaces: each measures the irradiance that arrives there.

Cosine-weighted rays from the given position and normal, so that E = pi times their mean radiance; suns, spots
and points have no size, so no ray meets them, and E is indirect by itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

NAME = "sdfprim_points"

_COLUMNS = 1024
"""Pixels in a row of the film: many points become a rectangle."""


def register(mi: Any) -> None:
    """Makes the sensor known to Mitsuba, in the variant that is set."""
    import drjit as dr

    class Points(mi.Sensor):
        def __init__(self, props: Any) -> None:
            self._points: Any = None
            super().__init__(props)

        def look_from(self, starts: NDArray[np.float64], normals: NDArray[np.float64]) -> None:
            width, height = (int(length) for length in self.film().size())
            rows = np.minimum(np.arange(width * height), len(starts) - 1)
            self._size = width, height
            if dr.is_array_v(mi.Float):
                self._points = mi.Point3f(starts[rows].T), mi.Normal3f(normals[rows].T)
            else:
                self._points = starts[rows].tolist(), normals[rows].tolist()

        def sample_ray(self, time, wavelengths, position, aperture, active=True):
            width, height = self._size
            column = dr.minimum(mi.UInt32(position.x * width), width - 1)
            row = dr.minimum(mi.UInt32(position.y * height), height - 1)
            index = row * width + column
            start, normal = self._points
            if dr.is_array_v(mi.Float):
                start = dr.gather(mi.Point3f, start, index, active)
                normal = dr.gather(mi.Normal3f, normal, index, active)
            else:
                start, normal = mi.Point3f(start[index]), mi.Normal3f(normal[index])
            direction = mi.Frame3f(normal).to_world(mi.warp.square_to_cosine_hemisphere(aperture))
            return mi.Ray3f(start, mi.Vector3f(direction), time), mi.Color3f(dr.pi)

        def sample_ray_differential(self, time, wavelengths, position, aperture, active=True):
            ray, weight = self.sample_ray(time, wavelengths, position, aperture, active)
            differential = mi.RayDifferential3f(ray)
            differential.has_differentials = False
            return differential, weight

    mi.register_sensor(NAME, Points)


def make_sensor(mi: Any, starts: NDArray[np.float64], normals: NDArray[np.float64]) -> tuple[Any, int]:
    """The sensor of points (n, 3) with unit normals (n, 3), and the pixels of its film, n or a few more."""
    width = min(len(starts), _COLUMNS)
    height = -(-len(starts) // width)
    film = {
        "type": "hdrfilm",
        "width": width,
        "height": height,
        "component_format": "float32",
        "pixel_format": "rgb",
        "rfilter": {"type": "box"},
    }
    sensor = mi.load_dict({"type": NAME, "film": film, "sampler": {"type": "independent"}})
    sensor.look_from(starts, normals)
    return sensor, width * height
