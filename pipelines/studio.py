"""A scene set up to be rendered: its light and camera chosen once, its primitives given for each picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from fit.scene import Scene
from pipelines.errors import UsageError
from pipelines.methods import SOFTWARE_PROBES, find_method, technique_settings
from pipelines.options import ProbesOption, looks_like_numbers, parse_color, parse_sun
from pipelines.views import View, choose_view
from runtime.settings import ShadingMode

if TYPE_CHECKING:
    from fit.primitives import PrimitiveSet
    from fit.spaces import Air
    from runtime.contact_settings import ContactSettings
    from runtime.device import Gpu
    from runtime.lights import Illumination
    from runtime.renderer import Renderer, Result
    from runtime.settings import RenderSettings
    from runtime.sky import Sky

DEFAULT_FRAMES = 64
"""Frames until the probes' light has settled, three bounces included."""

SOFTWARE_WHOLE_FRAMES = 4
"""Frames that a software adapter draws whole: enough for a median of the pixels' passes."""

SOFTWARE_CONTACT_FRAMES = 16
"""The same with contact light, whose noise goes with whole frames."""

Contact = Literal["off", "on", "paper"]
"""Light from what is near on the screen: none, that which conserves energy, and SDFDDGI's own."""

FrameDone = Callable[[int, int], None]
"""Called with the frames that are done and all that are asked for."""


@dataclass(frozen=True)
class LightingOptions:
    """The options of light as they were typed; giving `sun` or `sky` switches the file's lights off."""

    sun: str | None = None
    sky: str | None = None
    keep_file_lights: bool = False

    def check(self) -> None:
        """Raises UsageError for values that can't be read."""
        if self.sun is not None:
            parse_sun(self.sun)
        if self.sky is not None and looks_like_numbers(self.sky):
            parse_color("--sky", self.sky)
        elif self.sky is not None and not Path(self.sky).is_file():
            raise UsageError(f"--sky {self.sky}: no such file; give r,g,b or an equirectangular .hdr or .exr")

    def choose(self, scene: Scene) -> Illumination:
        """What is on in this scene."""
        from runtime.lights import Sun, choose_illumination

        sun = None
        if self.sun is not None:
            given = parse_sun(self.sun)
            sun = Sun(given.direction, given.strength)
        return choose_illumination(scene, sun, self._sky(), keep_file_lights=self.keep_file_lights)

    def _sky(self) -> Sky | None:
        from runtime.sky import Sky

        if self.sky is None:
            return None
        if looks_like_numbers(self.sky):
            return Sky.constant(parse_color("--sky", self.sky))
        return Sky.from_file(self.sky)


AS_IN_THE_FILE = LightingOptions()


def contact_settings(contact: Contact) -> ContactSettings | None:
    """What an option of `--contact` stands for."""
    from runtime.contact_settings import ContactForm, ContactSettings

    if contact == "off":
        return None
    return ContactSettings(ContactForm.PRINTED if contact == "paper" else ContactForm.CONSERVING)


@dataclass(frozen=True)
class Studio:
    """One scene under one light from one camera."""

    gpu: Gpu
    scene: Scene
    view: View
    illumination: Illumination
    size: tuple[int, int]
    exposure: float

    @staticmethod
    def set_up(
        scene: Scene,
        camera: str | None,
        lighting: LightingOptions,
        size: tuple[int, int],
        exposure: float,
    ) -> Studio:
        """Chooses camera and light and opens the GPU.

        Raises:
            UsageError: there is no such camera.
            NoAdapter: there is no GPU; the message says what to install.
        """
        from runtime.device import open_device

        view = choose_view(camera, scene, size[0] / size[1])
        return Studio(open_device(), scene, view, lighting.choose(scene), size, exposure)

    def moved_inside(self, air: Air) -> Studio:
        """With a made-up camera put into the largest room, where the air is rooms and no outside."""
        if not self.view.made_up:
            return self
        return replace(self, view=choose_view(None, self.scene, self.size[0] / self.size[1], air))

    def render(
        self,
        primitives: PrimitiveSet,
        technique: str,
        frames: int,
        views: tuple[str, ...] = (),
        done: FrameDone | None = None,
        probes: ProbesOption | None = None,
        glossy: bool = False,
        contact: Contact = "off",
        **options: Any,
    ) -> Result:
        """Renders `frames` frames and returns the last one: its views, and the medians of its passes' times.

        technique: one of `methods.METHODS`; probes: how fine they stand; glossy: with reflections; contact:
        with what is near on the screen; options: `culling` (`WorldSettings`), and further settings of the
        technique. On a software adapter all but the last few frames bring only the light up to date.
        """
        most = SOFTWARE_WHOLE_FRAMES if contact == "off" else SOFTWARE_CONTACT_FRAMES
        whole = min(frames, most) if self.gpu.is_software else frames
        renderer = self.open_renderer(primitives, technique, probes, glossy, contact, **options)
        return renderer.render(
            self.view.camera, frames=whole, settle=frames - whole, only=views, progress=done
        )

    def open_renderer(
        self,
        primitives: PrimitiveSet,
        technique: str,
        probes: ProbesOption | None = None,
        glossy: bool = False,
        contact: Contact = "off",
        shading: ShadingMode = ShadingMode.FULL,
        **options: Any,
    ) -> Renderer:
        """A renderer for one method, for those who change something between frames; arguments as for
        `render`. shading: how indirect light comes to the pixels."""
        from runtime.renderer import Renderer

        settings = self.settings(technique, primitives, probes, **options)
        settings = replace(settings, glossy=glossy, contact=contact_settings(contact))
        settings = replace(settings, shading=replace(settings.shading, mode=shading))
        return Renderer(self.gpu, self.scene, primitives, settings, self.illumination)

    def settings(
        self,
        technique: str,
        primitives: PrimitiveSet,
        probes: ProbesOption | None = None,
        culling: str = "grid",
        **options: Any,
    ) -> RenderSettings:
        """Settings for one method; software adapters get fewer probes and smaller maps and textures."""
        from runtime.settings import PREVIEW, RenderSettings, WorldSettings

        software = self.gpu.is_software
        own = technique_settings(technique, primitives, probes, software=software, **options)
        settings = replace(PREVIEW if software else RenderSettings(), world=WorldSettings(culling=culling))
        gi = find_method(technique).technique
        return replace(settings, size=self.size, gi=gi, technique=own, exposure=self.exposure)

    def _emission(self) -> list[str]:
        names = [repr(material.name) for material in self.scene.materials if any(material.emission)]
        return [f"emission of {', '.join(names)}"] if names else []

    def describe(self) -> dict[str, Any]:
        """A report's keys on adapter, camera and light."""
        return {
            "adapter": self.gpu.adapter_summary,
            "software_adapter": self.gpu.is_software,
            "camera": self.view.origin,
            "lights": [*self.illumination.describe(), *self._emission()],
            "size": self.size,
            "preview": f"at most {SOFTWARE_PROBES} probes" if self.gpu.is_software else None,
            "exposure": self.exposure,
        }
