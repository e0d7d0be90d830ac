# SPDX-License-Identifier: Apache-2.0
"""What alignment can be told: priors of the robot, weights of pixels, when to refuse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.config import param, section

if TYPE_CHECKING:
    from tof_core.arrays import Float


@dataclass(frozen=True, slots=True)
class Priors:
    """How far the robot's own pose may be off, one standard deviation per axis."""

    base_mm: float = param(50.0, "where the base really stands, per station", unit="mm", low=1e-3)
    base_deg: float = param(2.0, "how the base is really turned, per station", unit="deg", low=1e-4)
    arm_mm: float = param(1.0, "the arm's own error, per view", unit="mm", low=1e-3)
    arm_deg: float = param(0.1, "the arm's own error, per view", unit="deg", low=1e-4)
    hand_eye_mm: float = param(3.0, "hand-eye calibration, one per session", unit="mm", low=1e-3)
    hand_eye_deg: float = param(0.3, "hand-eye calibration, one per session", unit="deg", low=1e-4)

    @property
    def base(self) -> Float:
        """Standard deviations (6,) in metres and radians."""
        return _six(self.base_mm, self.base_deg)

    @property
    def arm(self) -> Float:
        """Standard deviations (6,) in metres and radians."""
        return _six(self.arm_mm, self.arm_deg)

    @property
    def hand_eye(self) -> Float:
        """Standard deviations (6,) in metres and radians."""
        return _six(self.hand_eye_mm, self.hand_eye_deg)


def _six(mm: float, deg: float) -> Float:
    return np.repeat([mm / 1000.0, np.radians(deg)], 3)


@dataclass(frozen=True, slots=True)
class WeightConfig:
    """How much one pixel counts."""

    pixels: int = param(8000, "pixels of a view that enter the normal equations, on a raster", low=200)
    last_pixels: int = param(24000, "the same for the last linearisation, where the session's views are few enough", low=200)
    last_total: int = param(800_000, "most pixels of all views together that the last linearisation holds", low=200)
    coarse_pixels: int = param(1200, "the same while far from the answer", low=100)
    live_pixels: int = param(4000, "the same for a live view (causal mode)", low=200)
    noise_mm: float = param(2.0, "noise of one capture where the view does not tell it", unit="mm", low=1e-3)
    floor_mm: float = param(0.1, "least noise of a pixel (quantisation)", unit="mm", low=1e-4)
    kernel: float = param(4.7, "residuals beyond this many robust scales do not count (Tukey)", low=1.0)
    kernel_floor_mm: float = param(4.0, "the kernel never gets narrower than this", unit="mm", low=0.01)
    kernel_far_mm: float = param(150.0, "kernel at the start, shrinking from there", unit="mm", low=1.0)
    grazing_deg: float = param(78.0, "surfaces seen flatter than this do not count", unit="deg", low=10.0, high=90.0)
    edge_mm: float = param(6.0, "a neighbour on the raster off the surface's plane by more is an edge", unit="mm", low=0.1)


@dataclass(frozen=True, slots=True)
class DiscrepancyConfig:
    """What the camera may do that no one modelled: smooth errors whose size the data tell."""

    enabled: bool = param(True, "estimate smooth errors that neighbours and views share")
    start_mm: float = param(1.0, "size assumed before the data are asked", unit="mm", low=1e-3)
    floor_mm: float = param(0.01, "never believed smaller than this", unit="mm", low=1e-5)
    ceiling_mm: float = param(30.0, "never believed larger than this", unit="mm", low=0.1)
    range_m: float = param(0.12, "correlation length of errors that depend on range", unit="m", low=0.01)
    object_m: float = param(0.15, "correlation length of errors that stick to the surface", unit="m", low=0.01)
    centres: int = param(40, "points of the surface that carry those errors", low=0)
    image_order: int = param(5, "highest order of errors that are smooth in the image", low=0, high=12)
    rounds: int = param(15, "rounds that estimate the sizes", low=1)


@dataclass(frozen=True, slots=True)
class VerdictConfig:
    """When an answer is given, and when not."""

    min_pixels: int = param(200, "fewer pixels on the CAD than this (of the raster) are no view of it", low=6)
    min_support: float = param(
        0.5, "least share of those pixels, and of what tells any one direction, that agrees with the CAD", low=0.0, high=1.0
    )
    support_mm: float = param(15.0, "agreeing means closer than this (and than the kernel)", unit="mm", low=0.1)
    max_step: float = param(4.0, "largest step from the robot's pose, in its standard deviations", low=0.1)
    null_ratio: float = param(0.5, "a direction is known when the data are this much surer than the robot", low=1e-3)
    lever_m: float = param(0.3, "1 rad weighs like this many metres where directions mix", unit="m", low=1e-3)


@dataclass(frozen=True, slots=True)
class AlignConfig:
    """Alignment of views to the CAD."""

    mode: str = param(
        "session",
        "session: one solution along the chain; per_view: a free pose per view (the paper's); robot: keep the robot's pose",
        choices=("session", "per_view", "robot"),
    )
    iterations: int = param(4, "linearisations of the fine stage", low=1)
    priors: Priors = section(Priors, "how far the robot's pose may be off")
    weights: WeightConfig = section(WeightConfig, "how much a pixel counts")
    discrepancy: DiscrepancyConfig = section(DiscrepancyConfig, "errors nobody modelled")
    verdict: VerdictConfig = section(VerdictConfig, "when to refuse")
