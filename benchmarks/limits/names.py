# SPDX-License-Identifier: Apache-2.0
"""The numbers that are tried, their halved and doubled values, and which of them a computation reads."""

from __future__ import annotations

from dataclasses import is_dataclass, replace
from typing import TYPE_CHECKING, Any

from tof_align.config import AlignConfig
from tof_core.config import table
from tof_gap.config import GapConfig

if TYPE_CHECKING:
    from tof_core.config import ParamInfo

FACTORS = (0.5, 2.0)
SECTIONS: dict[str, type[Any]] = {"gap": GapConfig, "align": AlignConfig}
"""Sections of `toftwin gap --settings` whose numbers decide."""
SEEDS = ("evidence.seed",)
"""Numbers whose size means nothing."""


STATED = "calibration."
"""What a user states of the camera: it decides nothing by itself."""


def numbers(of: str) -> list[ParamInfo]:
    """The numbers of a section, in the order of `--settings`."""
    return [
        info for info in table(SECTIONS[of]) if info.kind in (int, float) and info.name not in SEEDS and not info.name.startswith(STATED)
    ]


def value_at(info: ParamInfo, factor: float) -> float | None:
    """The default times a factor, held to the number's bounds; None where that is the default itself."""
    value = float(info.default) * factor
    value = max(value, info.low) if info.low is not None else value
    value = min(value, info.high) if info.high is not None else value
    changed: float = round(value) if info.kind is int else value
    return None if changed == info.default else changed


class Reads:
    """A configuration that notes the names of the numbers that are read from it, by stage."""

    def __init__(self, config: Any, notes: dict[str, set[str]], stage: list[str], prefix: str = "") -> None:
        """`stage` holds the name of the present stage, `notes` its reads."""
        self._all = (config, notes, stage, prefix)

    def __getattr__(self, name: str) -> Any:
        """A section that notes its reads too, or a value."""
        config, notes, stage, prefix = self._all
        attribute = getattr(type(config), name, None)
        if isinstance(attribute, property):
            return attribute.fget(self)  # type: ignore[misc]  # Its numbers are read from here.
        value = getattr(config, name)
        if is_dataclass(value):
            return Reads(value, notes, stage, f"{prefix}{name}.")
        notes.setdefault(stage[0], set()).add(prefix + name)
        return value


def replaced(one: Any, **changes: Any) -> Any:
    """`dataclasses.replace`, also of a configuration that notes its reads: what it becomes notes them, too."""
    if not isinstance(one, Reads):
        return replace(one, **changes)
    config, notes, stage, prefix = one._all  # noqa: SLF001
    plain = {name: value._all[0] if isinstance(value, Reads) else value for name, value in changes.items()}  # noqa: SLF001
    return Reads(replace(config, **plain), notes, stage, prefix)
