"""Unit quaternions (xyzw) and rotation matrices, vectorised."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]


def matrices_from_quaternions(quaternions: ArrayLike) -> Float64:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4), xyzw; columns are the turned axes."""
    q = np.asarray(quaternions, dtype=np.float64)
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    with np.errstate(under="ignore"):
        rows = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternions_from_matrices(matrices: ArrayLike) -> Float64:
    """Unit quaternions (..., 4), xyzw, of rotation matrices (..., 3, 3); their largest component is positive.

    A rotation matrix gives all ten products of its quaternion's components. Dividing the row of the largest
    component by its length is stable for every angle.
    """
    m = np.asarray(matrices, dtype=np.float64)
    d = [m[..., i, i] for i in range(3)]
    xy, xz, yz = m[..., 0, 1] + m[..., 1, 0], m[..., 0, 2] + m[..., 2, 0], m[..., 1, 2] + m[..., 2, 1]
    xw, yw, zw = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    rows = [
        [1 + d[0] - d[1] - d[2], xy, xz, xw],
        [xy, 1 - d[0] + d[1] - d[2], yz, yw],
        [xz, yz, 1 - d[0] - d[1] + d[2], zw],
        [xw, yw, zw, 1 + d[0] + d[1] + d[2]],
    ]
    products = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    largest = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    row = np.take_along_axis(products, largest[..., None, None], axis=-2)[..., 0, :]
    return normalized(row)


def multiply(a: ArrayLike, b: ArrayLike) -> Float64:
    """Hamilton product (..., 4) of quaternions xyzw: the rotation `b` followed by `a`."""
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    ax, ay, az, aw = (a[..., i] for i in range(4))
    bx, by, bz, bw = (b[..., i] for i in range(4))
    with np.errstate(under="ignore"):
        return np.stack(
            [
                aw * bx + ax * bw + ay * bz - az * by,
                aw * by - ax * bz + ay * bw + az * bx,
                aw * bz + ax * by - ay * bx + az * bw,
                aw * bw - ax * bx - ay * by - az * bz,
            ],
            axis=-1,
        )


def normalized(vectors: ArrayLike) -> Float64:
    """Vectors (..., k) scaled to unit length; a vector of unit length to the last bit is left as it is."""
    v = np.asarray(vectors, dtype=np.float64)
    with np.errstate(under="ignore"):
        return v / np.linalg.norm(v, axis=-1, keepdims=True)
