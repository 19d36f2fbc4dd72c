"""The primitive set: boxes, spheres, cylinders and planes with albedo and emission, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fit import encoding, rotation

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
UInt32 = NDArray[np.uint32]

FACES = ("+x", "-x", "+y", "-y", "+z", "-z")
"""Order of the per-face colours of a primitive, in its local axes."""

PLANE_THICKNESS_LIMIT = 0.05
"""A finite plane is at most this share of its smaller size thick; thicker ones are boxes."""

GPU_RECORD_BYTES = 64
"""Size of one primitive on the GPU, colours and emission included."""


class Kind(IntEnum):
    BOX = 0
    SPHERE = 1
    CYLINDER = 2
    PLANE = 3


@dataclass(frozen=True)
class PrimitiveSet:
    """n primitives in world space.

    kinds (n,) uint8 of `Kind`; positions (n, 3) float64, the centre (a half-space: any point of its surface);
    rotations (n, 4) float64 unit quaternions, xyzw, world from local;
    sizes (n, 3) float64, full extents of the local bounding box: box (x, y, z); sphere (d, d, d);
    cylinder (d, height, d), its axis local Y; plane (size_x, thickness, size_z), its normal local +Y;
    a half-space is a plane of sizes (inf, 0, inf), solid below its surface;
    albedo, emission (n, 6, 3) float32 linear, one for each of `FACES` (emission is radiance, W/m2/sr).
    A sphere has one colour in all six; a cylinder one for its side (+-x, +-z) and one for each cap (+-y);
    a plane one for each side (+-y), its rim (+-x, +-z) the mean of both. `shared_face_colors` makes any six
    colours obey that. `names` holds n names or none. `nodes` holds, for each primitive, the index of the
    scene's node that it moves with (`fit.motion`), -1 where it stands; none where all stand.
    """

    kinds: NDArray[np.uint8]
    positions: Float64
    rotations: Float64
    sizes: Float64
    albedo: Float32
    emission: Float32
    names: tuple[str, ...] = ()
    nodes: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.kinds)

    @staticmethod
    def empty() -> PrimitiveSet:
        """The set of no primitives."""
        return PrimitiveSet(
            kinds=np.zeros(0, np.uint8),
            positions=np.zeros((0, 3)),
            rotations=np.zeros((0, 4)),
            sizes=np.zeros((0, 3)),
            albedo=np.zeros((0, 6, 3), np.float32),
            emission=np.zeros((0, 6, 3), np.float32),
        )

    @staticmethod
    def concatenate(sets: Sequence[PrimitiveSet]) -> PrimitiveSet:
        """All primitives of `sets`, in order. Names and nodes are kept when any set has them; the others get
        '' and -1.
        """
        sets = [s for s in sets if len(s)]
        if not sets:
            return PrimitiveSet.empty()
        names: list[str] = []
        if any(s.names for s in sets):
            for s in sets:
                names += s.names or ("",) * len(s)
        nodes: list[int] = []
        if any(s.nodes for s in sets):
            for s in sets:
                nodes += s.nodes or (-1,) * len(s)
        return PrimitiveSet(
            kinds=np.concatenate([s.kinds for s in sets]),
            positions=np.concatenate([s.positions for s in sets]),
            rotations=np.concatenate([s.rotations for s in sets]),
            sizes=np.concatenate([s.sizes for s in sets]),
            albedo=np.concatenate([s.albedo for s in sets]),
            emission=np.concatenate([s.emission for s in sets]),
            names=tuple(names),
            nodes=tuple(nodes),
        )

    def select(self, index: Any) -> PrimitiveSet:
        """The primitives that `index` picks: a slice, an integer or a list of them, or a mask (n,) bool."""
        chosen = np.atleast_1d(np.arange(len(self))[index])
        return PrimitiveSet(
            kinds=self.kinds[chosen],
            positions=self.positions[chosen],
            rotations=self.rotations[chosen],
            sizes=self.sizes[chosen],
            albedo=self.albedo[chosen],
            emission=self.emission[chosen],
            names=tuple(self.names[i] for i in chosen) if self.names else (),
            nodes=tuple(self.nodes[i] for i in chosen) if self.nodes else (),
        )

    def validate(self) -> PrimitiveSet:
        """This set, when it is one.

        Raises:
            ValueError: an array has a wrong shape or type, or a primitive breaks a rule of the class; the
                message names the primitive's index, the rule and the remedy.
        """
        _check_arrays(self)
        for check in (_check_placement, _check_sizes, _check_colors):
            check(self)
        return self

    def transformed(self, matrix: ArrayLike) -> PrimitiveSet:
        """The set moved by a (4, 4) matrix that acts on column vectors: a rotation, a move, a uniform scale.

        Raises:
            ValueError: the matrix shears, mirrors or scales unevenly, so that a sphere would not stay one.
        """
        scale, turn, move = _similarity(np.asarray(matrix, dtype=np.float64))
        return replace(
            self,
            positions=self.positions @ (scale * turn).T + move,
            rotations=rotation.normalized(
                rotation.multiply(rotation.quaternions_from_matrices(turn), self.rotations)
            ),
            sizes=self.sizes * scale,
        )

    def with_uniform_color(self, albedo: ArrayLike, emission: ArrayLike = (0.0, 0.0, 0.0)) -> PrimitiveSet:
        """The set with one albedo and one emission, (3,) each, on every face of every primitive."""
        return replace(
            self, albedo=_six_faces(albedo, len(self)), emission=_six_faces(emission, len(self))
        ).validate()

    @property
    def is_half_space(self) -> NDArray[np.bool_]:
        """Mask (n,) of the planes without end."""
        return (self.kinds == Kind.PLANE) & np.isinf(self.sizes[:, 0])

    def rotation_matrices(self) -> Float64:
        """World from local, (n, 3, 3)."""
        return rotation.matrices_from_quaternions(self.rotations)

    def boxes(self) -> tuple[Float64, Float64]:
        """Corners (n, 3), (n, 3) of each primitive's tight world-space box; infinite for half-spaces."""
        turn = np.abs(self.rotation_matrices())
        half = np.where(self.is_half_space[:, None], 0.0, self.sizes / 2)
        reach = np.einsum("nij,nj->ni", turn, half)
        sphere, cylinder = self.kinds == Kind.SPHERE, self.kinds == Kind.CYLINDER
        reach[sphere] = half[sphere]
        along = turn[cylinder, :, 1]
        across = np.sqrt(np.maximum(turn[cylinder, :, 0] ** 2 + turn[cylinder, :, 2] ** 2, 0.0))
        reach[cylinder] = half[cylinder, 1:2] * along + half[cylinder, 0:1] * across
        reach[self.is_half_space] = np.inf
        return self.positions - reach, self.positions + reach

    def bounds(self) -> tuple[Float64, Float64]:
        """Corners (3,), (3,) of the world-space box around the finite primitives.

        Raises:
            ValueError: the set has no finite primitive.
        """
        finite = self.select(~self.is_half_space)
        if len(finite) == 0:
            raise ValueError("the primitive set has no finite primitive, so it has no bounds")
        lower, upper = finite.boxes()
        return lower.min(axis=0), upper.max(axis=0)

    def bounding_radii(self) -> Float64:
        """Radius (n,) of the ball about each primitive's position that holds it; infinite for half-spaces."""
        half = np.where(self.is_half_space[:, None], np.inf, self.sizes / 2)
        half[self.kinds == Kind.SPHERE, 1:] = 0.0
        half[self.kinds == Kind.CYLINDER, 2] = 0.0
        radii: Float64 = np.linalg.norm(half, axis=1)
        return radii

    def face_areas(self) -> Float64:
        """Area (n, 6) that each of `FACES` stands for: a sixth of a sphere, a quarter of a cylinder's side;
        of a half-space, infinity for +y and 0 for the rest."""
        x, y, z = np.where(self.is_half_space[:, None], 1.0, self.sizes).T
        box = np.stack([y * z, y * z, x * z, x * z, x * y, x * y], axis=-1)
        side, cap = np.pi * x * y / 4, np.pi * x * x / 4
        cylinder = np.stack([side, side, cap, cap, side, side], axis=-1)
        sphere = np.repeat((np.pi * x * x / 6)[:, None], 6, axis=1)
        kinds = self.kinds[:, None]
        area = np.where(kinds == Kind.SPHERE, sphere, np.where(kinds == Kind.CYLINDER, cylinder, box))
        area[self.is_half_space] = (0, 0, np.inf, 0, 0, 0)
        return area


def make_box(
    position: ArrayLike = (0, 0, 0),
    size: ArrayLike = (1, 1, 1),
    rotation: ArrayLike = (0, 0, 0, 1),
    albedo: ArrayLike = (0.5, 0.5, 0.5),
    emission: ArrayLike = (0, 0, 0),
    name: str = "",
) -> PrimitiveSet:
    """A set of one box. `size` (x, y, z) in metres; colours are (3,) or, one for each of `FACES`, (6, 3)."""
    return _make(Kind.BOX, position, size, rotation, albedo, emission, name)


def make_sphere(
    position: ArrayLike = (0, 0, 0),
    radius: float = 0.5,
    albedo: ArrayLike = (0.5, 0.5, 0.5),
    emission: ArrayLike = (0, 0, 0),
    name: str = "",
) -> PrimitiveSet:
    """A set of one sphere; colours are (3,)."""
    return _make(Kind.SPHERE, position, [2 * radius] * 3, (0, 0, 0, 1), albedo, emission, name)


def make_cylinder(
    position: ArrayLike = (0, 0, 0),
    radius: float = 0.5,
    height: float = 1.0,
    rotation: ArrayLike = (0, 0, 0, 1),
    albedo: ArrayLike = (0.5, 0.5, 0.5),
    emission: ArrayLike = (0, 0, 0),
    name: str = "",
) -> PrimitiveSet:
    """A set of one capped cylinder along local Y; colours are (3,) or (6, 3) as `PrimitiveSet` says."""
    size = (2 * radius, height, 2 * radius)
    return _make(Kind.CYLINDER, position, size, rotation, albedo, emission, name)


def make_plane(
    position: ArrayLike = (0, 0, 0),
    size_x: float = 1.0,
    size_z: float = 1.0,
    thickness: float = 0.01,
    rotation: ArrayLike = (0, 0, 0, 1),
    albedo: ArrayLike = (0.5, 0.5, 0.5),
    emission: ArrayLike = (0, 0, 0),
    name: str = "",
) -> PrimitiveSet:
    """A set of one finite plane, normal local +Y; colours are (3,) or (6, 3), of which +y and -y count."""
    return _make(Kind.PLANE, position, (size_x, thickness, size_z), rotation, albedo, emission, name)


def make_half_space(
    position: ArrayLike = (0, 0, 0),
    rotation: ArrayLike = (0, 0, 0, 1),
    albedo: ArrayLike = (0.5, 0.5, 0.5),
    emission: ArrayLike = (0, 0, 0),
    name: str = "",
) -> PrimitiveSet:
    """A set of one half-space, solid below the plane through `position` with the normal local +Y."""
    return _make(Kind.PLANE, position, (np.inf, 0.0, np.inf), rotation, albedo, emission, name)


def shared_face_colors(kinds: ArrayLike, colors: ArrayLike, areas: ArrayLike | None = None) -> Float32:
    """Colours (n, 6, 3) with the faces that a kind can't tell apart set to their mean, float32.

    A sphere's six become one, a cylinder's +-x and +-z become one, a plane's rim becomes the mean of its two
    sides. `areas` (n, 6) weighs the means of spheres and cylinders; without it each face counts the same.
    """
    kinds = np.asarray(kinds)
    colors = np.array(colors, dtype=np.float64)
    weight = np.ones(colors.shape[:2]) if areas is None else np.asarray(areas, dtype=np.float64)
    side = [0, 1, 4, 5]
    for kind, faces in ((Kind.SPHERE, [0, 1, 2, 3, 4, 5]), (Kind.CYLINDER, side)):
        for i in np.flatnonzero(kinds == kind):
            w = weight[i, faces] if weight[i, faces].sum() > 0 else np.ones(len(faces))
            colors[i, faces] = w @ colors[i, faces] / w.sum()
    planes = np.flatnonzero(kinds == Kind.PLANE)
    colors[planes[:, None], side] = colors[planes][:, 2:4].mean(axis=1, keepdims=True)
    with np.errstate(over="ignore"):  # what overflows is infinite, which `validate` refuses
        return colors.astype(np.float32)


@dataclass(frozen=True)
class PackingLosses:
    """What the GPU record could not hold: primitives with more than two emissions (their areas' power is
    kept), and primitives whose emission was clamped at `encoding.RGB9E5_LARGEST`."""

    reduced_emissions: int
    clamped_emissions: int


def pack_gpu(primitives: PrimitiveSet, origin: ArrayLike = (0.0, 0.0, 0.0)) -> UInt32:
    """The set as the GPU holds it: (n, 16) uint32, 64 bytes a primitive; docs/formats.md gives the bits.

    Words 0-2: position - origin, float32. 3-5: half extents, float32; a half-space has (-1, 0, -1).
    6: bits 0-1 kind, 2-3 index of the quaternion's largest component, 4-23 a, 24-31 low 8 bits of b.
    7: bits 0-11 high 12 bits of b, 12-31 c; a, b, c are the other components in xyzw order, each coded as
    round(v * sqrt2 * 524287) + 524288. 8-13: the faces in `FACES` order: bits 0-29 albedo, 10:10:10 square
    roots, red lowest; bits 30-31 emission: 0 none, 1 A, 2 B, 3 A + B. 14, 15: emissions A and B as rgb9e5.
    """
    words = np.zeros((len(primitives), 16), np.uint32)
    local = primitives.positions - np.asarray(origin, dtype=np.float64)
    half = np.where(primitives.is_half_space[:, None], (-1.0, 0.0, -1.0), primitives.sizes / 2)
    with np.errstate(under="ignore"):
        words[:, 0:3] = local.astype(np.float32).view(np.uint32)
        words[:, 3:6] = half.astype(np.float32).view(np.uint32)
    words[:, 6:8] = encoding.encode_rotation(primitives.rotations, primitives.kinds)
    selector, pair, _ = encoding.two_emissions(*_emission_to_pack(primitives))
    words[:, 8:14] = encoding.encode_albedo(primitives.albedo) | selector << 30
    words[:, 14:16] = encoding.encode_rgb9e5(pair)
    return words


def unpack_gpu(words: UInt32, origin: ArrayLike = (0.0, 0.0, 0.0)) -> PrimitiveSet:
    """The set that `pack_gpu`'s words (n, 16) stand for, to the record's precision."""
    words = np.ascontiguousarray(words, dtype=np.uint32)
    rotations, kinds = encoding.decode_rotation(words[:, 6:8])
    half = words[:, 3:6].copy().view(np.float32).astype(np.float64)
    endless = (kinds == Kind.PLANE) & (half[:, 0] < 0)
    selector = words[:, 8:14] >> 30
    pair = encoding.decode_rgb9e5(words[:, 14:16])
    shown = np.stack([selector & 1, selector >> 1], axis=-1).astype(np.float64)
    emission = np.einsum("nfe,nec->nfc", shown, pair)
    return PrimitiveSet(
        kinds=kinds,
        positions=words[:, 0:3].copy().view(np.float32).astype(np.float64) + np.asarray(origin, np.float64),
        rotations=rotations,
        sizes=np.where(endless[:, None], (np.inf, 0.0, np.inf), half * 2),
        albedo=shared_face_colors(kinds, encoding.decode_albedo(words[:, 8:14])),
        emission=shared_face_colors(kinds, emission),
    )


def packing_losses(primitives: PrimitiveSet) -> PackingLosses:
    """Counts what `pack_gpu` has to give up; both are 0 for nearly every set."""
    _, pair, reduced = encoding.two_emissions(*_emission_to_pack(primitives))
    clamped = np.any(pair > encoding.RGB9E5_LARGEST, axis=(1, 2))
    return PackingLosses(int(np.count_nonzero(reduced)), int(np.count_nonzero(clamped)))


def _make(
    kind: Kind,
    position: ArrayLike,
    size: ArrayLike,
    quaternion: ArrayLike,
    albedo: ArrayLike,
    emission: ArrayLike,
    name: str,
) -> PrimitiveSet:
    kinds = np.array([kind], np.uint8)
    return PrimitiveSet(
        kinds=kinds,
        positions=np.array([position], np.float64),
        rotations=np.array([quaternion], np.float64),
        sizes=np.array([size], np.float64),
        albedo=shared_face_colors(kinds, _six_faces(albedo, 1)),
        emission=shared_face_colors(kinds, _six_faces(emission, 1)),
        names=(name,) if name else (),
    ).validate()


def _six_faces(color: ArrayLike, count: int) -> Float32:
    """A colour (3,), or six (6, 3), repeated for `count` primitives: (count, 6, 3)."""
    return np.array(np.broadcast_to(np.asarray(color, np.float32), (count, 6, 3)))


def _similarity(matrix: Float64) -> tuple[float, Float64, Float64]:
    """Scale, rotation (3, 3) and move (3,) of a (4, 4) matrix that has nothing else in it."""
    if matrix.shape != (4, 4) or not np.all(np.isfinite(matrix)):
        raise ValueError("a primitive set can only be moved by a (4, 4) matrix of finite numbers")
    linear = matrix[:3, :3]
    determinant = float(np.linalg.det(linear))
    scale = float(np.cbrt(determinant))
    if scale <= 0:
        raise ValueError("the matrix mirrors or flattens; primitives can only be turned, moved and scaled")
    turn = linear / scale
    if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-6 or np.any(matrix[3] != (0, 0, 0, 1)):
        raise ValueError(
            "the matrix shears or scales unevenly; primitives take a rotation, a move and one uniform scale"
        )
    return scale, turn, matrix[:3, 3]


def _emission_to_pack(primitives: PrimitiveSet) -> tuple[Float64, Float64]:
    """Emissions (n, 6, 3) and weights (n, 6) as the record codes them.

    A plane's rim would be a third emission: half of it takes the one side's, half the other's, which sends
    the same power. A half-space shows one face only; a finite weight keeps its mean a number.
    """
    emission = primitives.emission.astype(np.float64)
    planes = primitives.kinds == Kind.PLANE
    for side, rim in ((2, [0, 4]), (3, [1, 5])):
        for face in rim:
            emission[planes, face] = emission[planes, side]
    areas = primitives.face_areas()
    areas[primitives.is_half_space] = (0, 0, 1, 0, 0, 0)
    return emission, areas


def _refuse(bad: ArrayLike, primitives: PrimitiveSet, message: str) -> None:
    """Raise when any of `bad` (n,) is set; the message names the first such primitive."""
    if np.any(bad):
        i = int(np.flatnonzero(bad)[0])
        name = f" ({primitives.names[i]!r})" if primitives.names and primitives.names[i] else ""
        kind = int(primitives.kinds[i])
        what = Kind(kind).name.lower() if kind in list(Kind) else f"kind {kind}"
        raise ValueError(f"primitive {i}{name}, {what}: {message}")


def _check_arrays(s: PrimitiveSet) -> None:
    n = len(s)
    expected = {
        "kinds": ((n,), np.uint8),
        "positions": ((n, 3), np.float64),
        "rotations": ((n, 4), np.float64),
        "sizes": ((n, 3), np.float64),
        "albedo": ((n, 6, 3), np.float32),
        "emission": ((n, 6, 3), np.float32),
    }
    for field, (shape, dtype) in expected.items():
        array = getattr(s, field)
        if array.shape != shape or array.dtype != dtype:
            raise ValueError(
                f"{field} is {array.dtype} {array.shape}; a set of {n} needs {np.dtype(dtype)} {shape}"
            )
    for field, values in (("names", s.names), ("nodes", s.nodes)):
        if values and len(values) != n:
            raise ValueError(f"{len(values)} {field} for {n} primitives; give one for each, or none")
    if any(node < -1 for node in s.nodes):
        raise ValueError(f"node {min(s.nodes)} is none; give a node's index, or -1 for what stands")


def _check_placement(s: PrimitiveSet) -> None:
    _refuse(s.kinds > max(Kind), s, f"no such kind; use {', '.join(f'{int(k)} {k.name}' for k in Kind)}")
    _refuse(~np.isfinite(s.positions).all(axis=1), s, "position is not finite")
    with np.errstate(invalid="ignore", over="ignore", under="ignore"):
        off_unit = ~(np.abs(np.linalg.norm(s.rotations, axis=1) - 1) < 1e-6)
    _refuse(off_unit, s, "rotation is not a unit quaternion; normalise it")


def _check_sizes(s: PrimitiveSet) -> None:
    x, y, z = s.sizes.T
    plane, sphere, cylinder = (s.kinds == k for k in (Kind.PLANE, Kind.SPHERE, Kind.CYLINDER))
    endless = s.is_half_space
    with np.errstate(invalid="ignore", over="ignore"):
        _refuse(endless & ((y != 0) | (z != np.inf)), s, "a half-space has the sizes (inf, 0, inf)")
        unsized = ~(np.isfinite(s.sizes) & (s.sizes > 0)).all(axis=1) & ~endless
        _refuse(unsized, s, "sizes must be finite and above 0 (a half-space's are (inf, 0, inf))")
        uneven = (x != z) | (sphere & (x != y))
        _refuse((sphere | cylinder) & uneven, s, "sizes across must be equal: all are its diameter")
        thick = plane & ~endless & (y > PLANE_THICKNESS_LIMIT * np.minimum(x, z) * (1 + 1e-6))
    _refuse(thick, s, f"thicker than {PLANE_THICKNESS_LIMIT:.0%} of its smaller size; make it a box")


def _check_colors(s: PrimitiveSet) -> None:
    with np.errstate(invalid="ignore"):
        _refuse(~((s.albedo >= 0) & (s.albedo <= 1)).all(axis=(1, 2)), s, "albedo must be from 0 to 1")
        dark = ~(np.isfinite(s.emission) & (s.emission >= 0)).all(axis=(1, 2))
    _refuse(dark, s, "emission must be finite and not negative")
    for field, colors in (("albedo", s.albedo), ("emission", s.emission)):
        shared = shared_face_colors(s.kinds, colors)
        unequal = np.abs(shared - colors).max(axis=(1, 2), initial=0) > 1e-5 * (
            np.abs(colors).max(axis=(1, 2), initial=0) + 1e-30
        )
        _refuse(
            unequal,
            s,
            f"{field} differs between faces that this kind can't tell apart; use shared_face_colors",
        )
