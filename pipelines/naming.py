"""Result names: a file's stem, with as many of its parents' names in front as make it unique."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path


def result_names(files: Sequence[Path]) -> list[str]:
    """One name for each file, no two equal even where the file system ignores case.

    `a/scene.gltf` and `b/scene.gltf` become `a_scene` and `b_scene`; files that differ in nothing but their
    suffix get it at the end (`box_gltf`, `box_glb`).

    Raises:
        ValueError: the same file is given twice.
    """
    resolved = [file.resolve() for file in files]
    if len(set(resolved)) < len(resolved):
        twice = next(path for path, count in Counter(resolved).items() if count > 1)
        raise ValueError(f"{twice} is given twice")
    siblings = Counter(_folded(path.with_suffix("")) for path in resolved)
    parts = [
        (*path.parts[1:-1], _with_suffix(path) if siblings[_folded(path.with_suffix(""))] > 1 else path.stem)
        for path in resolved
    ]
    used = [1] * len(parts)
    while True:
        names = ["_".join(part[-length:]) for part, length in zip(parts, used, strict=True)]
        counts = Counter(name.casefold() for name in names)
        clashing = [i for i, name in enumerate(names) if counts[name.casefold()] > 1]
        extendable = [i for i in clashing if used[i] < len(parts[i])]
        if not extendable:
            break
        for i in extendable:
            used[i] += 1
    for number, i in enumerate(clashing[1:], start=2):  # `a/b.glb` beside `a_b.glb`, both at the root
        names[i] += f"_{number}"
    return names


def _folded(path: Path) -> str:
    return str(path).casefold()


def _with_suffix(path: Path) -> str:
    return f"{path.stem}_{path.suffix.lstrip('.')}"
