"""Finds the scenes that come with the program, in the installed package or in the checkout's `assets`."""

from __future__ import annotations

from pathlib import Path

FOLDERS = (Path(__file__).parent / "assets", Path(__file__).parent.parent / "assets")
"""A wheel carries the files inside `pipelines`; an editable install reads the checkout."""


def bundled_file(name: str) -> Path:
    """Path of a bundled file.

    Raises:
        FileNotFoundError: the installation is incomplete.
    """
    for folder in FOLDERS:
        if (folder / name).is_file():
            return folder / name
    raise FileNotFoundError(f"{name} is missing from this installation of sdfprim: install it again")
