"""The ways to light that commands offer by name, and the grids of probes that they may be given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pipelines.errors import UsageError
from pipelines.options import ProbesOption

if TYPE_CHECKING:
    from fit.primitives import PrimitiveSet
    from runtime.probes import ProbeGrid

Quality = Literal["fast", "balanced", "best"]
"""Names of settings that `gi_presets` holds."""

Culling = Literal["grid", "clusters", "none"]
"""`runtime.settings.CULLINGS`: how the nearest primitive is found."""

SOFTWARE_PROBES = 1024
"""Probes at most on a software adapter; a frame takes a second there and not ten."""

MOST_PROBES = 1 << 17
"""Probes at most where a spacing is asked for; a finer one is coarsened until they fit."""


@dataclass(frozen=True)
class Method:
    """A technique of the runtime, with settings of its own."""

    technique: str
    options: Mapping[str, Any] = field(default_factory=dict)


METHODS: Mapping[str, Method] = {
    "sdfddgi": Method("sdfddgi"),
    "ddgi": Method("ddgi"),
    "ddgi-triangles": Method("ddgi", {"tracer": "triangles"}),
    "ddgi-cascades": Method("ddgi", {"cascades": 4}),
    "none": Method("none"),
}
"""`ddgi-triangles` is DDGI as ray-tracing hardware would run it: it sees the mesh and not the primitives.
`ddgi-cascades` has its probes in four grids of 32 x 4 x 32 around the camera, whatever grid is asked for."""


def sees_mesh(name: str) -> bool:
    """Whether a method's rays meet the mesh itself, so that no set of primitives is between."""
    return find_method(name).options.get("tracer") == "triangles"


def find_method(name: str) -> Method:
    """The method called so.

    Raises:
        UsageError: there is none; the message lists those there are.
    """
    if name not in METHODS:
        raise UsageError(f"--gi {name}: there is no such method; there are {', '.join(METHODS)}")
    return METHODS[name]


def technique_settings(
    name: str, primitives: PrimitiveSet, probes: ProbesOption | None, *, software: bool, **options: Any
) -> Any:
    """Settings of the technique that a method runs, None for one without any.

    probes: the grid asked for; software: fewer probes where none is asked for; options: further settings of
    the technique.
    """
    method = find_method(name)
    given = {**method.options, **options}
    if probes is not None and probes.counts is not None:
        given["grid"] = lay_grid(primitives, probes.counts)
    elif probes is not None:
        given |= {"probe_spacing": probes.spacing, "max_probes": MOST_PROBES}
    if software and probes is None:
        given.setdefault("max_probes", SOFTWARE_PROBES)
    if method.technique == "sdfddgi":
        from runtime.sdfddgi import SdfddgiSettings

        return SdfddgiSettings(**given)
    if method.technique == "ddgi":
        from runtime.ddgi import DdgiSettings

        return DdgiSettings(**given)
    return None


def lay_grid(primitives: PrimitiveSet, counts: tuple[int, int, int]) -> ProbeGrid:
    """So many probes along x, y and z over a set, as near to each other as its bounds allow."""
    from runtime.probes import ProbeGrid

    lower, upper = primitives.bounds()
    gaps = np.array(counts) - 1
    spacing = float(np.max((upper - lower) / gaps))
    x, y, z = ((lower + upper) / 2 - spacing * gaps / 2).tolist()
    return ProbeGrid((x, y, z), spacing, counts)
