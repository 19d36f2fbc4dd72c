"""The truth: Mitsuba 3 path traces the same scenes, meshes or primitive sets, under the same light.

`mesh_reference` and `primitive_reference` make a `Reference`; it renders pictures, and irradiance at any
points. Mitsuba is the optional extra `reference`, loaded on first use.
"""

from pipelines.reference.build import mesh_reference, primitive_reference
from pipelines.reference.mitsuba import MissingMitsuba
from pipelines.reference.truth import Reference

__all__ = ["MissingMitsuba", "Reference", "mesh_reference", "primitive_reference"]
