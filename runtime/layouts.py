"""Every struct that Python and WGSL share, in the order of `shaders/structs.wgsl` (nested ones first).

After a change: `python -m runtime.structs`.
"""

from __future__ import annotations

from runtime.camera import Frame
from runtime.candidate_grid import ListUse
from runtime.cascades import DdgiCascade, DdgiInfo
from runtime.clusters import Cluster
from runtime.contact import ContactInfo
from runtime.ddgi import DdgiUpdate, RelocateSettings
from runtime.emitters import Emitter
from runtime.lights import Light, Lighting
from runtime.meshes import Instance, SurfaceMaterial
from runtime.path_tracer import OcclusionSettings, PathSettings
from runtime.pixel_shading import ShadingCounts, ShadingInfo
from runtime.probe_choice import ChoiceCounts, ChoiceSettings, ChoiceTotals
from runtime.probes import ProbeGridInfo, ProbeRecord
from runtime.sdfddgi import PlaceSettings, ProbeHistory, UpdateSettings
from runtime.sky import SkyModel
from runtime.structs import GpuStruct
from runtime.technique import GatherInfo
from runtime.tracer import RayHit, TracedRay
from runtime.triangles import TriangleCorner, TriangleImage, TriangleInfo, TriangleMaterial
from runtime.views import Display
from runtime.world import WorldInfo

STRUCTS: tuple[type[GpuStruct], ...] = (
    Frame,
    SkyModel,
    Light,
    Lighting,
    Instance,
    SurfaceMaterial,
    ShadingInfo,
    ShadingCounts,
    Display,
    WorldInfo,
    ListUse,
    Cluster,
    Emitter,
    GatherInfo,
    TracedRay,
    RayHit,
    ProbeGridInfo,
    ProbeRecord,
    PlaceSettings,
    ChoiceSettings,
    ChoiceTotals,
    ChoiceCounts,
    UpdateSettings,
    ProbeHistory,
    DdgiCascade,
    DdgiInfo,
    RelocateSettings,
    DdgiUpdate,
    TriangleInfo,
    TriangleCorner,
    TriangleMaterial,
    TriangleImage,
    PathSettings,
    OcclusionSettings,
    ContactInfo,
)
