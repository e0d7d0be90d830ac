# SPDX-License-Identifier: Apache-2.0
"""An effect found by other evidence than smooth bias: by noise, missing pixels, gross errors or edges."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tof_core.arrays import Float, Mask
    from tof_sensor.effect import Effect
    from tof_sensor.effects.photon_law import PhotonLaw

CONFIDENT = 0.95
"""Confidence of a finding whose tests pass or fail and give no graded statistic."""

LOSS_CONFIDENT = 0.9
"""The same of lost pixels, whose cause is read off the shape of holes and the light at their rims. Of nineteen on the emerging camera, eighteen were right."""


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """An effect found by noise, missing pixels, gross errors or mixed edges.

    `confidence` 0..1; `std` of its parameters; `share` (V, H, W) metres that it adds per pixel (standard deviation where it is
    noise), or None; `corrects` whether the share can be subtracted from the measured depth; `common` (V, H, W) metres of noise
    that neighbours share: no model predicts it, but it is no unexplained structure either; `note`: the evidence in words;
    `beside`: the photon law that the noise was compared with, where that is stated and not fitted to the session; `posed_m`: metres RMS
    of noise that neighbours share and that the poses took; `own_noise` (H, W): pixels with a noise of their own, which are in no figure;
    `size`, `remedy`: in words, where the evidence says more than the effect's parameters; `parts`: indices of those that carry most of it;
    `rare`: whether pixels are lost that are neither lost at random nor all that there is in the dark, as a filter around outliers takes them;
    `structure`: whether it was read off structure of residuals, of arm errors, or of holes around outliers, which an effect without a name may leave too.
    """

    effect: Effect
    confidence: float
    std: dict[str, float] = field(default_factory=dict)
    share: Float | None = None
    corrects: bool = False
    common: Float | None = None
    note: str = ""
    beside: PhotonLaw | None = None
    posed_m: float = 0.0
    own_noise: Mask | None = None
    structure: bool = False
    size: str = ""
    remedy: str = ""
    parts: tuple[int, ...] = ()
    rare: bool = False

    @property
    def name(self) -> str:
        """Name in the vocabulary."""
        return self.effect.NAME


def most(effect: type[Effect], name: str) -> float:
    """The upper bound that an effect states for its parameter."""
    return float(effect.__dataclass_fields__[name].metadata["high"])  # type: ignore[attr-defined]
