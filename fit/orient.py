"""The directions that a scene is built along: frames for the grids that boxes are grown on."""

from __future__ import annotations

import numpy as np

from fit.scene import Float64
from fit.shapes import right_handed

ALIGNED = 0.995
"""Cosine: faces within 6 degrees of a frame's axes are served by it."""

MOST_FRAMES = 4

LEAST_SHARE = 0.03
"""Of the surface's weight that must face one way for a grid of its own."""

_LOOKED_AT = 1500


def find_frames(normals: Float64, weights: Float64) -> list[Float64]:
    """Frames (3, 3), world from local: the world's axes, then the heaviest directions that none serves."""
    frames = [np.eye(3)]
    step = max(1, len(normals) // _LOOKED_AT)
    normals, weights = normals[::step], weights[::step]
    total = float(weights.sum())
    left = ~_served(normals, frames[0])
    while len(frames) < MOST_FRAMES and left.any():
        directions, mass = normals[left], weights[left]
        alike = np.abs(directions @ directions.T) > ALIGNED
        support = alike @ mass
        first = int(np.argmax(support))
        if support[first] < LEAST_SHARE * total:
            break
        frame = _frame_along(_mean(directions, mass, first, alike[first]), normals, weights)
        frames.append(frame)
        left &= ~_served(normals, frame)
    return frames


def _served(normals: Float64, frame: Float64) -> np.ndarray:
    return np.abs(normals @ frame).max(axis=1) > ALIGNED


def _mean(directions: Float64, mass: Float64, which: int, alike: np.ndarray) -> Float64:
    signs = np.sign(directions[alike] @ directions[which])
    mean = (directions[alike] * (signs * mass[alike])[:, None]).sum(axis=0)
    return mean / np.linalg.norm(mean)


def _frame_along(first: Float64, normals: Float64, weights: Float64) -> Float64:
    """The direction with the heaviest one across it; upright where nothing lies across."""
    across = np.flatnonzero(np.abs(normals @ first) < 0.05)
    if len(across):
        directions, mass = normals[across], weights[across]
        alike = np.abs(directions @ directions.T) > ALIGNED
        heaviest = int(np.argmax(alike @ mass))
        second = _mean(directions, mass, heaviest, alike[heaviest])
    else:
        second = np.eye(3)[1] if abs(first[1]) < 0.9 else np.eye(3)[0]
    return right_handed(np.stack([first, second], axis=1))
