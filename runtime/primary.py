"""The G-buffer: what every pixel sees, drawn from the textured triangles."""

from __future__ import annotations

from runtime.device import Gpu
from runtime.encoder import Recorder
from runtime.kernel import RasterKernel, Resource
from runtime.meshes import VERTEX, SceneMeshes
from runtime.resources import PingPong, Texture

TARGETS = {
    "gbuffer_normals": "rg32uint",  # shading and face normal, 32 bits each
    "gbuffer_albedo": "rgba16float",  # albedo, roughness
    "gbuffer_emission": "rgba16float",  # emission, metalness
    "gbuffer_motion": "rgba32float",  # previous minus current place, in shares of the picture; depth there
}

KEPT = "gbuffer_normals"
"""The target that is kept for a frame, with the depth, for what reuses the last frame's pixels."""


class GBuffer:
    """Textures of one picture size, and the last picture's depth and normals. Depth is reversed; 0 is the
    background, where everything else is 0 too."""

    def __init__(self, gpu: Gpu, size: tuple[int, int]) -> None:
        def target(name: str, format: str) -> Texture:
            return Texture(gpu, size, format, "sample|render", label=name)

        self.size = size
        self._depths = PingPong(*(target("gbuffer_depth", "depth32float") for _ in range(2)))
        self._kept = PingPong(*(target(KEPT, TARGETS[KEPT]) for _ in range(2)))
        self._others = {name: target(name, format) for name, format in TARGETS.items() if name != KEPT}

    def begin_frame(self) -> None:
        """Makes the last picture the previous one."""
        self._depths.swap()
        self._kept.swap()

    @property
    def depth(self) -> Texture:
        return self._depths.current

    @property
    def colors(self) -> dict[str, Texture]:
        """The colour targets by name, in the order of `TARGETS`."""
        return {name: self._kept.current if name == KEPT else self._others[name] for name in TARGETS}

    def bindings(self) -> dict[str, Resource]:
        """What `primary/gbuffer` and `primary/previous` bind."""
        previous = {"previous_depth": self._depths.previous, "previous_normals": self._kept.previous}
        return {"gbuffer_depth": self.depth, **self.colors, **previous}


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
