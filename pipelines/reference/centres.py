"""A Mitsuba sensor that looks through pixel centres alone, as every other picture here is made."""

from __future__ import annotations

from typing import Any

NAME = "sdfprim_centres"


def register(mi: Any) -> None:
    """Makes the sensor known to Mitsuba, in the variant that is set."""
    import drjit as dr

    class Centres(mi.Sensor):
        def __init__(self, props: Any) -> None:
            self._camera: Any = None
            super().__init__(props)

        def look_through(self, camera: Any) -> None:
            self._camera = camera
            self._size = tuple(int(length) for length in self.film().size())

        def sample_ray(self, time, wavelengths, position, aperture, active=True):
            width, height = self._size
            centre = mi.Point2f(
                (dr.floor(position.x * width) + 0.5) / width, (dr.floor(position.y * height) + 0.5) / height
            )
            return self._camera.sample_ray(time, wavelengths, centre, aperture, active)

        def sample_ray_differential(self, time, wavelengths, position, aperture, active=True):
            ray, weight = self.sample_ray(time, wavelengths, position, aperture, active)
            differential = mi.RayDifferential3f(ray)
            differential.has_differentials = False
            return differential, weight

    mi.register_sensor(NAME, Centres)


def make_camera(mi: Any, camera: dict[str, Any]) -> Any:
    """The sensor that looks through the one that a dictionary describes."""
    sensor = mi.load_dict({"type": NAME, "film": camera["film"], "sampler": camera["sampler"]})
    sensor.look_through(mi.load_dict(camera))
    return sensor
