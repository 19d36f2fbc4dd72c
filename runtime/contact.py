"""Contact GI (SDFDDGI, section 3.5): what probes and primitives are too coarse for, found on the screen.

A walk from every texel gathers the light of the surfaces around it and how much of the hemisphere they cover;
both are denoised as one vector and replace that share of the probes' irradiance.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fit.scene import Scene
from runtime.contact_settings import ContactForm, ContactSettings
from runtime.device import Gpu
from runtime.encoder import Recorder
from runtime.kernel import Kernel
from runtime.resources import Buffer, PingPong, Texture
from runtime.structs import GpuStruct, f32, u32, vec2u
from runtime.views import Channel, Readable


class ContactInfo(GpuStruct):
    size: vec2u
    scale: u32
    frame: u32
    seed: u32
    slices: u32
    steps: u32
    step_exponent: f32
    radius: f32
    falloff: f32
    thickness: f32
    longest: f32
    history_frames: f32
    clip_width: f32


class Contact:
    """The contact light of a scene's pictures of one size.

    `irradiance` is E, W/m2, of every pixel once a frame is recorded: the probes' with what is near.
    """

    def __init__(self, gpu: Gpu, size: tuple[int, int], settings: ContactSettings, scene: Scene) -> None:
        self.settings = s = settings
        self._scale = scale = s.scale_of(size)
        self._picture = size
        self._size = texels = (-(-size[0] // scale), -(-size[1] // scale))
        self._radius = s.radius_within(scene)
        self._info = Buffer(gpu, ContactInfo.dtype.itemsize, "uniform", label="contact info")

        def texture(name: str, format: str) -> Texture:
            return Texture(gpu, texels, format, "sample|storage", label=f"contact {name}")

        def pair(name: str, format: str) -> PingPong[Texture]:
            return PingPong(texture(name, format), texture(name, format))

        self._sources = texture("sources", "rgba16float")
        self._gathered = texture("gathered", "rgba16float")
        # A running mean of half floats would drift down, where a device cuts them off instead of rounding.
        self._moved = texture("moved", "rgba32float")
        self._denoised = pair("denoised", "rgba32float")
        self._frames = pair("frames", "r32float")
        self.irradiance = Texture(gpu, size, "rgba32float", "sample|storage", label="indirect_irradiance")
        form = {"PRINTED": int(s.form is ContactForm.PRINTED)}
        walk = "walk_as_printed" if s.form is ContactForm.PRINTED else "walk_horizons"
        self._light = Kernel(gpu, "contact/light_sources", constants=form)
        self._walk = Kernel(gpu, f"contact/{walk}")
        self._denoise = Kernel(gpu, "contact/denoise_contact")
        self._apply = Kernel(gpu, "contact/apply_contact", constants=form)

    def record(
        self, rec: Recorder, shared: Mapping[str, Any], direct: Texture, probes: Texture, index: int
    ) -> None:
        """Fills `irradiance` from that of the lamps and that of the probes; shared: G-buffer and frame."""
        self._write_info(index)
        history, denoised = self._denoised.previous, self._denoised.current
        sources, moved, gathered = self._sources, self._moved, self._gathered
        walks = {"contact_sources": sources, "contact_gathered": gathered}
        if self.settings.form is ContactForm.CONSERVING:
            walks["probe_irradiance"] = probes
        self._light.dispatch_pass(
            rec,
            self._size,
            shared,
            contact=self._info,
            direct_irradiance=direct,
            probe_irradiance=probes,
            contact_history=history,
            contact_past_frames=self._frames.previous,
            contact_sources=sources,
            contact_moved=moved,
        )
        self._walk.dispatch_pass(rec, self._size, shared, contact=self._info, **walks)
        self._denoise.dispatch_pass(
            rec,
            self._size,
            shared,
            contact=self._info,
            contact_gathered=gathered,
            contact_sources=sources,
            contact_moved=moved,
            contact_denoised=denoised,
            contact_frames=self._frames.current,
        )
        self._apply.dispatch_pass(
            rec,
            self._picture,
            shared,
            contact=self._info,
            probe_irradiance=probes,
            contact_denoised=denoised,
            indirect_irradiance=self.irradiance,
        )
        self._denoised.swap()
        self._frames.swap()

    def views(self) -> Mapping[str, Readable]:
        """Radiance of the sources, W/m2/sr; irradiance from what is near, W/m2, and ambient occlusion (the
        share left to the probes), before they are denoised and after."""
        raw, denoised = self._gathered, self._denoised.previous
        return {
            "contact/sources": self._sources,
            "contact/near-raw": raw,
            "contact/ao-raw": Channel(raw, 3),
            "contact/near": denoised,
            "contact/ao": Channel(denoised, 3),
        }

    @property
    def memory(self) -> int:
        """Bytes on the GPU."""
        texels, pixels = int(np.prod(self._size)), int(np.prod(self._picture))
        return texels * (2 * 8 + 3 * 16 + 2 * 4) + pixels * 16 + self._info.size

    def _write_info(self, index: int) -> None:
        s = self.settings
        self._info.write(
            ContactInfo.pack(
                size=np.array(self._size, np.uint32),
                scale=self._scale,
                frame=index,
                seed=s.seed,
                slices=s.slices,
                steps=s.steps,
                step_exponent=s.step_exponent,
                radius=self._radius,
                falloff=s.falloff,
                thickness=s.thickness * self._radius,
                longest=s.longest * self._picture[1],
                history_frames=s.history_frames,
                clip_width=s.clip_width,
            )
        )
