"""`sdfprim inspect`: what a glTF file holds, and what of it will not be used."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fit.scene import AlphaMode, Mesh, Scene
from pipelines.console import Terminal
from pipelines.convert import require_file
from pipelines.documents import report_header
from pipelines.errors import UsageError
from pipelines.worker import describe_error

PLAUSIBLE_DIAGONAL = (0.05, 2000.0)
"""Metres: from a cup to a large estate. Files outside were most likely made in centimetres or kilometres."""


@dataclass(frozen=True)
class InspectSettings:
    """Which files `inspect` reads."""

    files: tuple[Path, ...]
    scale: float = 1.0


def run(settings: InspectSettings) -> dict[str, Any]:
    """One row for each file under `assets`, in the manner of `convert`'s report; nothing is written.

    Raises:
        UsageError: a file is missing.
    """
    from fit import gltf

    if not settings.files:
        raise UsageError("no file given: name at least one .gltf or .glb")
    for file in settings.files:
        require_file(file)
    rows = []
    for file in settings.files:
        row: dict[str, Any] = {"source": file.as_posix(), "status": "ok", "error": None}
        try:
            row |= describe_scene(gltf.load(file, scale=settings.scale))
        except (ValueError, OSError, MemoryError) as error:
            row |= {"status": "failed", "error": describe_error(error)}
        rows.append(row)
    return report_header("inspect", settings) | {"assets": rows}


def describe_scene(scene: Scene) -> dict[str, Any]:
    """Counts, sizes, lights and cameras of a loaded scene, and warnings for what looks wrong."""
    closed = [_is_closed(mesh) for mesh in scene.meshes]
    drawn = Counter(instance.mesh for instance in scene.instances)
    triangles = scene.triangle_count
    in_closed = sum(len(scene.meshes[i].triangles) * count for i, count in drawn.items() if closed[i])
    bounds = scene.bounds() if triangles else None
    return {
        "meshes": len(scene.meshes),
        "instances": len(scene.instances),
        "nodes": len(scene.nodes),
        "triangles": triangles,
        "closed_meshes": sum(closed),
        "closed_triangle_share": round(in_closed / triangles, 4) if triangles else None,
        "materials": [_describe_material(material) for material in scene.materials],
        "textures": len(scene.textures),
        "images": [
            {"name": i.name, "width": i.pixels.shape[1], "height": i.pixels.shape[0]} for i in scene.images
        ],
        "lights": [
            {"name": light.name, "kind": light.kind, "color": light.color, "intensity": light.intensity}
            for light in scene.lights
        ],
        "cameras": [{"index": i, "name": camera.name} for i, camera in enumerate(scene.cameras)],
        "animations": [
            {"name": animation.name, "nodes": len(animation.motions), "seconds": animation.duration}
            for animation in scene.animations
        ],
        "bounds_min": bounds[0] if bounds else None,
        "bounds_max": bounds[1] if bounds else None,
        "diagonal_m": float(np.linalg.norm(bounds[1] - bounds[0])) if bounds else None,
        "extensions": list(scene.extensions),
        "repairs": scene.repairs,
        "ignored": list(scene.ignored),
        "warnings": _warnings(bounds),
    }


def _describe_material(material: Any) -> dict[str, Any]:
    return {
        "name": material.name,
        "textured": material.base_color_texture is not None,
        "emissive": any(material.emission),
        "double_sided": material.double_sided,
        "alpha": material.alpha_mode if material.alpha_mode != AlphaMode.OPAQUE else None,
    }


def _is_closed(mesh: Mesh) -> bool:
    """Whether every edge has as many triangles on one way as on the other, equal positions welded."""
    if len(mesh.triangles) == 0:
        return False
    _, welded = np.unique(mesh.positions, axis=0, return_inverse=True)
    corners = welded.reshape(-1)[mesh.triangles]
    corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
    start, end = corners.reshape(-1), np.roll(corners, -1, axis=1).reshape(-1)
    forward = np.where(start < end, 1, -1)
    ends = np.stack([np.minimum(start, end), np.maximum(start, end)], axis=1)
    _, edge = np.unique(ends, axis=0, return_inverse=True)
    return len(corners) > 0 and not np.bincount(edge.reshape(-1), weights=forward).any()


def _warnings(bounds: Any) -> list[str]:
    if bounds is None:
        return ["the scene draws no triangle: there is nothing to convert"]
    diagonal = float(np.linalg.norm(bounds[1] - bounds[0]))
    smallest, largest = PLAUSIBLE_DIAGONAL
    if smallest <= diagonal <= largest:
        return []
    guess = "0.01 for centimetres, 0.001 for millimetres" if diagonal > largest else "100 or 1000"
    return [f"{diagonal:.4g} m from corner to corner is not likely: mend it with --scale (try {guess})"]


def show(report: dict[str, Any], terminal: Terminal) -> None:
    """Prints each file's facts, one to a line."""
    for row in report["assets"]:
        terminal.line(row["source"])
        if row["error"]:
            terminal.line(f"  failed      {row['error']}")
            continue
        for label, text in _facts(row):
            if text:
                terminal.line(f"  {label:<11} {text}")


def _facts(row: dict[str, Any]) -> list[tuple[str, str]]:
    share = row["closed_triangle_share"]
    closed = f"; {share:.0%} of them in closed meshes" if share is not None else ""
    materials = row["materials"]
    kinds = Counter(key for material in materials for key in ("textured", "emissive") if material[key])
    lights = Counter(str(light["kind"]) for light in row["lights"])
    diagonal = f"{row['diagonal_m']:.4g} m from corner to corner" if row["diagonal_m"] is not None else ""
    return [
        ("meshes", f"{row['meshes']}, drawn {row['instances']} times, {row['closed_meshes']} closed"),
        ("triangles", f"{row['triangles']}{closed}"),
        ("size", diagonal),
        ("materials", f"{len(materials)}, {kinds['textured']} textured, {kinds['emissive']} emissive"),
        ("images", str(len(row["images"]))),
        ("lights", ", ".join(f"{count} {kind}" for kind, count in lights.items())),
        ("cameras", ", ".join(f"{camera['index']} {camera['name']!r}" for camera in row["cameras"])),
        ("animations", ", ".join(_animation(animation) for animation in row["animations"])),
        ("extensions", ", ".join(row["extensions"])),
        ("repaired", ", ".join(f"{count} {what}" for what, count in row["repairs"].items())),
        ("ignored", "; ".join(row["ignored"])),
        *(("warning", warning) for warning in row["warnings"]),
    ]


def _animation(animation: dict[str, Any]) -> str:
    return f"{animation['name']!r} moves {animation['nodes']} nodes for {animation['seconds']:.4g} s"
