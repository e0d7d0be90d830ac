# SPDX-License-Identifier: Apache-2.0
"""An effect that noise, missing pixels, gross errors or edges show, and not smooth bias."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tof_core.config import bounds_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tof_core.arrays import Float, Mask
    from tof_sensor.effect import Effect
    from tof_sensor.effects.photon_law import PhotonLaw

CONFIDENT = 0.95
"""Confidence of a finding whose tests only pass or fail."""

LOSS_CONFIDENT = 0.9
"""The same for lost pixels, whose cause follows from the shape of holes and the amplitude at their rims: 18 of 19 were right on a camera of another author."""


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """An effect that noise, missing pixels, gross errors or mixed edges show.

    confidence: 0 to 1; std: of its parameters; share: (V, H, W) metres that it adds to each pixel (standard deviation if it is noise),
    or None; corrects: whether the share can be subtracted from measured depth; common: (V, H, W) metres of noise that neighbours share:
    no model predicts it, but it is no unexplained structure either; note: the evidence in words; beside: the photon law that noise was
    compared with, if `--sensor` states one; posed_m: metres RMS of noise that neighbours share and that the poses absorbed; own_noise:
    (H, W) pixels with a noise of their own, which are in no figure; size, remedy: in words, where the evidence says more than the
    effect's parameters; parts: indices of those that carry most of it; rare: whether loss is neither at random nor below a threshold,
    as a filter around outliers makes it; holes: (H, W) per view, lost pixels that a filter removed around outliers which nobody sees, or
    none; lost: share of the captures of all pixels on the CAD that these holes are; structure: whether the evidence is structure of residuals, arm errors or holes, which an effect
    outside the vocabulary may make too; everywhere: whether it is noise of every pixel at every amplitude; expected: whether the camera is known to have the effect, or has
    it by design: it is then no effect of the session, but it explains what is seen; by_design: why the effect is a camera's design, if
    nobody states it.
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
    holes: tuple[Mask, ...] = ()
    lost: float = 0.0
    everywhere: bool = False
    expected: bool = False
    by_design: str = ""

    @property
    def name(self) -> str:
        """Name in the vocabulary."""
        return self.effect.NAME


def not_expected(findings: Iterable[Finding]) -> list[Finding]:
    """The findings that are effects: the camera neither is known to have them nor has them by design."""
    return [f for f in findings if not f.expected]


def most(effect: type[Effect], name: str) -> float:
    """The upper bound that an effect states for its parameter."""
    return bounds_of(effect, name)[1]
