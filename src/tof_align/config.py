# SPDX-License-Identifier: Apache-2.0
"""Settings of the alignment: priors of the robot, weights of pixels, discrepancy, when to refuse."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_align.limits import ApproachLimits, SharedLimits
from tof_core.config import param, section

if TYPE_CHECKING:
    from tof_core.arrays import Float


@dataclass(frozen=True, slots=True)
class Priors:
    """Errors of the robot's pose, one standard deviation per axis."""

    base_mm: float = param(50.0, "position error of the base, per station", unit="mm", low=1e-3, why="navigation of mobile bases")
    base_deg: float = param(2.0, "rotation error of the base, per station", unit="deg", low=1e-4, why="the same")
    arm_mm: float = param(1.0, "position error of the arm, per view", unit="mm", low=1e-3, why="calibrated arms; set it to the data sheet")
    arm_deg: float = param(0.1, "rotation error of the arm, per view", unit="deg", low=1e-4, why="the same")
    hand_eye_mm: float = param(3.0, "position error of hand-eye, one per session", unit="mm", low=1e-3, why="usual after a calibration")
    hand_eye_deg: float = param(0.3, "rotation error of hand-eye, one per session", unit="deg", low=1e-4, why="the same")

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

    pixels: int = param(8000, "pixels of a view that enter the normal equations, on a raster", low=200, why="time")
    last_pixels: int = param(
        24000,
        "the same for the last linearisation, as far as `last_total` allows",
        low=200,
        why="where noise limits, the pose is better by 1.7",
    )
    last_total: int = param(800_000, "most pixels of all views together in the last linearisation", low=200, why="memory")
    last_mm: float = param(
        0.2,
        "unmodelled error below which the last linearisation takes more pixels",
        unit="mm",
        low=0.0,
        why="more would repeat a larger one",
    )
    coarse_pixels: int = param(1200, "pixels of a view in the search from afar", low=100, why="time")
    live_pixels: int = param(4000, "pixels of a live view (causal mode)", low=200, why="time between two frames")
    noise_mm: float = param(
        2.0, "noise of one capture where the view does not state it", unit="mm", low=1e-3, why="usual of one capture at 1 m"
    )
    floor_mm: float = param(0.1, "least noise of a pixel (quantisation)", unit="mm", low=1e-4, why="a tenth of a 16UC1 code")
    kernel: float = param(4.7, "width of Tukey's kernel in robust standard deviations", low=1.0, why="95 % efficient on normal residuals")
    kernel_floor_mm: float = param(4.0, "least width of the kernel", unit="mm", low=0.01, why="two standard deviations of usual noise")
    kernel_far_mm: float = param(150.0, "width of the kernel at the start", unit="mm", low=1.0, why="three base deviations")
    grazing_deg: float = param(78.0, "largest incidence that counts", unit="deg", low=10.0, high=90.0, why="1 mm of pose is 5 mm of depth")
    edge_mm: float = param(
        6.0,
        "deviation of a neighbour from the surface's plane that makes an edge",
        unit="mm",
        low=0.1,
        why="three standard deviations of usual noise",
    )
    shared: SharedLimits = section(SharedLimits, "errors that neighbouring pixels share")


@dataclass(frozen=True, slots=True)
class DiscrepancyConfig:
    """Smooth errors of the camera that no effect describes; their size is estimated from the data."""

    enabled: bool = param(True, "estimate smooth errors that neighbours and views share")
    start_mm: float = param(
        1.0, "size of an unmodelled error at the start of the estimate", unit="mm", low=1e-3, why="usual bias is millimetres"
    )
    part_start_mm: float = param(
        0.2,
        "size of a part's motion at the start of the estimate",
        unit="mm",
        low=1e-3,
        why="errors of all pixels are tried before a part is moved",
    )
    floor_mm: float = param(0.01, "least size of an unmodelled error", unit="mm", low=1e-5, why="below any effect")
    ceiling_mm: float = param(30.0, "largest size of an unmodelled error", unit="mm", low=0.1, why="beyond, the scene is wrong")
    range_m: float = param(
        0.12, "correlation length of errors that depend on range", unit="m", low=0.01, why="a third of a wiggle period at 100 MHz"
    )
    object_m: float = param(0.15, "correlation length of errors that belong to the surface", unit="m", low=0.01, why="size of a part")
    centres: int = param(40, "points of the surface at which those errors are estimated", low=0, why="spread over a part")
    parts: bool = param(True, "allow for parts that are displaced from their CAD")
    part_share: float = param(
        0.002,
        "share of all pixels on the CAD from which a part counts and has a motion of its own",
        low=0.0,
        high=1.0,
        why="a smaller part hardly determines a pose, but must not pull as if it were in its place",
    )
    bounces: bool = param(True, "allow for light reflected by other parts")
    lens: bool = param(True, "allow for a lens that differs from CameraInfo")
    lens_least: float = param(
        0.1,
        "least size of the lens's error, in units of a usual calibration's (0.2 %, 1 px, k1 0.01)",
        low=0.0,
        why="corners of a good calibration fit to 0.1 px",
    )
    lens_again_px: float = param(
        1.0, "difference from which poses are solved again with it", unit="px", low=0.0, why="below, its effect on depth is linear"
    )
    image_order: int = param(5, "highest order of errors that are smooth in the image", low=0, high=12, why="20 cosines")
    rounds: int = param(15, "rounds that estimate the sizes", low=1, why="more change little")
    amplitude: float = param(
        1.0, "correlation length of errors that depend on amplitude, in ln amplitude", low=0.01, why="a factor of 2.7 in amplitude"
    )
    knots: float = param(0.4, "spacing of knots, in correlation lengths", low=0.05, high=2.0, why="the error changes little in between")
    most_knots: int = param(60, "knots of one observable", low=4, high=1000, why="24 correlation lengths")

    @property
    def live(self) -> DiscrepancyConfig:
        """Without bounced light and the lens: a live view has no time for them, and few views distinguish them from the other kinds."""
        return replace(self, bounces=False, lens=False)

    @property
    def of_one_view(self) -> DiscrepancyConfig:
        """Without the kinds that one view cannot distinguish from errors smooth in its image: surface, parts, their light, the lens."""
        return replace(self, centres=0, parts=False, bounces=False, lens=False)


@dataclass(frozen=True, slots=True)
class VerdictConfig:
    """When a pose is accepted."""

    min_pixels: int = param(200, "least number of raster pixels on the CAD", low=6, why="fewer do not determine six unknowns")
    min_support: float = param(
        0.5,
        "share of these pixels, and of the information about each direction, that must agree with the CAD",
        low=0.0,
        high=1.0,
        why="else most of what is seen is not the CAD",
    )
    support_mm: float = param(
        15.0,
        "largest distance to the CAD of a pixel that agrees (the kernel may be narrower)",
        unit="mm",
        low=0.1,
        why="usual noise and bias",
    )
    max_step: float = param(
        4.0, "largest step from the robot's pose, in its standard deviations", low=0.1, why="chance: 1 in 15,000 along one axis"
    )
    null_ratio: float = param(
        0.5,
        "ratio of the data's standard deviation to the robot's below which a direction is known",
        low=1e-3,
        why="worse data add little to the robot",
    )
    explained: float = param(
        2.0, "discrepancy, in units of support_mm, above which a pixel does not agree", low=0.0, why="it could explain any pose"
    )
    fewer: float = param(
        0.9,
        "ratio of agreeing pixels to those at the robot's pose below which a pose with a worse score is refused",
        low=0.0,
        high=1.0,
        why="raster and edges move",
    )
    part_mm: float = param(
        2.0,
        "displacement from its CAD, relative to the other parts, above which a part is named",
        unit="mm",
        low=0.0,
        why="usual tolerance of a part",
    )
    part_sigma: float = param(3.0, "the same, in its standard deviations", low=0.0, why="chance: 1 in 370")
    lever_m: float = param(0.3, "metres that count as much as 1 rad where directions mix", unit="m", low=1e-3, why="size of a part")


@dataclass(frozen=True, slots=True)
class AlignConfig:
    """Alignment of views to the CAD."""

    mode: str = param(
        "session",
        "session: one solution along the chain; per_view: a free pose per view (the paper's); robot: keep the robot's pose",
        choices=("session", "per_view", "robot"),
    )
    iterations: int = param(
        4, "most steps of the fine stage", low=1, why="a step is a third of the one before; it ends at half a standard deviation"
    )
    approach: ApproachLimits = section(ApproachLimits, "the search from afar")
    priors: Priors = section(Priors, "errors of the robot's pose")
    weights: WeightConfig = section(WeightConfig, "weights of pixels")
    discrepancy: DiscrepancyConfig = section(DiscrepancyConfig, "unmodelled errors")
    verdict: VerdictConfig = section(VerdictConfig, "when a pose is accepted")
