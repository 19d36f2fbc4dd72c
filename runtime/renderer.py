"""The frame, read from top to bottom: world, shadow maps, technique, G-buffer, direct light, indirect
light, contact light, picture.

    renderer = Renderer(gpu, scene, primitives, RenderSettings(size=(640, 360), gi="sdfddgi"))
    result = renderer.render(camera, frames=16)
    write_png("final.png", result.display())

Between frames the camera, lights, sky, instances and primitives may change; no pipeline is built again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.primitives import PrimitiveSet
from fit.scene import Camera, Float64, Scene
from runtime import pixel_shading, views
from runtime.camera import Frame, clip_from_local, frame_record, overview
from runtime.contact import Contact
from runtime.device import Gpu
from runtime.direct import DirectLight, LightMaps
from runtime.encoder import Recorder
from runtime.glossy import Glossy
from runtime.kernel import Kernel, Resource
from runtime.lights import AnyLight, Illumination, choose_illumination
from runtime.meshes import SceneMeshes
from runtime.playback import Playback
from runtime.primary import GBuffer, GBufferPass
from runtime.resources import Buffer, Texture
from runtime.settings import RenderSettings
from runtime.sky import Sky, SkyMap
from runtime.technique import FrameLight, create
from runtime.timing import Interval, Timer
from runtime.views import Readable, ToneMap, Views, to_display
from runtime.world import World

Float32 = NDArray[np.float32]
UInt8 = NDArray[np.uint8]


@dataclass(frozen=True)
class Result:
    """A finished frame.

    images: the views asked for, (height, width, 3) float32 linear, scene units, no exposure; `final` is
    always there. timings: milliseconds of each pass on the GPU, the median over the frames in which it ran;
    None where the device keeps no time. notes: what was done silently nowhere else: textures halved, lights
    off, materials left out.
    """

    images: Mapping[str, Float32]
    timings: Mapping[str, float | None]
    frames: int
    picture: UInt8
    settings: RenderSettings
    notes: tuple[str, ...] = field(default=())

    def display(self, view: str = "final") -> UInt8:
        """A view as sRGB bytes (height, width, 3); `final` is the GPU's own tone-mapped picture."""
        if view == "final":
            return self.picture
        return to_display(view, self.images[view], self.settings)


class Renderer:
    """Draws a scene, lit through its primitives.

    `illumination` None: the scene's own lights, or a default (`lights.choose_illumination`). Raises
    ValueError for an unknown technique.
    """

    def __init__(
        self,
        gpu: Gpu,
        scene: Scene,
        primitives: PrimitiveSet,
        settings: RenderSettings | None = None,
        illumination: Illumination | None = None,
    ) -> None:
        self.gpu = gpu
        self.scene = scene
        self.settings = settings or RenderSettings()
        self.illumination = illumination or choose_illumination(scene)
        size = self.settings.size
        self.world = World(gpu, scene, primitives, settings=self.settings.world)
        self.meshes = SceneMeshes(gpu, scene, self.world.origin, self.settings.max_texture_size)
        self.technique = create(self.settings.gi, gpu, self.world, self.settings.technique)
        self.gbuffer = GBuffer(gpu, size)
        self._lights = LightMaps(gpu, self.world.origin, self.settings.shadows, self.meshes)
        self._sky = SkyMap(gpu, self.illumination.sky)
        self._frame = Buffer(gpu, Frame.dtype.itemsize, "uniform", label="frame")
        self._draw_gbuffer = GBufferPass(gpu)
        self._direct = DirectLight(gpu, size)
        self.shading = pixel_shading.create(gpu, size, self.settings.shading, self.technique, self.world)
        self._radiance = Texture(gpu, size, "rgba32float", "sample|storage", label="radiance")
        self._combine = Kernel(gpu, "composite/combine_light")
        wanted = self.settings.contact
        self._contact = Contact(gpu, size, wanted, scene) if wanted else None
        self._glossy = Glossy(gpu, size, self.technique) if self.settings.glossy else None
        self._tone_map = ToneMap(gpu, size, self.settings.exposure, self.settings.tone_curve)
        self._views = Views(gpu, size)
        self._lights.set(self.illumination.lights)
        self._playback = Playback(scene)
        self._rest = primitives
        self._timer = Timer(gpu)
        self._index = 0
        self._light_version = 0
        self._camera: Camera | None = None
        self._previous_camera: Camera | None = None

    # ---- what may change

    def set_camera(self, camera: Camera) -> None:
        """Looks through another camera from the next frame on."""
        self._camera = camera

    def set_time(self, seconds: float) -> None:
        """Moves meshes, the file's lights, and primitives that know their node, as the scene's animations do.

        Before the first call the scene is at rest, which need not be its place at 0 seconds.

        Raises:
            ValueError: the set of primitives belongs to another scene.
        """
        if not self._playback.moves:
            return
        if instances := self._playback.instances(seconds):
            self.move_instances(instances)
        lights = self._playback.lights(self.illumination.lights, seconds)
        if lights != self.illumination.lights:
            self.set_lights(lights)
        if self._rest.nodes:
            self.world.update(self._playback.primitives(self._rest, seconds))

    def set_primitives(self, primitives: PrimitiveSet) -> None:
        """Lights through other primitives from the next frame on: more, fewer, moved, or of other emission.

        Those that know a node are given at rest and move with the next `set_time`.
        """
        self._rest = primitives
        self.world.update(primitives)

    def set_lights(self, lights: Sequence[AnyLight]) -> None:
        """Replaces suns, spots and points."""
        self.illumination = replace(self.illumination, lights=tuple(lights))
        self._lights.set(self.illumination.lights)
        self._light_version += 1

    def set_sky(self, sky: Sky) -> None:
        """Replaces the sky."""
        self.illumination = replace(self.illumination, sky=sky)
        self._sky.set(sky)
        self._light_version += 1

    def move_instances(self, instances: dict[int, Float64]) -> None:
        """Places drawn instances (index into `scene.instances` -> world_from_local); the primitives stay."""
        self.meshes.move(instances)
        self.technique.tracer.move(self.meshes.placements(instances))
        self._lights.invalidate()
        self._light_version += 1  # the reflective shadow maps show something else

    def show_instances(self, visible: Mapping[int, bool]) -> None:
        """Lets drawn instances (index into `scene.instances`) vanish or appear; the primitives stay."""
        self.meshes.show(visible)
        self.technique.tracer.move(self.meshes.placements(visible))
        self._lights.invalidate()
        self._light_version += 1

    def set_emission(self, material: int, emission: tuple[float, float, float]) -> None:
        """What a material of the meshes emits, W/m2/sr, before its texture. The light it sends is that of the
        primitives, which `set_primitives` replaces."""
        self.meshes.set_emission(material, emission)

    def set_exposure(self, exposure: float) -> None:
        """Stops (EV) of the tone-mapped picture."""
        self.settings = replace(self.settings, exposure=exposure)
        self._tone_map.set(exposure, self.settings.tone_curve)

    # ---- one frame

    def draw_frame(self, *, only_light: bool = False) -> None:
        """Records and submits one frame. `only_light` leaves out what only the picture needs: the G-buffer
        on."""
        camera = self._camera or overview(self.scene, self.settings.size[0] / self.settings.size[1])
        self._camera = camera
        self._frame.write(
            frame_record(
                camera,
                self._previous_camera or camera,
                self.settings.size,
                self.world.origin,
                self._index,
            )
        )
        rec = Recorder(self.gpu, self._timer)
        if (volume := self.technique.volume) is not None:
            self.world.watch(volume, self.illumination.lights)
        self.world.record(rec)
        self._lights.record(rec)
        self.technique.record(
            rec,
            FrameLight(
                self._index,
                self._frame_bindings(),
                self._light_version,
                viewer=camera.world_from_local[:3, 3],
                clip_from_local=clip_from_local(camera, self.settings.size, self.world.origin),
            ),
        )
        if not only_light:
            self.gbuffer.begin_frame()
            self._draw_gbuffer.record(rec, self.meshes, self.gbuffer, self._frame_bindings())
            self._direct.record(rec, self.gbuffer, self.world.bindings(), self._frame_bindings())
            self.shading.record(rec, self._shared())
            self._record_contact(rec)
            self._record_radiance(rec)
            self._tone_map.record(rec, self._radiance)
        rec.submit()
        self._index += 1
        if not only_light:  # a buffer written before the submission would change what it draws
            self._previous_camera = camera
            self.meshes.end_frame()

    @property
    def _indirect(self) -> Texture:
        """Indirect irradiance of the last frame, with the light of what is near if that is wanted."""
        return self._contact.irradiance if self._contact else self.shading.irradiance

    def _record_contact(self, rec: Recorder) -> None:
        """What is near on the screen, if that is wanted."""
        if self._contact is not None:
            probes = self.shading.irradiance
            self._contact.record(rec, self._shared(), self._direct.irradiance, probes, self._index)

    def _record_radiance(self, rec: Recorder) -> None:
        """Surfaces under both irradiances, with their reflections if these are wanted, or the sky."""
        if self._glossy is not None:
            self._glossy.record(rec, self._shared(), self._direct.irradiance, self._indirect, self._radiance)
            return
        self._combine.dispatch_pass(
            rec,
            self.settings.size,
            self._shared(),
            direct_irradiance=self._direct.irradiance,
            indirect_irradiance=self._indirect,
            radiance=self._radiance,
        )

    def _frame_bindings(self) -> dict[str, Resource]:
        """Group 3: frame, sky, lights."""
        return {"frame": self._frame, **self._sky.bindings(), **self._lights.bindings()}

    def _shared(self) -> dict[str, Any]:
        """Everything that a per-pixel kernel may bind."""
        return {
            **self.gbuffer.bindings(),
            **self.world.bindings(),
            **self.technique.lookup_bindings(),
            **self._frame_bindings(),
        }

    # ---- pictures

    def render(
        self,
        camera: Camera | None = None,
        frames: int = 1,
        *,
        settle: int = 0,
        only: Sequence[str] = ("final",),
        progress: Callable[[int, int], None] | None = None,
    ) -> Result:
        """Draws `settle` frames that only bring the light up to date, then `frames` whole ones, and reads
        `only`. The last of the former are whole too, as many as the form of shading needs.

        camera: None keeps the last one, or takes an overview. only: names of `all_views`. progress: called
        after each frame with how many are done and how many there are.

        Raises:
            ValueError: no frame, or an unknown view; the message lists those there are.
        """
        if frames < 1 or settle < 0:
            raise ValueError(f"{frames} frames after {settle}: at least one frame has to be drawn")
        unknown = [name for name in only if name not in self.all_views()]
        if unknown:
            raise ValueError(f"no view {', '.join(unknown)}; there are {', '.join(self.all_views())}")
        if camera is not None:
            self.set_camera(camera)
        self._timer.results()
        history: list[Mapping[str, float | None]] = []
        first_whole = min(settle, settle + frames - self.shading.frames_to_settle)
        for number in range(settle + frames):
            self.draw_frame(only_light=number < first_whole)
            history.append(self._timer.results())
            if progress:
                progress(number + 1, settle + frames)
        images = {name: self.read_view(name) for name in dict.fromkeys(("final", *only))}
        picture = self._tone_map.picture.read()[..., :3]
        return Result(images, _medians(history), frames, picture, self.settings, self.notes())

    def pass_intervals(self) -> list[Interval]:
        """When each pass ran since the last call, or the last `render`; waits for the GPU."""
        return self._timer.intervals()

    def all_views(self) -> tuple[str, ...]:
        """Names that `read_view` takes: the frame's layers, the primitives', the technique's."""
        return (*views.VIEWS, *self._own_views(), *self.shading.views(), *self.technique.drawings())

    def _own_views(self) -> Mapping[str, Readable]:
        stages = (self.technique, self._contact, self._glossy)
        return {name: view for stage in stages if stage for name, view in stage.views().items()}

    def read_view(self, name: str) -> Float32:
        """A view of the last whole frame, (height, width, 3) float32; a technique's texture as it is.

        `position` is in world space.
        """
        if name == "final":
            radiance: Float32 = self._radiance.read()[..., :3]
            return radiance
        if name in views.PANELS:
            return np.hstack([self.read_view(panel) for panel in views.PANELS[name]])
        if name in self._own_views():
            return _three_channels(self._own_views()[name].read())
        if name in self.shading.views():
            return self.shading.read_view(name, self.gbuffer.depth)
        shared = {
            **self._shared(),
            "direct_irradiance": self._direct.irradiance,
            "indirect_irradiance": self._indirect,
        }
        if name in (drawings := self.technique.drawings()):
            return self._views.draw(name, drawings[name], {**shared, "radiance": self._radiance})[..., :3]
        pixels = self._views.extract(name, shared)
        if name == "position":
            return np.where(pixels[..., 3:] > 0, pixels[..., :3] + self.world.origin, 0).astype(np.float32)
        return pixels[..., :3]

    def notes(self) -> tuple[str, ...]:
        """What a user should know of how this scene is drawn."""
        notes = (*self.meshes.notes, *self._lights.notes, *self.technique.tracer.notes, *self.world.notes())
        return (*self.illumination.notes, *notes)


def _medians(history: Sequence[Mapping[str, float | None]]) -> dict[str, float | None]:
    labels = dict.fromkeys(label for timings in history for label in timings)
    medians: dict[str, float | None] = {}
    for label in labels:
        known = [timings[label] for timings in history if timings.get(label) is not None]
        medians[label] = float(np.median(np.array(known, np.float64))) if known else None
    return medians


def _three_channels(pixels: NDArray[Any]) -> Float32:
    """(height, width[, channels]) as (height, width, 3): one channel is repeated, a missing one is 0."""
    values = np.atleast_3d(pixels.astype(np.float32))
    if values.shape[-1] == 1:
        values = np.repeat(values, 3, axis=-1)
    missing = max(3 - values.shape[-1], 0)
    return np.pad(values, ((0, 0), (0, 0), (0, missing)))[..., :3]
