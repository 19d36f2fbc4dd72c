"""Typed access to the JSON of a glTF file: every wrong value is an error that names where it stands."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fit.gltf.errors import GltfError, printable

LARGEST_INTEGER = 2**53
"""Above it a JSON number is no longer exact in the readers that most exporters are tested with."""


class JsonObject:
    """A JSON object and its path in the file."""

    __slots__ = ("file", "path", "values")

    def __init__(self, file: Path | str, path: str, values: Mapping[str, Any]) -> None:
        self.file = file
        self.path = path
        self.values = values

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def place(self, key: str = "") -> str:
        """JSON path of this object, or of its value under `key`."""
        return ".".join(part for part in (self.path, key) if part) or "document"

    def error(self, what: str, key: str = "") -> GltfError:
        """The error to raise about this object, or about its value under `key`."""
        return GltfError(self.file, self.place(key), what)

    def integer(self, key: str, default: int | None = None, *, minimum: int = 0) -> int:
        """An integer of at least `minimum`; `default` where there is none.

        Raises:
            GltfError: a wrong type, out of range, or missing without a default.
        """
        if key not in self.values:
            return self._default(key, default)
        value = self.values[key]
        if not _is_number(value) or value != math.floor(value):
            raise self._wrong_type(key, "an integer")
        if not minimum <= value <= LARGEST_INTEGER:
            raise self.error(f"{value} is out of range, at least {minimum} is expected", key)
        return int(value)

    def number(
        self, key: str, default: float | None = None, *, minimum: float = -math.inf, maximum: float = math.inf
    ) -> float:
        """A finite number; errors as in `integer`."""
        if key not in self.values:
            return self._default(key, default)
        value = self.values[key]
        if not _is_number(value):
            raise self._wrong_type(key, "a finite number")
        if not minimum <= value <= maximum:
            raise self.error(f"{value} is out of range, {minimum} to {maximum} is expected", key)
        return float(value)

    def string(self, key: str, default: str | None = None) -> str:
        """A string; errors as in `integer`."""
        if key not in self.values:
            return self._default(key, default)
        value = self.values[key]
        if not isinstance(value, str):
            raise self._wrong_type(key, "a string")
        return printable(value)

    def boolean(self, key: str, default: bool = False) -> bool:
        """true or false; errors as in `integer`."""
        value = self.values.get(key, default)
        if not isinstance(value, bool):
            raise self._wrong_type(key, "true or false")
        return value

    def choice(self, key: str, allowed: Mapping[Any, Any], default: Any = None) -> Any:
        """What `allowed` holds for the value under `key` (or for `default`)."""
        value = self.values.get(key, default)
        if value is None:
            raise self.error(f"required, one of {', '.join(map(str, allowed))}", key)
        if isinstance(value, (dict, list, bool)) or value not in allowed:
            raise self.error(f"{reprlib.repr(value)} is not one of {', '.join(map(str, allowed))}", key)
        return allowed[value]

    def numbers(self, key: str, count: int, default: tuple[float, ...] | None = None) -> tuple[float, ...]:
        """`count` finite numbers; errors as in `integer`."""
        if key not in self.values:
            return self._default(key, default)
        values = self._array(key)
        if len(values) != count or not all(_is_number(value) for value in values):
            raise self.error(f"must be an array of {count} finite numbers", key)
        return tuple(float(value) for value in values)

    def number_list(self, key: str) -> tuple[float, ...]:
        """Any count of finite numbers, none where there is no such key."""
        return self.numbers(key, len(self._array(key)), ())

    def references(self, key: str, size: int, what: str) -> tuple[int, ...]:
        """Indices into a top-level array of `size` entries, none where there is no such key."""
        values = self._array(key)
        return tuple(
            self._checked_reference(f"{key}[{i}]", value, size, what) for i, value in enumerate(values)
        )

    def reference(self, key: str, size: int, what: str) -> int | None:
        """An index into a top-level array of `size` entries called `what`, None where there is no such key.

        Raises:
            GltfError: not an integer, or it points past the end.
        """
        if key not in self.values:
            return None
        return self._checked_reference(key, self.values[key], size, what)

    def required_reference(self, key: str, size: int, what: str) -> int:
        """`reference`, and an error where it is missing."""
        index = self.reference(key, size, what)
        return self._default(key, index)

    def object(self, key: str) -> JsonObject | None:
        """The object under `key`, None where there is none."""
        if key not in self.values:
            return None
        value = self.values[key]
        if not isinstance(value, dict):
            raise self._wrong_type(key, "an object")
        return JsonObject(self.file, self.place(key), value)

    def objects(self, key: str) -> list[JsonObject]:
        """The array of objects under `key`, empty where there is none."""
        found = []
        for i, value in enumerate(self._array(key)):
            if not isinstance(value, dict):
                raise self._wrong_type(f"{key}[{i}]", "an object", value)
            found.append(JsonObject(self.file, self.place(f"{key}[{i}]"), value))
        return found

    def strings(self, key: str) -> tuple[str, ...]:
        """The array of strings under `key`, empty where there is none."""
        values = self._array(key)
        if not all(isinstance(value, str) for value in values):
            raise self.error("must be an array of strings", key)
        return tuple(printable(value) for value in values)

    def extension(self, name: str) -> JsonObject | None:
        """The extension object `name` of this object, None where it has none."""
        extensions = self.object("extensions")
        return extensions.object(name) if extensions else None

    def _array(self, key: str) -> list[Any]:
        value = self.values.get(key, [])
        if not isinstance(value, list):
            raise self._wrong_type(key, "an array")
        return value

    def _checked_reference(self, key: str, value: Any, size: int, what: str) -> int:
        if not _is_number(value) or value != math.floor(value):
            raise self._wrong_type(key, f"the index of one of the {what}", value)
        if not 0 <= value < size:
            raise self.error(f"index {value} points past the end, there are {size} {what}", key)
        return int(value)

    def _default(self, key: str, default: Any) -> Any:
        if default is None:
            raise self.error("required but missing", key)
        return default

    def _wrong_type(self, key: str, wanted: str, value: Any = None) -> GltfError:
        value = self.values.get(key) if value is None else value
        return self.error(f"must be {wanted}, not {reprlib.repr(value)}", key)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return abs(value) <= 1e308 if isinstance(value, int) else math.isfinite(value)
