"""The one exception that reading a glTF file raises."""

from __future__ import annotations

from pathlib import Path


class GltfError(ValueError):
    """A file that can't be read: its message is "file: place: what is wrong; what to do about it".

    `place` is the JSON path of the offending value (`meshes[3].primitives[0].indices`) or a part of the
    container ("glb header").
    """

    def __init__(self, file: Path | str, place: str, what: str) -> None:
        super().__init__(printable(f"{file}: {place}: {what}"))
        self.file = str(file)
        self.place = place
        self.what = what


def printable(text: str) -> str:
    """Text without lone surrogates, which JSON may escape and no terminal or file can encode."""
    return text.encode("utf-8", "replace").decode("utf-8")
