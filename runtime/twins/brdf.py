"""Twin of shaders/lib/brdf.wgsl: reflection."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def brdf_lambert(albedo: Array, irradiance: Array) -> Array:
    """Radiance (..., 3) leaving a Lambertian surface: rho E / pi."""
    return albedo * irradiance / np.pi
