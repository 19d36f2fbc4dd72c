"""Twin of shaders/lib/random.wgsl: counter-based random numbers and low-discrepancy directions."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
UInt32 = NDArray[np.uint32]

PI = np.pi
_GOLDEN = np.float32(0.61803398874989)


def random_hash(key: UInt32) -> UInt32:
    """Three hashed words (n, 3) for three words (n, 3): pcg3d of Jarzynski and Olano 2020."""
    v = _mix(key.astype(np.uint64) * 1664525 + 1013904223 & 0xFFFFFFFF)
    return _mix(v ^ v >> 16).astype(np.uint32)


def _mix(v: NDArray[np.integer]) -> NDArray[np.integer]:
    x, y, z = v.T
    x = x + y * z & 0xFFFFFFFF
    y = y + z * x & 0xFFFFFFFF
    z = z + x * y & 0xFFFFFFFF
    return np.stack([x, y, z], axis=1)


def random_uniform(bits: UInt32) -> Array:
    """Numbers (n, 3) in [0, 1) from hashed words (n, 3)."""
    return (bits >> 8) * (1 / 2**24)


def random_sequence(key: UInt32, index: UInt32) -> UInt32:
    """Elements `index` (n,) of sequences of three words (n, 3), evenly spread, begun at random for each key
    (n, 3): the R3 sequence of Roberts 2018."""
    steps = np.array([3518319155, 2882110345, 2360945575], np.uint64)
    return (random_hash(key) + index[:, None] * steps & 0xFFFFFFFF).astype(np.uint32)


def random_rotation(u: Array) -> Array:
    """Uniformly distributed rotations (n, 4) xyzw from uniform numbers (n, 3) (Shoemake 1992)."""
    a, b = 2 * PI * u[:, 1], 2 * PI * u[:, 2]
    s, t = np.sqrt(1 - u[:, 0]), np.sqrt(u[:, 0])
    return np.stack([s * np.sin(a), s * np.cos(a), t * np.sin(b), t * np.cos(b)], axis=1)


def spherical_fibonacci(index: UInt32, count: UInt32) -> Array:
    """Unit directions (n, 3): point `index` (n,) of `count` (n,) on the spherical Fibonacci lattice.

    The product with the golden ratio is rounded to float32 as the GPU does, so both name the same lattice.
    """
    z = 1 - (2 * index.astype(np.float64) + 1) / count
    turns = (index.astype(np.float32) * _GOLDEN).astype(np.float64)
    angle = 2 * PI * (turns - np.floor(turns))
    r = np.sqrt(np.maximum(1 - z * z, 0))
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)


def random_cosine_direction(normal: Array, u: Array) -> Array:
    """Directions (n, 3) over surfaces with unit normals (n, 3), by the cosine to them, from uniform numbers
    (n, 2); in the basis of Duff et al. 2017."""
    x, y, z = normal.T
    s = np.where(z >= 0, 1.0, -1.0)
    a = -1 / (s + z)
    tangent = np.stack([1 + s * x * x * a, s * x * y * a, -s * x], axis=1)
    bitangent = np.stack([x * y * a, s + y * y * a, -y], axis=1)
    angle, radius = 2 * PI * u[:, :1], np.sqrt(u[:, 1:])
    over = normal * np.sqrt(np.maximum(1 - u[:, 1:], 0))
    return tangent * radius * np.cos(angle) + bitangent * radius * np.sin(angle) + over
