# SPDX-License-Identifier: Apache-2.0
"""Settings of the diagnosis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.calibration import Calibration
from tof_core.config import param, section
from tof_gap.limits.evidence import EvidenceLimits, WorldEvidence
from tof_gap.limits.missing import MissingLimits
from tof_gap.limits.noise import NoiseLimits
from tof_gap.limits.report import ReportLimits
from tof_gap.limits.solve import SelectLimits, SolveLimits

if TYPE_CHECKING:
    from tof_core.arrays import Float


@dataclass(frozen=True, slots=True)
class GapConfig:
    """Gap diagnosis of a session."""

    hand_mm: float = param(
        0.05,
        "prior deviation of hand-eye in hypotheses that do not test it, added to the stated calibration",
        unit="mm",
        low=1e-4,
        why="keeps the equations solvable; larger errors are found by the hypothesis hand_eye",
    )
    hand_deg: float = param(0.005, "the same, rotation", unit="deg", low=1e-5, why="the same")
    calibration: Calibration = section(Calibration, "what calibration.yaml beside scene.yaml states: largest errors, modulation")
    evidence: EvidenceLimits = section(EvidenceLimits, "which pixels count")
    world: WorldEvidence = section(WorldEvidence, "when the world is not as the CAD has it")
    solve: SolveLimits = section(SolveLimits, "poses and linearisation")
    select: SelectLimits = section(SelectLimits, "when an effect is believed")
    noise: NoiseLimits = section(NoiseLimits, "when there is more noise than photons make")
    missing: MissingLimits = section(MissingLimits, "when missing pixels are an effect")
    report: ReportLimits = section(ReportLimits, "what the report states")

    @property
    def hand_sd(self) -> Float:
        """(6,) prior deviations of hand-eye where it is not under test: metres, radians."""
        return np.asarray(np.hypot(np.repeat([self.hand_mm * 1e-3, np.radians(self.hand_deg)], 3), self.calibration.hand_eye_sd))

    @property
    def stated_mhz(self) -> tuple[float, ...]:
        """Modulation frequencies that calibration.yaml states; empty where it states none."""
        return self.calibration.modulation.stated

    @property
    def lens_sd(self) -> Float:
        """(4,) prior deviations of fx, fy (relative), cx, cy (pixels) where the lens is not under test; 0: exact."""
        return self.calibration.lens_sd
