"""The scene that every other module reads: frozen dataclasses of NumPy arrays.

Units are glTF's: metres, radians, linear Rec.709, Y up, right-handed. Matrices are (4, 4) float64, act on
column vectors, and are named to-from (`world_from_local`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
UInt32 = NDArray[np.uint32]
UInt8 = NDArray[np.uint8]


class AlphaMode(StrEnum):
    OPAQUE = "OPAQUE"
    MASK = "MASK"
    BLEND = "BLEND"


class Wrap(StrEnum):
    REPEAT = "repeat"
    MIRROR = "mirror"
    CLAMP = "clamp"


class Interpolation(StrEnum):
    STEP = "STEP"
    LINEAR = "LINEAR"
    CUBIC_SPLINE = "CUBICSPLINE"


class LightKind(StrEnum):
    DIRECTIONAL = "directional"
    POINT = "point"
    SPOT = "spot"


@dataclass(frozen=True)
class Image:
    """Decoded pixels, (height, width, 4) uint8, row 0 on top, as stored (colour images are sRGB-encoded)."""

    name: str
    pixels: UInt8


@dataclass(frozen=True)
class Texture:
    """An image with its sampler."""

    image: int
    wrap_u: Wrap = Wrap.REPEAT
    wrap_v: Wrap = Wrap.REPEAT
    linear: bool = True


@dataclass(frozen=True)
class TextureUse:
    """A texture as a material uses it: which texture, which texture coordinates, and their transform.

    `transform` is the (3, 3) matrix of KHR_texture_transform, acting on (u, v, 1); v runs downward.
    """

    texture: int
    texcoord: int = 0
    transform: Float64 = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True)
class Material:
    """glTF metallic-roughness material; factors are linear, `emission` already holds its strength."""

    name: str = "default"
    base_color: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    base_color_texture: TextureUse | None = None
    metallic: float = 1.0
    roughness: float = 1.0
    metallic_roughness_texture: TextureUse | None = None
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    emission_texture: TextureUse | None = None
    alpha_mode: AlphaMode = AlphaMode.OPAQUE
    alpha_cutoff: float = 0.5
    double_sided: bool = False
    unlit: bool = False
    transmission: float = 0.0


@dataclass(frozen=True)
class Mesh:
    """One glTF primitive: triangles of one material in their own local space, morph targets mixed in.

    positions (n, 3) float64, normals (n, 3) float64 of unit length (computed where the file has none),
    texcoords one (n, 2) float64 for each set, colors (n, 4) float64 linear or None, triangles (m, 3) uint32.
    """

    name: str
    positions: Float64
    normals: Float64
    triangles: UInt32
    material: int
    texcoords: tuple[Float64, ...] = ()
    colors: Float64 | None = None


@dataclass(frozen=True)
class Node:
    """A node of the graph; `parent` is -1 for a root."""

    name: str
    parent: int
    local: Float64
    world_from_local: Float64


@dataclass(frozen=True)
class Instance:
    """A mesh drawn at a place: `world_from_local` is its node's, times `node_from_local` of a GPU instance.

    A skinned mesh is posed in world space already: it has the identity, and None for `node_from_local`, since
    it follows its joints and not its node.
    """

    mesh: int
    node: int
    world_from_local: Float64
    node_from_local: Float64 | None = field(default_factory=lambda: np.eye(4))


@dataclass(frozen=True)
class Light:
    """A punctual light: lux and candela read as W/m2 and W/sr. It shines along local -Z of its `node`."""

    name: str
    kind: LightKind
    color: tuple[float, float, float]
    intensity: float
    world_from_local: Float64
    range: float = float("inf")
    inner_cone_angle: float = 0.0
    outer_cone_angle: float = np.pi / 4
    node: int = -1


@dataclass(frozen=True)
class Camera:
    """A camera looking along local -Z. Perspective when `yfov` is given, else orthographic with `ymag`.

    `node` carries it.
    """

    name: str
    world_from_local: Float64
    yfov: float | None = None
    ymag: float | None = None
    aspect_ratio: float | None = None
    znear: float = 0.01
    zfar: float | None = None
    node: int = -1


@dataclass(frozen=True)
class Curve:
    """A value over time: `times` (k,), seconds, strictly rising, and `values` (k, n) at them.

    Of CUBIC_SPLINE, `values` is (k, 3, n): the tangent that leads in, the value, the tangent that leads out.
    Before the first time and after the last the value stays. One key is a constant.
    """

    times: Float64
    values: Float64
    interpolation: Interpolation = Interpolation.LINEAR


@dataclass(frozen=True)
class Motion:
    """How a node moves in its parent: translation (3,), rotation (4,), a quaternion xyzw, and scale (3,).

    What the animation leaves alone is a curve of one key, the node's rest.
    """

    node: int
    translation: Curve
    rotation: Curve
    scale: Curve


@dataclass(frozen=True)
class Animation:
    """Motions that belong together, at most one a node."""

    name: str
    motions: tuple[Motion, ...]

    @property
    def duration(self) -> float:
        """Seconds until the last key."""
        curves = (c for m in self.motions for c in (m.translation, m.rotation, m.scale))
        return max((float(curve.times[-1]) for curve in curves if len(curve.times) > 1), default=0.0)


@dataclass(frozen=True)
class Scene:
    """A whole file. `repairs` counts what was mended, `ignored` names what was left out."""

    source: Path
    meshes: tuple[Mesh, ...] = ()
    materials: tuple[Material, ...] = ()
    textures: tuple[Texture, ...] = ()
    images: tuple[Image, ...] = ()
    nodes: tuple[Node, ...] = ()
    instances: tuple[Instance, ...] = ()
    lights: tuple[Light, ...] = ()
    cameras: tuple[Camera, ...] = ()
    animations: tuple[Animation, ...] = ()
    extensions: tuple[str, ...] = ()
    repairs: dict[str, int] = field(default_factory=dict)
    ignored: tuple[str, ...] = ()

    @property
    def triangle_count(self) -> int:
        """Triangles drawn: each mesh counted once for each instance."""
        return sum(len(self.meshes[i.mesh].triangles) for i in self.instances)

    def bounds(self) -> tuple[Float64, Float64]:
        """Corners (3,), (3,) of the world-space box around every drawn triangle.

        Raises:
            ValueError: nothing is drawn.
        """
        lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
        for instance in self.instances:
            mesh = self.meshes[instance.mesh]
            if len(mesh.triangles) == 0:
                continue
            points = transform_points(instance.world_from_local, mesh.positions[np.unique(mesh.triangles)])
            lower, upper = np.minimum(lower, points.min(axis=0)), np.maximum(upper, points.max(axis=0))
        if not np.all(lower <= upper):
            raise ValueError(f"{self.source}: the scene draws no triangle, so it has no bounds")
        return lower, upper


def transform_points(matrix: Float64, points: Float64) -> Float64:
    """Points (n, 3) through an affine (4, 4) matrix."""
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def normal_matrix(matrices: Float64) -> Float64:
    """What carries normals (not unit ones) through linear maps (..., 3, 3), mirrors and uneven scales too.

    The cofactors with the determinant's sign: the transposed inverse without its division, so flat maps pass.
    """
    a, b, c = matrices[..., 0, :], matrices[..., 1, :], matrices[..., 2, :]
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-2)
    mirrored = np.einsum("...i,...i->...", a, cofactors[..., 0, :]) < 0
    return np.where(mirrored[..., None, None], -cofactors, cofactors)
