"""What our own files say about a primitive beside its geometry: `extras.sdfprim` and the meshes' names."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from fit.export.gltf import MESH_PREFIX, NODE_PREFIX, VERSION
from fit.export.gltf_nodes import Float64, Graph
from fit.export.unit_meshes import HALF_SPACE
from fit.primitives import Kind

KINDS = (*(kind.name.lower() for kind in Kind), HALF_SPACE)


@dataclass(frozen=True)
class Facts:
    """`extras.sdfprim` of a collider node, as far as tools kept it; colours are (6, 3)."""

    kind: str | None = None
    name: str = ""
    thickness: float | None = None
    albedo: Float64 | None = None
    emission: Float64 | None = None


NO_FACTS = Facts()


def is_ours(document: dict[str, Any]) -> bool:
    """Whether the file itself says that we wrote it; then it may hold no primitive at all."""
    extras = document["asset"].get("extras")
    return isinstance(extras, dict) and "sdfprim" in extras


def read_facts(graph: Graph, node: int) -> Facts | None:
    """The node's facts, None when it has none; a fact that tools have mangled is left out.

    Raises:
        FormatError: the facts are of a newer version.
    """
    extras = graph.nodes[node].get("extras")
    facts = extras.get("sdfprim") if isinstance(extras, dict) else None
    if not isinstance(facts, dict):
        return None
    version = _number(facts.get("version"))
    if version is not None and version > VERSION:
        raise graph.error(node, f"is of version {version:g}; this program reads version {VERSION}, update it")
    thickness = _number(facts.get("thickness"))
    return Facts(
        kind=facts["kind"] if facts.get("kind") in KINDS else None,
        name=facts["name"] if isinstance(facts.get("name"), str) else "",
        thickness=thickness if thickness is not None and thickness > 0 else None,
        albedo=_six_colors(facts.get("albedo"), 1.0),
        emission=_six_colors(facts.get("emission"), np.inf),
    )


def mesh_kind(graph: Graph, node: int) -> str | None:
    """The kind that the name of the node's mesh tells."""
    name = graph.container.document["meshes"][graph.nodes[node]["mesh"]].get("name", "")
    if not isinstance(name, str) or not name.startswith(MESH_PREFIX):
        return None
    told = name.removeprefix(MESH_PREFIX)
    return next((kind for kind in KINDS if told.startswith(kind)), None)


def mover(graph: Graph, node: int) -> int:
    """The scene's node that a primitive moves with, by the name of one above it; -1 where it stands."""
    for above in graph.ancestry(node)[1:]:
        name = str(graph.nodes[above].get("name", ""))
        digits = re.match(r"\d+", name.removeprefix(NODE_PREFIX)) if name.startswith(NODE_PREFIX) else None
        if digits is not None:
            return int(digits.group())
    return -1


def _number(value: Any) -> float | None:
    known = isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value)
    return float(value) if known else None


def _six_colors(value: Any, largest: float) -> Float64 | None:
    try:
        colors = np.array(value, np.float64)
    except (TypeError, ValueError):
        return None
    sound = (
        colors.shape == (6, 3) and np.all(np.isfinite(colors)) and np.all((colors >= 0) & (colors <= largest))
    )
    return colors if sound else None
