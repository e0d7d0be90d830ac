# SPDX-License-Identifier: Apache-2.0
"""A finding of the doctor: the check, its result, and what to do."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tof_core.errors import ToftwinError


class Level(StrEnum):
    """Severity: good, worth knowing, to be fixed before the graph can work."""

    OK = "ok"
    NOTE = "note"
    FIX = "fix"


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the report; `todo` is empty only where there is nothing to do."""

    level: Level
    check: str
    what: str
    todo: str = ""

    def line(self) -> str:
        """The finding as one line of text."""
        return f"{self.level:<4}  {self.check:<14}  {self.what}" + (f"; {self.todo}" if self.todo else "")

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "level": str(self.level)}


def ok(check: str, what: str) -> Finding:
    """A finding that is good."""
    return Finding(Level.OK, check, what)


def note(check: str, what: str, todo: str) -> Finding:
    """A finding worth knowing; the graph works without a change."""
    return Finding(Level.NOTE, check, what, todo)


def fix(check: str, what: str, todo: str) -> Finding:
    """A finding that keeps the graph from working, or from working correctly."""
    return Finding(Level.FIX, check, what, todo)


def refused(check: str, error: ToftwinError) -> Finding:
    """A finding from an error that the graph itself would raise."""
    what = f"{error.where}: {error.what}" if error.where else error.what
    return fix(check, " ".join(what.split()), " ".join((error.todo or "fix it, then run doctor again").split()))


def healthy(findings: Iterable[Finding]) -> bool:
    """Whether nothing must be fixed."""
    return all(f.level is not Level.FIX for f in findings)
