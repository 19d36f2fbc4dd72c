"""Twin of shaders/lib/horizon.wgsl: the horizon integral of a slice. All take n rows of angles in radians."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
UInt32 = NDArray[np.uint32]

HORIZON_SECTORS = 32


def horizon_integral(angle: Array, tilt: Array) -> Array:
    """Integral (n,) of cos(x - tilt) |sin x| from 0 to an angle within pi, with the angle's sign."""
    arc = 0.25 * (np.cos(tilt) - np.cos(2 * angle - tilt)) + 0.5 * angle * np.sin(tilt)
    return np.where(angle < 0, -arc, arc)


def horizon_slice(tilt: Array) -> Array:
    """The same (n,) over a right angle on both sides of the tilt."""
    return np.cos(tilt) + tilt * np.sin(tilt)


def horizon_share(angle: Array, tilt: Array) -> Array:
    """Share (n,) of the slice's light, weighted by the cosine, that arrives from before an angle."""
    seen = np.clip(angle, tilt - np.pi / 2, tilt + np.pi / 2)
    before = horizon_integral(seen, tilt) - horizon_integral(tilt - np.pi / 2, tilt)
    return np.clip(before / horizon_slice(tilt), 0, 1)


def horizon_sectors(from_share: Array, to_share: Array, jitter: Array) -> UInt32:
    """The sectors (n,), bits of a word, between two shares in [0, 1], their borders moved by the jitter."""
    first = np.floor(HORIZON_SECTORS * from_share + jitter).astype(np.uint64)
    last = np.maximum(np.floor(HORIZON_SECTORS * to_share + jitter).astype(np.uint64), first)
    one = np.uint64(1)
    return ((one << last) - (one << first)).astype(np.uint32)
