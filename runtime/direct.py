"""Direct light: the lights' buffers, their shadow maps and reflective shadow maps, and the pass that lights
pixels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fit.scene import Float64
from runtime.device import Gpu
from runtime.encoder import Recorder
from runtime.kernel import Kernel, RasterKernel, Resource
from runtime.lights import AnyLight, Light, Lighting, Tile, light_records, plan_tiles, untiled_notes
from runtime.meshes import VERTEX, SceneMeshes
from runtime.primary import GBuffer
from runtime.resources import Buffer, Sampler, Texture
from runtime.settings import ShadowSettings

RSM_TARGETS = {"rsm_normal": "r32uint", "rsm_radiance": "rgba16float"}


class LightMaps:
    """The lights on the GPU, with one atlas of shadow maps that are reflective shadow maps too.

    The maps are drawn again only when a light or an instance has moved; colours may change for free.
    Without meshes there are no maps and every light is shadowed by tracing the primitives.
    """

    def __init__(
        self, gpu: Gpu, origin: Float64, settings: ShadowSettings, meshes: SceneMeshes | None
    ) -> None:
        self._gpu = gpu
        self._origin = origin
        self._settings = settings
        self._meshes = meshes
        self._header = Buffer(gpu, Lighting.dtype.itemsize, "uniform", label="lighting")
        self._sampler = Sampler(gpu, "linear", compare="greater-equal", label="shadow_sampler")
        self._kernel: RasterKernel | None = None
        self._records = Buffer(gpu, Light.dtype.itemsize, "storage", label="lights")
        self._tiles: tuple[Tile, ...] = ()
        self._tile_records: list[Buffer] = []
        self._seen: list[bytes] = []
        self._is_stale = False
        self._make_atlas((1, 1))
        self.lights: tuple[AnyLight, ...] = ()
        self.notes: tuple[str, ...] = ()
        self.set(())

    def set(self, lights: Sequence[AnyLight]) -> None:
        """Replaces the lights."""
        bounds = None if self._meshes is None else self._meshes.bounds()
        self._tiles, size = plan_tiles(lights, bounds, self._origin, self._settings)
        if size != self._depth.size[:2]:
            self._make_atlas(size)
        records = light_records(lights, self._tiles, self._origin)
        if records.nbytes != self._records.size:
            self._records = Buffer(self._gpu, records, "storage", label="lights")
        else:
            self._records.write(records)
        self._header.write(
            Lighting.pack(
                atlas_size=size,
                count=len(lights),
                rsm_tolerance=_rsm_tolerance(bounds, self._settings),
                rsm_normal_agreement=self._settings.rsm_normal_agreement,
            )
        )
        self._place_tiles(records)
        self.lights = tuple(lights)
        self.notes = untiled_notes(lights, self._tiles) if self._meshes is not None else ()

    def bindings(self) -> dict[str, Resource]:
        """What `lib/lights.wgsl` binds."""
        return {
            "lighting": self._header,
            "lights": self._records,
            "shadow_depth": self._depth,
            "shadow_sampler": self._sampler,
            **self._targets,
        }

    def invalidate(self) -> None:
        """Says that an instance has moved: the views are placed anew and drawn in the next frame."""
        self.set(self.lights)
        self._is_stale = True

    def record(self, rec: Recorder) -> None:
        """Draws the views of the lights that have one, if anything in them has moved."""
        if not self._tiles or self._meshes is None or not self._is_stale:
            return
        if self._kernel is None:
            self._kernel = RasterKernel(
                self._gpu,
                "direct/draw_light_view",
                list(RSM_TARGETS.values()),
                vertex_buffers=[VERTEX],
                depth_compare="greater",
            )
        targets = [self._targets[name] for name in RSM_TARGETS]
        with rec.render(self._kernel.name, targets, self._depth, clear_depth=0.0) as render_pass:
            for tile, light in zip(self._tiles, self._tile_records, strict=True):
                render_pass.set_viewport(*tile.corner, tile.size, tile.size, 0.0, 1.0)
                render_pass.set_scissor_rect(*tile.corner, tile.size, tile.size)
                self._meshes.draw(render_pass, self._kernel, light=light)
        self._is_stale = False

    def _place_tiles(self, records: np.ndarray) -> None:
        """Hands each view its light; they need drawing when anything but a colour has changed."""
        seen = records[[tile.light for tile in self._tiles]]
        seen["color"] = 1.0
        described = [record.tobytes() for record in seen]
        if described != self._seen:
            self._seen, self._is_stale = described, True
            self._tile_records = [Buffer(self._gpu, record, "uniform", label="light") for record in seen]

    def _make_atlas(self, size: tuple[int, int]) -> None:
        self._depth = Texture(self._gpu, size, "depth32float", "sample|render", label="shadow_depth")
        self._targets = {
            name: Texture(self._gpu, size, format, "sample|render", label=name)
            for name, format in RSM_TARGETS.items()
        }
        self._is_stale = True


def _rsm_tolerance(bounds: tuple[Float64, Float64] | None, settings: ShadowSettings) -> float:
    """Metres; files lie about units, so that in a small scene a fixed length would reach through the air."""
    if bounds is None:
        return settings.rsm_tolerance
    diagonal = float(np.linalg.norm(bounds[1] - bounds[0]))
    return min(settings.rsm_tolerance, settings.rsm_tolerance_share * diagonal)


class DirectLight:
    """Lights every pixel of a G-buffer: sun, spots and points, with shadows."""

    def __init__(self, gpu: Gpu, size: tuple[int, int]) -> None:
        self._kernel = Kernel(gpu, "direct/light_pixels")
        self._size = size
        self.irradiance = Texture(gpu, size, "rgba32float", "sample|storage", label="direct_irradiance")

    def record(
        self,
        rec: Recorder,
        gbuffer: GBuffer,
        world: Mapping[str, Resource],
        frame: Mapping[str, Resource],
    ) -> None:
        """Fills `irradiance`, W/m2."""
        self._kernel.dispatch_pass(
            rec, self._size, world, frame, gbuffer.bindings(), pixel_irradiance=self.irradiance
        )
