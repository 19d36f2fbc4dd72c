"""Settings of light by name, `render --quality fast|balanced|best`: what `bench gi` found to be Pareto-best.

`bench gi` writes them as `presets.json`; the copy of one such file that lies beside this module is what the
names mean where no other file is given.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Any, get_args

from pipelines.documents import SCHEMA_VERSION, write_json
from pipelines.errors import UsageError
from pipelines.methods import METHODS, SOFTWARE_PROBES, Quality

QUALITIES: tuple[Quality, ...] = get_args(Quality)

SHIPPED = "gi_presets.json"


@dataclass(frozen=True)
class GiPreset:
    """gi: one of `methods.METHODS`. max_primitives: of a set that has yet to be fitted. max_probes: of the
    grid, at most. rays_per_probe: in a frame."""

    gi: str
    max_primitives: int
    max_probes: int
    rays_per_probe: int

    def technique_options(self, *, software: bool) -> dict[str, Any]:
        """Settings of the technique; a software adapter gets no more probes than by default."""
        probes = min(self.max_probes, SOFTWARE_PROBES) if software else self.max_probes
        return {"max_probes": probes, "rays_per_probe": self.rays_per_probe}

    def describe(self) -> str:
        """In words."""
        return (
            f"{self.gi}, {self.max_primitives:,} primitives, {self.max_probes:,} probes, "
            f"{self.rays_per_probe} rays a probe, at most"
        )


def write_presets(file: Path, presets: Mapping[str, GiPreset], source: Mapping[str, Any]) -> None:
    """Writes presets with where they come from."""
    document = {"schema_version": SCHEMA_VERSION, "source": source}
    write_json(file, document | {"presets": {name: asdict(preset) for name, preset in presets.items()}})


def find_preset(name: str, file: Path | None = None) -> GiPreset:
    """The preset of a file called so; without a file, of those that come with the program.

    Raises:
        UsageError: there is no such preset, or the file holds none.
    """
    if file is None:
        text, where = resources.files("pipelines").joinpath(SHIPPED).read_text(encoding="utf-8"), SHIPPED
    elif file.is_file():
        text, where = file.read_text(encoding="utf-8"), str(file)
    else:
        raise UsageError(f"--presets {file}: no such file; bench gi writes one")
    try:
        presets = {key: GiPreset(**values) for key, values in json.loads(text)["presets"].items()}
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise UsageError(f"--presets {where}: this is no presets.json of bench gi: {error!r}") from None
    if name not in presets:
        raise UsageError(f"--quality {name}: {where} has {', '.join(presets) or 'no preset at all'}")
    if presets[name].gi not in METHODS:
        raise UsageError(f"--presets {where}: {presets[name].gi!r} is no way to light")
    return presets[name]
