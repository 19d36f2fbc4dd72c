"""A Mitsuba sensor whose pixels are points of surfaces: each measures the irradiance that arrives there.

Half of the rays go by the cosine, half towards what shines, and each counts by the density of both together
(the balance heuristic of Veach and Guibas 1995), so that E is the mean of radiance times weight: a small
lamp is met by chance far too seldom. Suns, spots and points have no size, so no ray meets them, and E is
indirect by itself.
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

        def look_from(self, scene: Any, starts: NDArray[np.float64], normals: NDArray[np.float64]) -> None:
            self._scene = scene
            width, height = (int(length) for length in self.film().size())
            rows = np.minimum(np.arange(width * height), len(starts) - 1)
            self._size = width, height
            if dr.is_array_v(mi.Float):
                self._points = mi.Point3f(starts[rows].T), mi.Normal3f(normals[rows].T)
            else:
                self._points = starts[rows].tolist(), normals[rows].tolist()

        def sample_ray(self, time, wavelengths, position, aperture, active=True):
            start, normal, choice = self._point(position, active)
            seen = dr.zeros(mi.SurfaceInteraction3f)
            seen.p, seen.n, seen.time = start, normal, time
            chosen, _ = self._scene.sample_emitter_direction(seen, aperture, False, active)
            by_cosine = mi.Frame3f(normal).to_world(mi.warp.square_to_cosine_hemisphere(aperture))
            to_light = dr.select(chosen.delta, 0, chosen.pdf) > 0
            is_usable = (choice < 0.5) | to_light
            direction = dr.select((choice >= 0.5) & to_light, chosen.d, by_cosine)
            ray = mi.Ray3f(start, mi.Vector3f(direction), time)
            weight = self._weight(ray, seen, normal, active)
            return ray, mi.Color3f(dr.select(is_usable, weight, 0))

        def sample_ray_differential(self, time, wavelengths, position, aperture, active=True):
            ray, weight = self.sample_ray(time, wavelengths, position, aperture, active)
            differential = mi.RayDifferential3f(ray)
            differential.has_differentials = False
            return differential, weight

        def _point(self, position, active):
            """A point, its normal, and where in its pixel the sample is: one more random number."""
            width, height = self._size
            column = dr.minimum(mi.UInt32(position.x * width), width - 1)
            row = dr.minimum(mi.UInt32(position.y * height), height - 1)
            index, place = row * width + column, position.x * width - column
            start, normal = self._points
            if dr.is_array_v(mi.Float):
                start = dr.gather(mi.Point3f, start, index, active)
                return start, dr.gather(mi.Normal3f, normal, index, active), place
            return mi.Point3f(start[index]), mi.Normal3f(normal[index]), place

        def _weight(self, ray, seen, normal, active):
            """Cosine over the mean density of the two ways to choose the ray's direction."""
            cosine = dr.dot(normal, ray.d)
            hit = self._scene.ray_intersect(ray, active)
            light = mi.DirectionSample3f(self._scene, hit, seen)
            is_lit = active & (light.emitter != None)  # noqa: E711
            density = mi.Float(0)
            if dr.is_array_v(mi.Float) or is_lit:  # one ray without a light has no density to ask for
                density = dr.select(is_lit, self._scene.pdf_emitter_direction(seen, light, is_lit), 0)
            return dr.select(cosine > 0, 2 * cosine / (cosine / dr.pi + density), 0)

    mi.register_sensor(NAME, Points)


def make_sensor(
    mi: Any, scene: Any, starts: NDArray[np.float64], normals: NDArray[np.float64]
) -> tuple[Any, int]:
    """The sensor of points (n, 3) with unit normals (n, 3) in a scene, and the pixels of its film, n or a
    few more."""
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
    sensor.look_from(scene, starts, normals)
    return sensor, width * height
