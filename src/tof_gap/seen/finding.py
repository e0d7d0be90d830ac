# SPDX-License-Identifier: Apache-2.0
"""What another kind of evidence than smooth bias says: one finding, its strength and its map."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.effect import Effect


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """An effect named by scatter, by missing pixels, by gross errors or at edges.

    `confidence` 0..1; `share` (V, H, W) metres that it adds per pixel (its size where it scatters),
    or None; `corrects` whether the share can be taken off the measured depth; `common` (V, H, W) metres of scatter
    that neighbours have in common: no model foretells it, but it is no unexplained structure either.
    """

    effect: Effect
    confidence: float
    std: dict[str, float] = field(default_factory=dict)
    share: Float | None = None
    corrects: bool = False
    common: Float | None = None
    note: str = ""

    @property
    def name(self) -> str:
        """Name in the vocabulary."""
        return self.effect.NAME
