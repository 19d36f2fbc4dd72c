"""Where a lookup starts for points of the mesh: the same rule that every pixel of a frame follows."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.device import Gpu
from runtime.encoder import Recorder
from runtime.kernel import Kernel
from runtime.resources import Buffer
from runtime.world import World

POINTS_AT_ONCE = 64 * 65535


def find_starts(
    gpu: Gpu, world: World, points: ArrayLike, normals: ArrayLike, towards_viewer: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Free places (n, 3) in world space from which points (n, 3) of a surface look around, and whether there
    is one (n,).

    normals, towards_viewer: unit vectors (n, 3). Raises ValueError for more points than one dispatch takes.
    """
    local = world.to_local(points)
    if len(local) > POINTS_AT_ONCE:
        raise ValueError(f"{len(local)} points; ask for at most {POINTS_AT_ONCE} at once")
    if len(local) == 0:
        return np.zeros((0, 3)), np.zeros(0, bool)
    rows = np.zeros((len(local), 3, 4), np.float32)
    for column, values in enumerate((local, normals, towards_viewer)):
        rows[:, column, :3] = values
    kernel = Kernel(gpu, "world/find_starts")
    starts = Buffer(gpu, 16 * len(rows), label="starts")
    rec = Recorder(gpu, label="starts")
    world.record(rec)
    with rec.compute(kernel.name) as compute_pass:
        kernel.dispatch(
            compute_pass,
            kernel.groups_for(len(rows)),
            world.bindings(),
            points=Buffer(gpu, rows, label="points"),
            starts=starts,
        )
    rec.submit()
    found = starts.read(np.float32, (len(rows), 4))
    return found[:, :3].astype(np.float64) + world.origin, found[:, 3] > 0
