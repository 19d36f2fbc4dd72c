"""What every command shares: exit codes, how options are spelled, and how a command ends."""

from __future__ import annotations

from typing import Any

from cyclopts import Parameter

OK, FAILED, BAD_USAGE, INTERRUPTED = 0, 1, 2, 130

Numbers = Parameter(allow_leading_hyphen=True)
"""A value may start with a minus sign: --air -1,0,2."""

Output = Parameter(name=("--output", "-o"))
Flag = Parameter(negative="")


def exit_code(report: dict[str, Any]) -> int:
    """Of a batch: `FAILED` where one file did."""
    return FAILED if any(row["status"] != "ok" for row in report["assets"]) else OK
