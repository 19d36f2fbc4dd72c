"""Pictures by path tracing, with the same layers as every other picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fit.primitives import PrimitiveSet
from fit.scene import Float64
from pipelines.console import Update
from pipelines.gi_errors.pixels import Pixels
from pipelines.gi_errors.truth import Truth, TruthSettings
from pipelines.studio import Studio
from runtime.estimate import Estimate
from runtime.images import encode
from runtime.renderer import Result

LIT = ("final", "direct", "indirect", "irradiance")
"""Layers that path tracing gives; the others are our own G-buffer's."""


@dataclass(frozen=True)
class ReferencePicture:
    """The picture, and what it was measured with: samples a pixel, and mean absolute noise of the picture
    (of the irradiance, where the runtime traced it), a share of its mean."""

    result: Result
    samples: int
    noise: float

    def describe(self) -> dict[str, Any]:
        """A report's keys."""
        return {"samples": self.samples, "noise": self.noise}


def render_reference(
    studio: Studio, settings: TruthSettings, views: Sequence[str], progress: Update | None = None
) -> ReferencePicture:
    """The layers `views` and the final picture, path traced, or as they were kept.

    Raises:
        MissingMitsuba: the engine is Mitsuba and it is not installed.
        ValueError: the camera sees nothing of the scene.
    """
    truth = Truth(studio.gpu, studio.illumination, settings)
    if settings.engine == "reference-gpu":
        return _by_runtime(studio, truth, views, progress)
    return _by_mitsuba(studio, truth, views, progress)


def _by_mitsuba(
    studio: Studio, truth: Truth, views: Sequence[str], progress: Update | None
) -> ReferencePicture:
    camera = studio.view.camera
    picture = truth.picture(studio.scene, camera, studio.size, _bar(progress, "path trace the picture"))
    layers = {"final": picture.beauty.value, "direct": picture.direct, "indirect": picture.indirect}
    if "irradiance" in views:
        pixels = Pixels.of(studio)
        layers["irradiance"] = pixels.image(_irradiance(studio, truth, pixels, progress).value)
    result = _result(studio, views, layers, (*truth.notes(), *picture.notes))
    return ReferencePicture(result, picture.beauty.samples, picture.beauty.noise)


def _by_runtime(
    studio: Studio, truth: Truth, views: Sequence[str], progress: Update | None
) -> ReferencePicture:
    pixels = Pixels.of(studio)
    estimate = _irradiance(studio, truth, pixels, progress)
    final = pixels.radiance(estimate.value)
    layers = {
        "final": final,
        "direct": pixels.direct,
        "indirect": final - pixels.direct,
        "irradiance": pixels.image(estimate.value),
    }
    return ReferencePicture(_result(studio, views, layers, ()), estimate.samples, estimate.noise)


def _irradiance(studio: Studio, truth: Truth, pixels: Pixels, progress: Update | None) -> Estimate:
    bar = _bar(progress, "path trace the irradiance")
    return truth.of_mesh(studio.scene, pixels.points, pixels.normals, bar)


def _result(
    studio: Studio, views: Sequence[str], layers: dict[str, Float64], notes: tuple[str, ...]
) -> Result:
    """With the layers of our G-buffer that are asked for too."""
    own = tuple(name for name in views if name not in LIT)
    drawn = studio.render(PrimitiveSet.empty(), "none", 1, own)
    images = {name: drawn.images[name] for name in own}
    images |= {name: layer.astype(np.float32) for name, layer in layers.items()}
    settings = drawn.settings
    picture = encode(images["final"], settings.exposure, settings.tone_curve)
    return replace(drawn, images=images, picture=picture, timings={}, frames=0, notes=(*drawn.notes, *notes))


def _bar(progress: Update | None, text: str) -> Any:
    return None if progress is None else lambda share: progress(text, share)
