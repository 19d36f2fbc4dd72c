"""Twin of shaders/lib/surfaces.wgsl: whether two points may belong to one smooth surface. All take n rows."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def surface_rise(way: Array, normal: Array, other_normal: Array) -> Array:
    """How far (n,), in the way's unit, a way (n, 3) between two points leaves the plane across their mean
    normal."""
    total = normal + other_normal
    squared = np.maximum((total * total).sum(axis=1), 1e-12)
    return np.abs((way * total).sum(axis=1)) / np.sqrt(squared)
