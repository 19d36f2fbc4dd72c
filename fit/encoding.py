"""The number formats of the GPU's primitive record: small codes for rotations, albedo and emission.

Their decoders are twins of WGSL functions; docs/formats.md gives the bits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fit.rotation import normalized

Float64 = NDArray[np.float64]
UInt32 = NDArray[np.uint32]

ROTATION_STEPS = 2**19 - 1
"""A quaternion component in [-1/sqrt2, 1/sqrt2] is coded as a signed integer of at most this size."""

RGB9E5_LARGEST = 65408.0
"""Largest emission a shared-exponent colour can hold, 511/512 * 2^16."""

_MANTISSA_BITS, _EXPONENT_BIAS = 9, 15


def encode_rotation(quaternions: ArrayLike, kinds: ArrayLike) -> UInt32:
    """Unit quaternions (n, 4) xyzw and kinds (n,) as two words (n, 2) uint32 by "smallest three".

    The largest component, made positive by the quaternion's free sign, is left out; the other three take 20
    bits each. Zero is exact, so the identity is; 1/sqrt2 is exact too, so quarter turns are.
    """
    q = normalized(quaternions)
    largest = np.argmax(np.abs(q), axis=-1)
    sign = np.where(np.take_along_axis(q, largest[:, None], axis=-1) < 0, -1.0, 1.0)
    rest = np.take_along_axis(q * sign, _other_components()[largest], axis=-1)
    code = (np.rint(rest * np.sqrt(2.0) * ROTATION_STEPS) + (ROTATION_STEPS + 1)).astype(np.uint32)
    a, b, c = code[:, 0], code[:, 1], code[:, 2]
    low = np.asarray(kinds, dtype=np.uint32) | largest.astype(np.uint32) << 2 | a << 4 | (b & 0xFF) << 24
    high = b >> 8 | c << 12
    return np.stack([low, high], axis=-1)


def decode_rotation(words: UInt32) -> tuple[Float64, NDArray[np.uint8]]:
    """Quaternions (n, 4) xyzw and kinds (n,) from the two words (n, 2) of `encode_rotation`."""
    low, high = words[:, 0], words[:, 1]
    code = np.stack([low >> 4 & 0xFFFFF, low >> 24 | (high & 0xFFF) << 8, high >> 12], axis=-1)
    rest = (code.astype(np.float64) - (ROTATION_STEPS + 1)) / (np.sqrt(2.0) * ROTATION_STEPS)
    largest = low >> 2 & 3
    q = np.empty((len(words), 4))
    np.put_along_axis(q, _other_components()[largest], rest, axis=-1)
    left_out = np.sqrt(np.maximum(1.0 - np.sum(rest * rest, axis=-1), 0.0))
    np.put_along_axis(q, largest[:, None].astype(np.intp), left_out[:, None], axis=-1)
    return q, (low & 3).astype(np.uint8)


def _other_components() -> NDArray[np.intp]:
    """Row i lists the three components other than i, in xyzw order."""
    return np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]], dtype=np.intp)


def encode_albedo(albedo: ArrayLike) -> UInt32:
    """Linear colours (..., 3) in [0, 1] as 10:10:10 square roots, red lowest; 0 and 1 are exact."""
    root = np.sqrt(np.clip(np.asarray(albedo, dtype=np.float64), 0.0, 1.0))
    code = np.rint(root * 1023.0).astype(np.uint32)
    return np.asarray(code[..., 0] | code[..., 1] << 10 | code[..., 2] << 20, dtype=np.uint32)


def decode_albedo(words: UInt32) -> Float64:
    """Linear colours (..., 3) from `encode_albedo`; the two highest bits are ignored."""
    code = np.stack([words & 1023, words >> 10 & 1023, words >> 20 & 1023], axis=-1)
    return (code / 1023.0) ** 2


def encode_rgb9e5(colors: ArrayLike) -> UInt32:
    """Colours (..., 3) >= 0 as rgb9e5, red lowest: three 9-bit mantissas, one exponent of bias 15.

    Values above `RGB9E5_LARGEST` are clamped. The largest component keeps 0.2 % down to 3e-5 (below, steps of
    6e-8); the format is that of EXT_texture_shared_exponent.
    """
    c = np.clip(np.asarray(colors, dtype=np.float64), 0.0, RGB9E5_LARGEST)
    top = np.max(c, axis=-1)
    exponent = np.maximum(np.frexp(top)[1] - 1, -_EXPONENT_BIAS - 1) + 1 + _EXPONENT_BIAS
    step = np.ldexp(1.0, exponent - _EXPONENT_BIAS - _MANTISSA_BITS)
    # Rounding can carry the largest mantissa to 512, which does not fit: take the next exponent.
    carries = np.rint(top / step) == 2**_MANTISSA_BITS
    exponent, step = exponent + carries, np.where(carries, 2 * step, step)
    mantissa = np.rint(c / step[..., None]).astype(np.uint32)
    packed = mantissa[..., 0] | mantissa[..., 1] << 9 | mantissa[..., 2] << 18
    return np.asarray(packed | exponent.astype(np.uint32) << 27, dtype=np.uint32)


def decode_rgb9e5(words: UInt32) -> Float64:
    """Colours (..., 3) from `encode_rgb9e5`."""
    mantissa = np.stack([words & 511, words >> 9 & 511, words >> 18 & 511], axis=-1)
    exponent = (words >> 27).astype(np.int32) - _EXPONENT_BIAS - _MANTISSA_BITS
    return np.ldexp(mantissa.astype(np.float64), exponent[..., None])


def two_emissions(emission: ArrayLike, areas: ArrayLike) -> tuple[UInt32, Float64, NDArray[np.bool_]]:
    """The faces' emissions (n, 6, 3) told with two for each primitive.

    Returns selectors (n, 6): 0 dark, 1 A, 2 B; A and B (n, 2, 3); and which primitives had more than two
    (n,). Those are split in the two groups that change the least light, and each group takes its mean by
    `areas` (n, 6), so that the power sent out stays the same and dark faces stay dark.
    """
    emission, areas = np.asarray(emission, dtype=np.float64), np.asarray(areas, dtype=np.float64)
    selector = np.zeros(emission.shape[:2], np.uint32)
    pair = np.zeros((len(emission), 2, 3))
    reduced = np.zeros(len(emission), np.bool_)
    glowing = np.any(emission > 0, axis=-1)
    for i in np.flatnonzero(glowing.any(axis=1)):
        faces = np.flatnonzero(glowing[i])
        weight = areas[i, faces] if areas[i, faces].sum() > 0 else np.ones(len(faces))
        distinct, group = np.unique(emission[i, faces], axis=0, return_inverse=True)
        group = group.reshape(-1)
        reduced[i] = len(distinct) > 2
        if reduced[i]:
            group = _best_split(distinct, group, np.bincount(group, weights=weight).astype(np.float64))
        for slot in range(group.max() + 1):
            own = group == slot
            pair[i, slot] = np.average(emission[i, faces[own]], axis=0, weights=weight[own])
            selector[i, faces[own]] = slot + 1
    return selector, pair, reduced


def _best_split(distinct: Float64, group: NDArray[np.intp], weight: Float64) -> NDArray[np.intp]:
    """`group` with the k emissions (k, 3) of weights (k,) merged into 0 and 1, at the least square error.

    k is at most 6, so every split is tried.
    """
    numbers = np.arange(len(distinct), dtype=np.intp)
    splits = [bits >> numbers & 1 for bits in range(1, 2 ** (len(distinct) - 1))]

    def error(split: NDArray[np.intp]) -> float:
        total = 0.0
        for slot in (0, 1):
            e, w = distinct[split == slot], weight[split == slot]
            total += float(w @ np.sum((e - np.average(e, axis=0, weights=w)) ** 2, axis=-1))
        return total

    return min(splits, key=error)[group]
