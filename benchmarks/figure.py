# SPDX-License-Identifier: Apache-2.0
"""One figure: what was measured, its value, the bar it is held to, and the command that prints it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Figure:
    """A measured value beside its bar.

    Attributes:
        what: The quantity in words, with the conditions it was measured under; unique among all figures.
        value: The measured value, in `unit`; NaN when it could not be measured (then `met` is None or False).
        unit: mm, deg, ms, 1/s, %, GB, ... ; "" for a count or a ratio.
        bar: The bar in words ("at most 0.15 mm"); "" for a figure without one.
        met: Whether the value meets its bar; None without a bar.
        command: What anyone types to print it; the runner fills it in when left empty.
        remark: Spread, peer in the same run, or why the bar is missed; one line.
    """

    what: str
    value: float
    unit: str
    bar: str = ""
    met: bool | None = None
    command: str = ""
    remark: str = ""

    def to_dict(self) -> dict[str, Any]:
        """The figure as JSON has it."""
        return asdict(self)


def at_most(what: str, value: float, bar: float, unit: str, *, remark: str = "") -> Figure:
    """A figure that meets its bar from below."""
    return Figure(what, value, unit, f"at most {bar:g} {unit}".rstrip(), value <= bar, remark=remark)


def at_least(what: str, value: float, bar: float, unit: str, *, remark: str = "") -> Figure:
    """A figure that meets its bar from above."""
    return Figure(what, value, unit, f"at least {bar:g} {unit}".rstrip(), value >= bar, remark=remark)
