"""`sdfprim demo`: the comparison of a coarse and a fine set, on a scene that comes with the program."""

from __future__ import annotations

from pathlib import Path

from pipelines.bundled import bundled_file
from pipelines.compare import CompareSettings
from pipelines.studio import LightingOptions


def settings(output: Path) -> CompareSettings:
    """The cloister at noon, small enough for a processor without a graphics card."""
    return CompareSettings(
        scene=bundled_file("atrium.glb"),
        output=output,
        camera="court",
        lighting=LightingOptions(sky="0.5,0.7,1.1", keep_file_lights=True),
        exposure=-0.5,
        size=(480, 270),
        frames=48,
    )
