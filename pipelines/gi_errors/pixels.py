"""The points at which irradiance is judged: every pixel of the mesh's G-buffer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.primitives import PrimitiveSet
from fit.scene import Camera, Float64
from pipelines.studio import Studio
from runtime.camera import local_from_view
from runtime.images import encode
from runtime.path_tracer import PathTracer
from runtime.settings import RenderSettings

Bool = NDArray[np.bool_]
UInt8 = NDArray[np.uint8]

LAYERS = ("position", "normal", "albedo", "direct")


@dataclass(frozen=True)
class Pixels:
    """One view of the mesh. shown (h, w): where there is geometry, n pixels; of these, in rows from the top:
    points, normals, towards_viewer, albedo (n, 3), world space. direct (h, w, 3): what suns, spots and
    points make surfaces reflect, by rays and not by shadow maps; unlit (h, w, 3): the picture
    without indirect light on surfaces."""

    shown: Bool
    points: Float64
    normals: Float64
    towards_viewer: Float64
    albedo: Float64
    direct: Float64
    unlit: Float64
    settings: RenderSettings

    @staticmethod
    def of(studio: Studio) -> Pixels:
        """What the studio's camera sees, at pixel centres.

        Raises:
            ValueError: the camera sees no geometry.
        """
        result = studio.render(PrimitiveSet.empty(), "none", 1, LAYERS)
        images = {name: np.asarray(image, np.float64) for name, image in result.images.items()}
        shown = (images["normal"] != 0).any(axis=-1)
        if not shown.any():
            raise ValueError(f"the camera ({studio.view.origin}) sees nothing of the scene: choose another")
        points, normals, albedo = (images[name][shown] for name in ("position", "normal", "albedo"))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        tracer = PathTracer(studio.gpu, studio.scene, studio.illumination)
        direct = np.zeros_like(images["direct"])
        direct[shown] = albedo / np.pi * tracer.direct(points, normals)
        unlit = images["final"] - images["direct"] + direct
        towards_viewer = _towards_viewer(studio.view.camera, points)
        return Pixels(shown, points, normals, towards_viewer, albedo, direct, unlit, result.settings)

    def rows(self, image: NDArray[np.floating]) -> Float64:
        """Of a picture (h, w, 3), what the points show (n, 3)."""
        return np.asarray(image, np.float64)[self.shown]

    def image(self, rows: NDArray[np.floating]) -> Float64:
        """Values of the points (n, 3) as a picture (h, w, 3), 0 elsewhere."""
        picture = np.zeros((*self.shown.shape, 3))
        picture[self.shown] = rows
        return picture

    def radiance(self, irradiance: NDArray[np.floating]) -> Float64:
        """The picture (h, w, 3) under this indirect irradiance (n, 3)."""
        return self.unlit + self.image(self.albedo / np.pi * irradiance)

    def display(self, irradiance: NDArray[np.floating]) -> UInt8:
        """The same as sRGB bytes, by the exposure and the tone curve of every other picture."""
        radiance = self.radiance(irradiance).astype(np.float32)
        return encode(radiance, self.settings.exposure, self.settings.tone_curve)


def _towards_viewer(camera: Camera, points: Float64) -> Float64:
    """As `frame_towards_viewer` of the shaders has it."""
    view = local_from_view(camera, np.zeros(3))
    if camera.yfov is None:
        return np.broadcast_to(view[:3, 2], points.shape).copy()
    way = view[:3, 3] - points
    return np.asarray(way / np.linalg.norm(way, axis=1, keepdims=True))
