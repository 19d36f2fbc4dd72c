"""What Mitsuba measures in a scene: pictures, and irradiance at points, each with the noise that is left."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fit.scene import Camera, Float64
from pipelines.reference.centres import make_camera
from pipelines.reference.points import make_sensor
from runtime.estimate import Estimate

Float32 = NDArray[np.float32]

START = 1e-5
"""Of the diagonal: how far off its surface a point starts to look around."""

ROULETTE_DEPTH = 8
"""Bounces after which paths end by chance; none ends otherwise."""

SAMPLES_AT_ONCE = 16
"""Samples a pixel of one pass; passes are what progress, target errors and halves are made of."""

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Picture:
    """Layers (height, width, 3) in scene units, row 0 on top. direct: suns, spots and points alone,
    reflected; indirect: all the rest that surfaces reflect or emit, and the background."""

    beauty: Estimate
    direct: Float64
    notes: tuple[str, ...] = ()

    @property
    def indirect(self) -> Float64:
        return self.beauty.value - self.direct


class Reference:
    """A Mitsuba scene in local space: world minus `origin`. `notes` tells what Mitsuba does differently."""

    def __init__(
        self,
        mi: Any,
        shapes: dict[str, Any],
        lights: dict[str, Any],
        origin: Float64,
        diagonal: float,
        notes: tuple[str, ...] = (),
    ) -> None:
        self._mi, self.origin, self.diagonal, self.notes = mi, origin, diagonal, notes
        # `path` takes cut-outs for walls on the way to a lamp; `volpath` does not, and costs more.
        has_cutouts = any(shape["bsdf"]["type"] == "mask" for shape in shapes.values())
        kind = "volpath" if has_cutouts else "path"
        painted = _load_surfaces(mi, shapes)
        dark = {name: mi.load_dict(_without_emission(shape)) for name, shape in painted.items()}
        bright = {name: shape if "emitter" in shape else dark[name] for name, shape in painted.items()}
        path = {"type": kind, "max_depth": -1, "rr_depth": ROULETTE_DEPTH}
        self._scene = _load_scene(mi, path, bright, lights)
        # One scene for each lamp: from among several, Mitsuba would choose by chance.
        self._lamps = [
            _load_scene(mi, {"type": kind, "max_depth": 2}, dark, {name: light})
            for name, light in lights.items()
            if name != "sky"
        ]

    def picture(
        self,
        camera: Camera,
        size: tuple[int, int],
        *,
        samples: int = 64,
        target: float | None = None,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> Picture:
        """What the camera sees through pixel centres, with `samples` a pixel, fewer when the noise falls
        under `target` before.

        target: mean absolute noise as a share of the mean.
        """
        sensor = make_camera(self._mi, _sensor(self._mi, camera, size, self.origin))
        beauty = self._estimate(sensor, samples, target, seed, progress)
        return Picture(beauty, self.direct(camera, size), self.notes)

    def direct(self, camera: Camera, size: tuple[int, int]) -> Float64:
        """What suns, spots and points make surfaces reflect to the camera, (height, width, 3): exact, because
        none of them has a size."""
        sensor = make_camera(self._mi, _sensor(self._mi, camera, size, self.origin))
        lit = [self._render(lamp, sensor, 1, 0) for lamp in self._lamps]
        return np.sum([np.zeros((size[1], size[0], 3)), *lit], axis=0)

    def irradiance(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        *,
        samples: int = 256,
        target: float | None = None,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> Estimate:
        """Indirect E, W/m2, at world points (n, 3) with unit normals (n, 3): sky, emission, all bounces.

        Suns, spots and points count by what they light, not by what they send to the point itself.
        """
        unit = np.asarray(normals, np.float64)
        starts = np.asarray(points, np.float64) - self.origin + START * self.diagonal * unit
        if len(starts) == 0:
            return Estimate.of_nothing()
        sensor, _ = make_sensor(self._mi, self._scene, starts, unit)
        estimate = self._estimate(sensor, samples, target, seed, progress)
        rows = slice(0, len(starts))
        return Estimate(
            estimate.value.reshape(-1, 3)[rows],
            estimate.first.reshape(-1, 3)[rows],
            estimate.second.reshape(-1, 3)[rows],
            estimate.standard_error.reshape(-1)[rows],
            estimate.samples,
        )

    def _estimate(
        self, sensor: Any, samples: int, target: float | None, seed: int, progress: Progress | None
    ) -> Estimate:
        if samples < 2:
            raise ValueError(f"{samples} samples: the noise can only be told from at least 2")
        at_once = min(SAMPLES_AT_ONCE, -(-samples // 2))
        passes = -(-samples // at_once)
        sums: list[Any] = [0.0, 0.0]
        counts = [0, 0]
        squares: Any = 0.0
        for number in range(passes):
            picture = self._render(self._scene, sensor, at_once, seed * 65536 + number)
            sums[number % 2] = sums[number % 2] + picture
            counts[number % 2] += 1
            squares = squares + picture.mean(axis=-1) ** 2
            estimate = _summary(sums, counts, squares, at_once) if counts[1] else None
            if progress:
                progress((number + 1) / passes)
            if target is not None and estimate is not None and estimate.noise <= target:
                break
        return _summary(sums, counts, squares, at_once)

    def _render(self, scene: Any, sensor: Any, samples: int, seed: int) -> Float64:
        return np.array(self._mi.render(scene, sensor=sensor, spp=samples, seed=seed), np.float64)[..., :3]


def _load_surfaces(mi: Any, shapes: dict[str, Any]) -> dict[str, Any]:
    """Shapes with their BSDFs loaded: one that several share, with all its textures, once."""
    bsdfs = {id(shape["bsdf"]): shape["bsdf"] for shape in shapes.values()}
    loaded = {key: mi.load_dict(bsdf) for key, bsdf in bsdfs.items()}
    return {name: {**shape, "bsdf": loaded[id(shape["bsdf"])]} for name, shape in shapes.items()}


def _without_emission(shape: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in shape.items() if key != "emitter"}


def _load_scene(mi: Any, integrator: dict[str, Any], shapes: dict[str, Any], lights: dict[str, Any]) -> Any:
    """Without Mitsuba's merging of shapes: merged rectangles lose their bounds, and suns leak in."""
    scene = {"type": "scene", "integrator": integrator, **shapes, **lights}
    return mi.load_dict(scene, optimize=False)


def _summary(sums: list[Any], counts: list[int], squares: Any, at_once: int) -> Estimate:
    total = sum(counts)
    value = (sums[0] + sums[1]) / total
    spread = np.maximum(squares / total - value.mean(axis=-1) ** 2, 0)
    error = np.sqrt(spread / max(total - 1, 1))
    return Estimate(value, sums[0] / counts[0], sums[1] / counts[1], error, total * at_once)


def _sensor(mi: Any, camera: Camera, size: tuple[int, int], origin: Float64) -> dict[str, Any]:
    """A glTF camera looks along -Z with x to the right, Mitsuba's along +Z with x to the left."""
    local = camera.world_from_local.copy()
    local[:3, 3] -= origin
    matrix = local @ np.diag([-1.0, 1.0, -1.0, 1.0])
    film = {
        "type": "hdrfilm",
        "width": size[0],
        "height": size[1],
        "component_format": "float32",
        "pixel_format": "rgb",
        "rfilter": {"type": "box"},
    }
    sensor: dict[str, Any] = {"film": film, "sampler": {"type": "independent"}, "near_clip": camera.znear}
    if camera.yfov is not None:
        fov = {"fov": float(np.degrees(camera.yfov)), "fov_axis": "y"}
        return sensor | {"type": "perspective", "to_world": mi.ScalarTransform4f(matrix)} | fov
    if camera.ymag is None:
        raise ValueError(f"camera {camera.name!r} has neither yfov nor ymag: give it one")
    half_width = camera.ymag * size[0] / size[1]
    scaled = matrix @ np.diag([half_width, half_width, 1.0, 1.0])
    return sensor | {"type": "orthographic", "to_world": mi.ScalarTransform4f(scaled)}
