"""Twin of shaders/lib/normal.wgsl: a unit vector in 32 bits."""

import numpy as np
from numpy.typing import NDArray

from runtime.twins.octahedral import oct_decode, oct_encode

Array = NDArray[np.floating]
UInt32 = NDArray[np.uint32]


def normal_pack(direction: Array) -> UInt32:
    """Packed (n,) octahedral coordinates of unit directions (n, 3), 16 bits each."""
    code = np.floor(0.5 + 32767 * np.clip(oct_encode(direction), -1, 1)).astype(np.int64) & 0xFFFF
    return (code[:, 0] | code[:, 1] << 16).astype(np.uint32)


def normal_unpack(bits: UInt32) -> Array:
    """Unit directions (n, 3) of packed ones (n,)."""
    halves = np.stack([bits & 0xFFFF, bits >> 16], axis=1).astype(np.uint16).view(np.int16)
    return oct_decode(np.maximum(halves / 32767, -1))
