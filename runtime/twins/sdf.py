"""Twin of shaders/lib/sdf.wgsl: the fitter's own distances, so both sides share one definition."""

from fit.sdf import (
    sd_box,
    sd_box_gradient,
    sd_cylinder,
    sd_cylinder_gradient,
    sd_half_space,
    sd_half_space_gradient,
    sd_sphere,
    sd_sphere_gradient,
)

__all__ = [
    "sd_box",
    "sd_box_gradient",
    "sd_cylinder",
    "sd_cylinder_gradient",
    "sd_half_space",
    "sd_half_space_gradient",
    "sd_sphere",
    "sd_sphere_gradient",
]
