"""The `sdfprim` command."""

from __future__ import annotations

import cyclopts

app = cyclopts.App(name="sdfprim", help="Analytic SDF primitives for any glTF scene, and light through them.")


def main() -> None:
    """Entry point of the console script."""
    app()
