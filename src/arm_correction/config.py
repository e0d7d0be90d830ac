# SPDX-License-Identifier: Apache-2.0
"""What a correction can be told: how far to look, when to believe it, how far to move."""

from __future__ import annotations

from dataclasses import dataclass

from tof_align.config import WeightConfig
from tof_core.config import param, section


@dataclass(frozen=True, slots=True)
class RegisterConfig:
    """Registration of one depth image to another."""

    pixels: int = param(8000, "pixels of the view that take part, on a raster", low=500)
    coarse_pixels: int = param(500, "the same while searching", low=100)
    window: int = param(2, "a normal is fitted over 2 n + 1 pixels each way", unit="px", low=1, high=8)
    reach_mm: float = param(330.0, "how far the camera may be from where it should be", unit="mm", low=1.0)
    reach_deg: float = param(17.0, "how far it may be turned", unit="deg", low=0.1)
    tried: int = param(8192, "starts that are scored when the near step fails", low=64)
    kept: int = param(96, "best of them that are refined", low=1)
    far_kernel_mm: float = param(80.0, "residuals beyond this do not count at the start", unit="mm", low=1.0)
    kernel: float = param(4.0, "residuals beyond this many robust scales do not count in the end", low=1.0)
    grazing_deg: float = param(75.0, "surfaces seen flatter than this do not count", unit="deg", low=10.0, high=89.0)
    rounds: int = param(20, "iterations at most of each stage", low=1)


@dataclass(frozen=True, slots=True)
class TrustConfig:
    """When a registration is believed."""

    min_pixels: int = param(400, "pixels that both images see, at least", low=20)
    min_overlap: float = param(0.15, "share of the view that the reference sees too, at least", low=0.0, high=1.0)
    min_support: float = param(0.75, "share of those that agree, at least", low=0.0, high=1.0)
    agree_mm: float = param(8.0, "agreeing means closer than this (and than four of their sigmas)", unit="mm", low=0.1)
    rival: float = param(1.15, "another answer within this factor of the best one's misfit makes it ambiguous", low=1.0)
    rival_mm: float = param(15.0, "another answer is one at least this far away", unit="mm", low=0.1)
    rival_deg: float = param(1.5, "or turned by this", unit="deg", low=0.01)
    chance: float = param(0.35, "a direction whose information is to this share the normals' noise is unknown", low=0.01, high=1.0)
    known_mm: float = param(2.0, "a slide known worse than this (one sigma) is unknown", unit="mm", low=0.01)
    known_deg: float = param(0.3, "a turn known worse than this (one sigma) is unknown", unit="deg", low=0.001)


@dataclass(frozen=True, slots=True)
class LimitConfig:
    """What the arm may be asked to do."""

    step_mm: float = param(400.0, "largest step that is proposed", unit="mm", low=0.1)
    step_deg: float = param(25.0, "largest turn that is proposed", unit="deg", low=0.01)
    reach_m: float = param(1.4, "the hand stays within this of the body's origin", unit="m", low=0.1)
    low_m: float = param(-0.5, "the hand stays above this height of the body frame", unit="m")
    stale_s: float = param(5.0, "an older view is no basis for a move", unit="s", low=0.01)
    moved_mm: float = param(1.0, "the hand has not moved since the view by more than this", unit="mm", low=0.01)
    moved_deg: float = param(0.1, "nor turned by more than this", unit="deg", low=0.001)
    disagree_sigma: float = param(4.0, "two dwells that differ by more of their own sigmas disagree", low=1.0)
    disagree_mm: float = param(1.5, "and by more than this", unit="mm", low=0.01)
    disagree_deg: float = param(0.15, "or than this", unit="deg", low=0.001)


@dataclass(frozen=True, slots=True)
class CorrectConfig:
    """Back to the first picture."""

    register: RegisterConfig = section(RegisterConfig, "registration of the view to the reference")
    trust: TrustConfig = section(TrustConfig, "when it is believed")
    limits: LimitConfig = section(LimitConfig, "what is never proposed")
    weights: WeightConfig = section(WeightConfig, "noise of pixels where the view does not tell it")
