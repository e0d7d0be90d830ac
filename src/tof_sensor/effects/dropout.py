# SPDX-License-Identifier: Apache-2.0
"""Dropout: no return where too little light returns, and at random."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_core.shares import in_percent
from tof_sensor.effect import Effect, Evidence

if TYPE_CHECKING:
    from tof_sensor.frame import Frame


LEAST_STATED = 0.005
"""Least share of pixels lost at random that is stated: a few dead or dark pixels are usual."""

KNOWN_THRESHOLD = 1.5
"""Threshold of a session over that of sensor.yaml, up to which both are the same: each is known by the CAD's albedo, off by up to 40 %."""
KNOWN_RANDOM = 0.01
"""Share lost at random beyond that of sensor.yaml, up to which both are the same: what a healthy camera may lose."""


@dataclass(frozen=True, slots=True)
class Dropout(Effect):
    """P(missing) = random + (1 - random) / (1 + (A / threshold)^steepness) (docs/effects.md)."""

    NAME: ClassVar[str] = "dropout"
    ORDER: ClassVar[int] = 80
    MEANING: ClassVar[str] = "pixels without depth, away from edges and surfaces seen at a slant"
    REMEDY: ClassVar[str] = (
        "where light is weak, expose longer, come closer or lower the camera's confidence threshold; where it is not, look at the surfaces, "
        "the camera's filters and the link that carries its images"
    )
    EVIDENCE: ClassVar[Evidence] = Evidence.MISSING

    threshold: float = param(0.0, "amplitude at which half of the pixels are lost, camera's unit", low=0.0)
    steepness: float = param(6.0, "how sharply loss sets in", low=0.5, high=50.0)
    random: float = param(0.0, "share lost whatever the amplitude", low=0.0, high=1.0)

    @property
    def stated(self) -> str:
        """Share of lost pixels, and amplitude threshold."""
        parts = [f"{in_percent(self.random)} of the pixels at random"] if self.random > LEAST_STATED else []
        parts += [f"most pixels below amplitude {self.threshold:.3g}"] if self.threshold > 0 else []
        return ", ".join(parts) or "some of the pixels"

    def includes(self, other: Effect) -> bool:
        """Whether the other loss is of light hardly brighter, and of hardly more pixels at random."""
        if not isinstance(other, Dropout):
            return False
        return other.threshold <= KNOWN_THRESHOLD * self.threshold and other.random <= self.random + KNOWN_RANDOM

    def apply(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Remove pixels; `missing` contains the probability."""
        light = np.maximum(frame.amplitude, 1e-12) / max(self.threshold, 1e-12)
        p = self.random + (1 - self.random) / (1 + np.minimum(light, 1e3) ** self.steepness)
        p = np.where(self.threshold > 0, p, self.random)
        lost = rng.random(p.shape) < p
        return replace(frame, depth=np.where(lost, np.nan, frame.depth), missing=1 - (1 - frame.missing) * (1 - p))
