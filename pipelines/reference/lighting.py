"""Suns, spots, points and the sky as Mitsuba emitters, with glTF's falloff."""

from __future__ import annotations

from typing import Any

import numpy as np

from fit.scene import Float64
from runtime.lights import AnyLight, Illumination, Point, Spot, Sun
from runtime.sky import Sky

SKY_HEIGHT = 512
"""Rows of the picture that a gradient sky is handed over as."""

SPOT_TEXELS = 512
"""Width of the picture that carries a spot's falloff: Mitsuba's own is linear in the angle."""


def emitters(mi: Any, illumination: Illumination, origin: Float64) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Emitters of all lights and of the sky, and notes on what Mitsuba has no word for."""
    found = {f"light_{i}": _emitter(mi, light, origin) for i, light in enumerate(illumination.lights)}
    sky = sky_emitter(mi, illumination.sky)
    notes = tuple(
        f"{light.describe()}: its range is left out, Mitsuba's light never ends"
        for light in illumination.lights
        if not isinstance(light, Sun) and np.isfinite(light.range)
    )
    return (found if sky is None else found | {"sky": sky}), notes


def _emitter(mi: Any, light: AnyLight, origin: Float64) -> dict[str, Any]:
    strength = {"type": "rgb", "value": [float(value) for value in light.color]}
    if isinstance(light, Sun):
        away = -np.asarray(light.direction, np.float64)
        return {
            "type": "directional",
            "direction": (away / np.linalg.norm(away)).tolist(),
            "irradiance": strength,
        }
    position = np.asarray(light.position, np.float64) - origin
    if isinstance(light, Point):
        return {"type": "point", "position": position.tolist(), "intensity": strength}
    return _spot(mi, light, position, strength)


def _spot(mi: Any, light: Spot, position: Float64, strength: dict[str, Any]) -> dict[str, Any]:
    axis = np.asarray(light.axis, np.float64)
    up = np.eye(3)[int(np.argmin(np.abs(axis)))]
    cutoff = float(np.degrees(light.outer_cone_angle))
    return {
        "type": "spot",
        "to_world": mi.ScalarTransform4f().look_at(
            position.tolist(), (position + axis).tolist(), up.tolist()
        ),
        "intensity": strength,
        "cutoff_angle": cutoff,
        "beam_width": cutoff,
        "texture": {
            "type": "bitmap",
            "bitmap": mi.Bitmap(_falloff(light)),
            "raw": True,
            "wrap_mode": "clamp",
        },
    }


def _falloff(light: Spot) -> np.ndarray:
    """glTF's squared falloff over the square that Mitsuba projects from a spot, (n, n, 3) float32."""
    place = (np.arange(SPOT_TEXELS) + 0.5) / SPOT_TEXELS * 2 - 1
    x, y = np.meshgrid(place, place)
    cosine = 1 / np.sqrt(1 + (x * x + y * y) * np.tan(light.outer_cone_angle) ** 2)
    inner, outer = np.cos(light.inner_cone_angle), np.cos(light.outer_cone_angle)
    share = np.clip((cosine - outer) / max(inner - outer, 1e-3), 0, 1) ** 2
    return np.repeat(share[..., None], 3, axis=2).astype(np.float32)


def sky_emitter(mi: Any, sky: Sky) -> dict[str, Any] | None:
    """The sky; None for a black one."""
    if sky.is_black:
        return None
    if sky.picture is None and not any(sky.slope):
        return {
            "type": "constant",
            "radiance": {"type": "rgb", "value": [float(value) for value in sky.base]},
        }
    if sky.picture is not None:
        picture = sky.picture
    else:
        v, u = np.meshgrid(
            (np.arange(SKY_HEIGHT) + 0.5) / SKY_HEIGHT,
            (np.arange(2 * SKY_HEIGHT) + 0.5) / (2 * SKY_HEIGHT),
            indexing="ij",
        )
        polar, turn = np.pi * v, 2 * np.pi * u
        direction = np.stack(
            [np.sin(turn) * np.sin(polar), np.cos(polar), -np.cos(turn) * np.sin(polar)], axis=-1
        )
        picture = sky.radiance(direction.reshape(-1, 3)).reshape(*v.shape, 3)
    return {"type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(picture, np.float32))}
