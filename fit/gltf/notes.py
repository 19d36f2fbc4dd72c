"""What a reader mended and what it left out, counted while it reads."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field


@dataclass
class Notes:
    """Counts by name, in the order in which they first came up."""

    repairs: Counter[str] = field(default_factory=Counter)
    ignored: Counter[str] = field(default_factory=Counter)

    def repair(self, what: str, count: int = 1) -> None:
        """Count `count` repairs; none for 0."""
        if count:
            self.repairs[what] += int(count)

    def ignore(self, what: str, count: int = 1) -> None:
        """Count `count` things left out; none for 0."""
        if count:
            self.ignored[what] += int(count)

    def repairs_by_name(self) -> dict[str, int]:
        return dict(self.repairs)

    def ignored_lines(self) -> tuple[str, ...]:
        """One line for each kind of thing left out, such as "animations: 3"."""
        return tuple(f"{what}: {count}" for what, count in self.ignored.items())
