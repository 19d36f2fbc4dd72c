"""glTF materials as Mitsuba's: diffuse base colour, cut-outs, emission; every face two-sided."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.scene import AlphaMode, Float64, Material, Mesh, Scene, TextureUse, Wrap
from runtime.meshes import BLEND_CUTOFF
from runtime.twins.color import color_linear_from_srgb

Float32 = NDArray[np.float32]

WRAPS = {Wrap.REPEAT: "repeat", Wrap.MIRROR: "mirror", Wrap.CLAMP: "clamp"}

CUTOUT_SCALE = 8
"""Alpha is filtered to so many texels a texel and cut there: Mitsuba's mask is a share, glTF's a limit."""


class Surfaces:
    """BSDFs and emitters of a scene's materials, each made once."""

    def __init__(self, mi: Any, scene: Scene) -> None:
        self._mi, self._scene = mi, scene
        self.notes: tuple[str, ...] = ()
        self.bsdf = cache(self._bsdf)
        self.emission = cache(self._emission)

    def material(self, index: int) -> Material:
        materials = self._scene.materials
        return materials[index] if 0 <= index < len(materials) else Material()

    def coordinates(self, index: int) -> TextureUse | None:
        """Whose texture coordinates a mesh is written with: Mitsuba's have one set for all textures."""
        material = self.material(index)
        base, emission = material.base_color_texture, material.emission_texture
        if not any(material.emission) or emission is None:
            return base
        if base is None:
            return emission
        if base.texcoord != emission.texcoord or not np.array_equal(base.transform, emission.transform):
            self._note(f"material {material.name!r} emits by the coordinates of its base colour, not its own")
        return base

    def vertex_colors(self, mesh: Mesh) -> Float64 | None:
        """Linear colours (n, 3) of vertices times the material's factor, where they are all that there is."""
        material = self.material(mesh.material)
        if mesh.colors is None:
            return None
        if material.base_color_texture is not None:
            if (mesh.colors[:, :3] != 1).any():
                self._note(f"mesh {mesh.name!r} has vertex colours, which its texture is not multiplied by")
            return None
        return np.asarray(mesh.colors[:, :3] * np.array(material.base_color[:3]))

    def _note(self, text: str) -> None:
        self.notes = tuple(dict.fromkeys((*self.notes, text)))

    def _bsdf(self, index: int, has_colors: bool) -> dict[str, Any]:
        material = self.material(index)
        factor = np.array(material.base_color[:3], np.float32)
        use = material.base_color_texture
        reflectance = self._color_texture(use, factor)
        if has_colors:
            reflectance = {"type": "mesh_attribute", "name": "vertex_color"}
        diffuse = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": reflectance}}
        cutoff = {AlphaMode.MASK: material.alpha_cutoff, AlphaMode.BLEND: BLEND_CUTOFF}.get(
            material.alpha_mode
        )
        if cutoff is None:
            return diffuse
        if use is None:
            opacity: Any = 1.0 if material.base_color[3] >= cutoff else 0.0
        else:
            opacity = self._cutout(use, material.base_color[3], cutoff)
        return {"type": "mask", "opacity": opacity, "nested": diffuse}

    def _emission(self, index: int) -> dict[str, Any] | None:
        material = self.material(index)
        if not any(material.emission):
            return None
        factor = np.array(material.emission, np.float32)
        return {"type": "area", "radiance": self._color_texture(material.emission_texture, factor)}

    def _color_texture(self, use: TextureUse | None, factor: Float32) -> dict[str, Any]:
        if use is None:
            return {"type": "rgb", "value": factor.tolist()}
        pixels = self._pixels(use)[..., :3]
        linear = color_linear_from_srgb(pixels.astype(np.float64) / 255) * factor
        return self._bitmap(use, linear.astype(np.float32), self._scene.textures[use.texture].linear)

    def _cutout(self, use: TextureUse, factor: float, cutoff: float) -> dict[str, Any]:
        alpha = self._pixels(use)[..., 3].astype(np.float32) * (factor / 255)
        texture = self._scene.textures[use.texture]
        if texture.linear:
            wrap = {Wrap.REPEAT: "wrap", Wrap.MIRROR: "symmetric", Wrap.CLAMP: "edge"}
            alpha = _enlarged(alpha, wrap[texture.wrap_v], wrap[texture.wrap_u])
        return self._bitmap(use, (alpha >= cutoff).astype(np.float32)[..., None], linear=False)

    def _pixels(self, use: TextureUse) -> NDArray[np.uint8]:
        return self._scene.images[self._scene.textures[use.texture].image].pixels

    def _bitmap(self, use: TextureUse, values: Float32, linear: bool) -> dict[str, Any]:
        texture = self._scene.textures[use.texture]
        if texture.wrap_u != texture.wrap_v:
            self._note(
                f"texture {use.texture} wraps by {texture.wrap_u} along v too: Mitsuba knows one way for both"
            )
        return {
            "type": "bitmap",
            "bitmap": self._mi.Bitmap(np.ascontiguousarray(values)),
            "raw": True,
            "filter_type": "bilinear" if linear else "nearest",
            "wrap_mode": WRAPS[texture.wrap_u],
        }


def _enlarged(values: Float32, wrap_rows: str, wrap_columns: str) -> Float32:
    """(h, w) filtered bilinearly at CUTOUT_SCALE times as many texel centres; borders go on as it wraps."""
    for axis, wrap in ((0, wrap_rows), (1, wrap_columns)):
        pad = [(1, 1) if k == axis else (0, 0) for k in range(2)]
        padded = np.pad(values, pad, mode=wrap)  # type: ignore[call-overload]
        place = (np.arange(values.shape[axis] * CUTOUT_SCALE) + 0.5) / CUTOUT_SCALE + 0.5
        low = np.floor(place).astype(np.int64)
        share = (place - low).astype(np.float32)
        share = share[:, None] if axis == 0 else share[None]
        first, second = (
            np.take(padded, low, axis),
            np.take(padded, np.minimum(low + 1, padded.shape[axis] - 1), axis),
        )
        values = first * (1 - share) + second * share
    return values
