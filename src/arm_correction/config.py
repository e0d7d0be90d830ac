# SPDX-License-Identifier: Apache-2.0
"""Configuration of a correction: registration, acceptance, limits of motion."""

from __future__ import annotations

from dataclasses import dataclass

from tof_align.config import WeightConfig
from tof_core.config import param, section


@dataclass(frozen=True, slots=True)
class RegisterConfig:
    """Registration of one depth image to another."""

    pixels: int = param(8000, "pixels of the view that are used, on a raster", low=500)
    coarse_pixels: int = param(500, "pixels of the view that are used while searching", low=100)
    window: int = param(2, "a normal is fitted over 2 n + 1 pixels each way", unit="px", low=1, high=8)
    reach_mm: float = param(330.0, "largest translation of the camera from the wanted pose", unit="mm", low=1.0)
    reach_deg: float = param(17.0, "largest rotation of the camera from the wanted pose", unit="deg", low=0.1)
    tried: int = param(8192, "starts that are scored if the near search fails", low=64)
    kept: int = param(96, "number of the best starts that are refined", low=1)
    far_kernel_mm: float = param(80.0, "largest residual that counts at the start", unit="mm", low=1.0)
    kernel: float = param(4.0, "largest residual that counts in the end, in robust standard deviations", low=1.0)
    grazing_deg: float = param(75.0, "largest incidence that counts", unit="deg", low=10.0, high=89.0)
    rounds: int = param(20, "most iterations of each stage", low=1)


@dataclass(frozen=True, slots=True)
class TrustConfig:
    """When a registration is accepted."""

    min_pixels: int = param(400, "least number of pixels that both images see", low=20)
    min_overlap: float = param(0.15, "least share of the view that the reference also sees", low=0.0, high=1.0)
    min_support: float = param(0.75, "least share of those pixels that agree", low=0.0, high=1.0)
    agree_mm: float = param(8.0, "largest distance of a pixel that agrees (at most four of its sigmas)", unit="mm", low=0.1)
    rival: float = param(1.15, "the result is ambiguous if another solution's misfit is within this factor of the best one's", low=1.0)
    rival_mm: float = param(15.0, "another solution differs by at least this translation", unit="mm", low=0.1)
    rival_deg: float = param(1.5, "or by this rotation", unit="deg", low=0.01)
    chance: float = param(0.35, "a direction is undetermined if this share of its information is noise of the normals", low=0.01, high=1.0)
    known_mm: float = param(2.0, "a translation is undetermined if its sigma exceeds this", unit="mm", low=0.01)
    known_deg: float = param(0.3, "a rotation is undetermined if its sigma exceeds this", unit="deg", low=0.001)


@dataclass(frozen=True, slots=True)
class LimitConfig:
    """Limits of the proposed motion."""

    step_mm: float = param(400.0, "largest translation that is proposed", unit="mm", low=0.1)
    step_deg: float = param(25.0, "largest rotation that is proposed", unit="deg", low=0.01)
    reach_m: float = param(1.4, "the hand stays within this of the body's origin", unit="m", low=0.1)
    low_m: float = param(-0.5, "the hand stays above this height of the body frame", unit="m")
    stale_s: float = param(5.0, "a correction from a view that is older when it is asked for is refused", unit="s", low=0.01)
    moved_mm: float = param(1.0, "refused if the hand has moved since the view by more than this", unit="mm", low=0.01)
    moved_deg: float = param(0.1, "or rotated by more than this", unit="deg", low=0.001)
    disagree_sigma: float = param(4.0, "two dwells disagree if they differ by more than this many of their sigmas", low=1.0)
    disagree_mm: float = param(
        1.5, "and if their translations differ by more than this, or their rotations by more than disagree_deg", unit="mm", low=0.01
    )
    disagree_deg: float = param(0.15, "least difference of rotation at which two dwells may disagree", unit="deg", low=0.001)


@dataclass(frozen=True, slots=True)
class CorrectConfig:
    """Correction to the reference view."""

    register: RegisterConfig = section(RegisterConfig, "registration of the view to the reference")
    trust: TrustConfig = section(TrustConfig, "when it is accepted")
    limits: LimitConfig = section(LimitConfig, "limits of the proposed motion")
    weights: WeightConfig = section(WeightConfig, "noise of pixels, used where the view has no estimate")
