"""Glossy light: mirror rays at half the resolution, blurred level by level; roughness picks the level.

McGuire 2019, "Dynamic Diffuse Global Illumination", part 3, "Glossy GI". Suns, spots and points have no size,
so that they have no reflection here; what they light has.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from runtime.device import Gpu
from runtime.encoder import Recorder
from runtime.kernel import Kernel
from runtime.resources import Sampler, Texture
from runtime.technique import Technique


class Glossy:
    """The reflections of one picture, seen through a technique's tracer and lit by the technique."""

    def __init__(self, gpu: Gpu, size: tuple[int, int], technique: Technique) -> None:
        self._tracer = technique.tracer
        self._size = size
        half = (-(-size[0] // 2), -(-size[1] // 2))
        levels = max(half).bit_length()
        self._levels = Texture(gpu, half, "rgba16float", "sample|storage", mips=levels, label="glossy mirror")
        self._sampler = Sampler(gpu, "linear", mip_filter="linear", label="glossy mirror")
        aliases = {"technique": technique.name, "tracer": self._tracer.folder}
        self._trace = Kernel(gpu, "glossy/trace_mirror", aliases=aliases)
        self._blur = Kernel(gpu, "glossy/blur_mirror")
        self._combine = Kernel(gpu, "glossy/combine_glossy", aliases={"technique": technique.name})

    def record(
        self, rec: Recorder, shared: Mapping[str, Any], direct: Texture, indirect: Texture, radiance: Texture
    ) -> None:
        """Fills `radiance` from both irradiances and the reflections. shared: G-buffer, world, the
        technique's lookup, frame."""
        mirror = self._levels
        with rec.compute(self._trace.name) as compute_pass:
            self._trace.dispatch(
                compute_pass,
                self._trace.groups_for(*mirror.size[:2]),
                shared,
                self._tracer.bindings(),
                mirror=mirror.view(0),
            )
        with rec.compute(self._blur.name) as compute_pass:
            for level in range(1, mirror.mips):
                self._blur.dispatch(
                    compute_pass,
                    self._blur.groups_for(*mirror.mip_size(level)[:2]),
                    shared,
                    sharper=mirror.view(level - 1),
                    blurred=mirror.view(level),
                )
        with rec.compute(self._combine.name) as compute_pass:
            self._combine.dispatch(
                compute_pass,
                self._combine.groups_for(*self._size),
                shared,
                direct_irradiance=direct,
                indirect_irradiance=indirect,
                mirror_levels=mirror,
                mirror_sampler=self._sampler,
                radiance=radiance,
            )

    def views(self) -> Mapping[str, Texture]:
        """Textures worth looking at, by name."""
        return {"glossy/mirror": self._levels}
