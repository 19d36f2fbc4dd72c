"""Twin of shaders/lib/primitives.wgsl: the 64-byte record and what is asked of one primitive.

A `Shape` here holds arrays: shape i is asked about position i.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit import encoding, sdf
from fit.primitives import Kind, PrimitiveSet

Array = NDArray[np.floating]
UInt32 = NDArray[np.uint32]

BOX, SPHERE, CYLINDER, PLANE = (int(kind) for kind in Kind)


@dataclass(frozen=True)
class Shape:
    """position (n, 3), kind (n,), half (n, 3), rotation (n, 4) xyzw; half.x < 0 tells a half-space."""

    position: Array
    kind: UInt32
    half: Array
    rotation: Array


def decode_rotation(words: UInt32) -> Array:
    """Quaternions (n, 4) xyzw from two words (n, 2)."""
    return encoding.decode_rotation(words)[0]


def decode_albedo(face: UInt32) -> Array:
    """Linear albedo (n, 3) from a face's word (n,)."""
    return encoding.decode_albedo(face)


def decode_rgb9e5(word: UInt32) -> Array:
    """Colours (n, 3) from shared-exponent words (n,)."""
    return encoding.decode_rgb9e5(word)


def decode_emission(face: UInt32, a: UInt32, b: UInt32) -> Array:
    """Emission (n, 3) of a face from its word and the record's two emissions, (n,) each."""
    shows_a, shows_b = face >> 30 & 1, face >> 31
    return shows_a[:, None] * decode_rgb9e5(a) + shows_b[:, None] * decode_rgb9e5(b)


def decode_shape(first: UInt32, second: UInt32) -> Shape:
    """Shapes from the record's first eight words, (n, 4) and (n, 4)."""
    words = np.concatenate([first, second], axis=1)
    real = np.ascontiguousarray(words[:, :6]).view(np.float32)
    return Shape(
        real[:, :3], (second[:, 2] & 3).astype(np.uint32), real[:, 3:], decode_rotation(second[:, 2:])
    )


def decode_bounds(first: UInt32, second: UInt32) -> Array:
    """Balls (n, 4) around finite primitives, centre and radius, from the same words."""
    shape = decode_shape(first, second)
    half = np.where((shape.kind == CYLINDER)[:, None], shape.half * [1, 1, 0], shape.half)
    radius = np.where(shape.kind == SPHERE, shape.half[:, 0], np.linalg.norm(half, axis=1))
    return np.concatenate([shape.position, radius[:, None]], axis=1)


def shape_is_half_space(shape: Shape) -> NDArray[np.bool_]:
    """Mask (n,)."""
    return shape.half[:, 0] < 0


def shape_distance(shape: Shape, position: Array) -> Array:
    """Signed distance (n,) from position i (n, 3) to shape i."""
    primitives, index = _as_set(shape)
    return np.array([sdf.distance(primitives.select(i), position[i : i + 1])[0, 0] for i in index])


def shape_gradient(shape: Shape, position: Array) -> Array:
    """Unit gradient (n, 3) of the distance from position i to shape i."""
    return sdf.gradient(*_ask(shape, position))


def shape_face(shape: Shape, position: Array) -> UInt32:
    """Which of the six faces (n,) colours a hit at position i on shape i."""
    return sdf.primitive_face(*_ask(shape, position)).astype(np.uint32)


def shape_half_thickness(shape: Shape) -> Array:
    """Half the smallest extent (n,), metres; a half-space has no end (3e38)."""
    return np.where(shape_is_half_space(shape), 3.0e38, shape.half.min(axis=1))


def _ask(shape: Shape, position: Array) -> tuple[PrimitiveSet, Array, NDArray[np.intp]]:
    primitives, index = _as_set(shape)
    return primitives, position.astype(np.float64), index


def _as_set(shape: Shape) -> tuple[PrimitiveSet, NDArray[np.intp]]:
    n = len(shape.kind)
    black = np.zeros((n, 6, 3), np.float32)
    sizes = np.where(shape_is_half_space(shape)[:, None], (np.inf, 0.0, np.inf), 2.0 * shape.half)
    rotations = shape.rotation.astype(np.float64)
    rotations /= np.linalg.norm(rotations, axis=1, keepdims=True)
    primitives = PrimitiveSet(
        shape.kind.astype(np.uint8), shape.position.astype(np.float64), rotations, sizes, black, black
    )
    return primitives, np.arange(n)
