"""Whole sets of settings, by name: what figures are told of, and what to begin with."""

from __future__ import annotations

from runtime.contact_settings import ContactSettings
from runtime.sdfddgi_settings import SdfddgiSettings
from runtime.settings import RenderSettings

BALANCED = RenderSettings(
    size=(1920, 1080),
    gi="sdfddgi",
    contact=ContactSettings(),
    technique=SdfddgiSettings(max_probes=9856, probes_per_frame=1232, rays_per_probe=64, bounce=1.0),
)
"""The paper's configuration: as many probes as its volume of 22 x 14 x 32 has, an eighth of them a frame, so
that each has its turn within 8 frames while it is seen, 64 rays a probe, every bounce, contact light.
Every figure of time or error that docs/benchmarks give for SDFDDGI as a whole is of these settings."""

PRESETS = {"balanced": BALANCED}
