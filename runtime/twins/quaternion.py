"""Twin of shaders/lib/quaternion.wgsl. Quaternions (n, 4) xyzw of unit length, vectors (n, 3)."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def quat_rotate(q: Array, v: Array) -> Array:
    """Vectors (n, 3) turned by the quaternions."""
    t = 2 * np.cross(q[:, :3], v)
    return v + q[:, 3:] * t + np.cross(q[:, :3], t)


def quat_rotate_inverse(q: Array, v: Array) -> Array:
    """Vectors (n, 3) turned back by the quaternions."""
    return quat_rotate(q * np.array([-1, -1, -1, 1], q.dtype), v)
