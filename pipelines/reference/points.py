"""A Mitsuba sensor whose pixels are points of surfaces: each measures the irradiance that arrives there.

Rays go by the cosine, and where there are lamps half of them towards these; each counts by the density
of both ways together (the balance heuristic of Veach and Guibas 1995): by chance, a small lamp is met too
seldom. Suns, spots and points have no size, so no ray meets them, and E is indirect by itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

NAME = "sdfprim_points"

_COLUMNS = 1024
"""Pixels in a row of the film: many points become a rectangle."""


_TO_LIGHTS = 0.5
"""Share of the rays that go towards lamps, where there are any: five times less noise under a small one."""

_HIDDEN = 1e-3
"""Of the way to a lamp: what is nearer by more stands before it; then the cosine counts alone."""


def register(mi: Any) -> None:
    """Makes the sensor known to Mitsuba, in the variant that is set."""
    import drjit as dr

    class Points(mi.Sensor):
        def __init__(self, props: Any) -> None:
            self._points: Any = None
            super().__init__(props)

        def look_from(self, scene: Any, starts: NDArray[np.float64], normals: NDArray[np.float64]) -> None:
            self._scene = scene
            flags = [emitter.flags() for emitter in scene.emitters()]
            has_lamps = any(mi.has_flag(flag, mi.EmitterFlags.Surface) for flag in flags)
            self._to_lights = _TO_LIGHTS if has_lamps else 0.0
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
            to_light = (choice < self._to_lights) & (dr.select(chosen.delta, 0, chosen.pdf) > 0)
            direction = dr.select(to_light, chosen.d, by_cosine)
            ray = mi.Ray3f(start, mi.Vector3f(direction), time)
            hit = self._scene.ray_intersect(ray, active)
            light = mi.DirectionSample3f(self._scene, hit, seen)
            # Of two lamps that lie closer together than the limit, as a thin one's sides do, only the one
            # that is met has its density in the weight.
            is_met = to_light & (light.emitter == chosen.emitter) & (hit.t > chosen.dist * (1 - _HIDDEN))
            weight = self._weight(ray.d, light, seen, normal, active)
            return ray, mi.Color3f(dr.select((choice >= self._to_lights) | is_met, weight, 0))

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

        def _weight(self, direction, light, seen, normal, active):
            """Cosine over the density of both ways to choose a direction."""
            cosine = dr.dot(normal, direction)
            is_lit = active & (light.emitter != None)  # noqa: E711
            density = mi.Float(0)
            if dr.is_array_v(mi.Float) or is_lit:  # one ray without a light has no density to ask for
                density = dr.select(is_lit, self._scene.pdf_emitter_direction(seen, light, is_lit), 0)
            share = self._to_lights
            return dr.select(cosine > 0, cosine / ((1 - share) * cosine / dr.pi + share * density), 0)

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
