"""The G-buffer: what every pixel sees, drawn from the textured triangles."""

from __future__ import annotations

from runtime.device import Gpu
from runtime.encoder import Recorder
from runtime.kernel import RasterKernel, Resource
from runtime.meshes import VERTEX, SceneMeshes
from runtime.resources import Texture

TARGETS = {
    "gbuffer_normals": "rg32uint",  # shading and face normal, 32 bits each
    "gbuffer_albedo": "rgba16float",  # albedo, roughness
    "gbuffer_emission": "rgba16float",  # emission, metalness
    "gbuffer_motion": "rg32float",  # previous minus current place, in shares of the picture
}


class GBuffer:
    """Textures of one picture size. Depth is reversed; 0 is the background, where everything else is 0
    too."""

    def __init__(self, gpu: Gpu, size: tuple[int, int]) -> None:
        self.size = size
        self.depth = Texture(gpu, size, "depth32float", "sample|render", label="gbuffer_depth")
        self.colors = {
            name: Texture(gpu, size, format, "sample|render", label=name) for name, format in TARGETS.items()
        }

    def bindings(self) -> dict[str, Resource]:
        """What `primary/gbuffer` binds."""
        return {"gbuffer_depth": self.depth, **self.colors}


class GBufferPass:
    """Draws a scene into a G-buffer."""

    def __init__(self, gpu: Gpu) -> None:
        self._kernel = RasterKernel(
            gpu,
            "primary/draw_gbuffer",
            list(TARGETS.values()),
            vertex_buffers=[VERTEX],
            depth_compare="greater",
        )

    def record(self, rec: Recorder, meshes: SceneMeshes, target: GBuffer, frame: dict[str, Resource]) -> None:
        """Clears the G-buffer and draws every triangle."""
        with rec.render(
            self._kernel.name, list(target.colors.values()), target.depth, clear_depth=0.0
        ) as render_pass:
            meshes.draw(render_pass, self._kernel, [frame])
