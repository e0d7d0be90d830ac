# SPDX-License-Identifier: Apache-2.0
"""Numbers that decide an alignment, beside priors, weights, discrepancy and verdict (`config`): the search from afar, and shared errors."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param


@dataclass(frozen=True, slots=True)
class ApproachLimits:
    """The search for a station's base from afar: descents with a narrowing kernel, many starts, and slides."""

    views: int = param(6, "views of a station that are used, spread over it", low=1, why="six see a part from all sides of a station")
    independent: float = param(
        100.0, "number of independent pixels that a view counts as", low=1.0, why="outweighs the prior without removing it"
    )
    steps: int = param(24, "Gauss-Newton steps of a descent", low=1, why="a kernel that shrinks by 0.7 a step is narrow after ten")
    residuals: int = param(6, "residuals that a step needs", low=6, why="the pose has six unknowns")
    shrink: float = param(0.7, "factor of the kernel per step", low=0.1, high=0.99, why="a smaller one leaves good pixels out")
    kernel_sigma: float = param(
        3.0, "least kernel in robust standard deviations of the residuals", low=1.0, why="keeps 99.7 % of normal ones"
    )
    still_mm: float = param(0.2, "step below which a descent ends (and 0.2 mrad)", unit="mm", low=1e-4, why="the fit that follows is exact")
    near_kernel_mm: float = param(30.0, "kernel below which a descent may end", unit="mm", low=1.0, why="a wide one admits another surface")
    residual_mm: float = param(
        30.0, "residual at which the score of a pose saturates", unit="mm", low=1.0, why="another surface counts as a miss"
    )
    fits: float = param(
        0.5, "score over the worst score, above which other starts are tried", low=0.0, high=1.0, why="half of the pixels miss"
    )
    wide_mm: float = param(60.0, "prior deviation above which other starts are tried", unit="mm", low=0.1, why="a descent reaches as far")
    wide_deg: float = param(3.0, "the same, rotation", unit="deg", low=1e-3, why="60 mm at 1.1 m")
    starts: int = param(
        256, "poses within the prior that are scored", low=8, high=65536, why="a power of two; six unknowns, 2.5 values each"
    )
    kept: int = param(6, "most promising of them from which a descent starts", low=1, why="time")
    reach: float = param(1.8, "reach of those poses, in prior standard deviations", low=0.1, why="93 % of a normal prior along each axis")
    start_views: int = param(3, "views on which they are scored", low=1, why="time")
    start_stride: int = param(9, "every so many raster pixels, one is used for that", low=1, why="time")
    start_residual_mm: float = param(
        150.0, "residual at which that score saturates", unit="mm", low=1.0, why="the answer is that far from the nearest trial"
    )
    start_kernel_mm: float = param(
        60.0, "width of the kernel of the descents from the best trials", unit="mm", low=1.0, why="starts lie centimetres from the answer"
    )
    better: float = param(
        0.95, "ratio of scores below which another start replaces the present one", low=0.1, high=1.0, why="noise of a score"
    )
    slides: int = param(3, "directions of slides", low=1, high=6, why="a plane leaves three open")
    slide_rounds: int = param(2, "rounds of slides", low=1, why="one slide may make the next possible")
    slide_reach: float = param(1.6, "reach of a slide, in prior standard deviations", low=0.1, why="89 % of a normal prior")
    slide_looks: int = param(10, "trials to either side", low=2, high=1000, why="every 8 mm for a prior of 50 mm; features are wider")
    slide_better: float = param(0.98, "ratio of scores below which a slide is kept", low=0.1, high=1.0, why="noise of a score")
    slide_kernel_mm: float = param(20.0, "kernel of the descent after a slide", unit="mm", low=1.0, why="the slide is near already")


@dataclass(frozen=True, slots=True)
class SharedLimits:
    """Errors that neighbouring pixels share, so that many pixels do not count as many measurements."""

    block: int = param(6, "side of a block of raster pixels", low=2, high=64, why="unmodelled errors are a few raster pixels wide")
    block_share: float = param(0.5, "share of a block that must be seen", low=0.0, high=1.0, why="a sum over fewer is mostly noise")
    blocks: int = param(6, "least blocks of a view", low=2, why="a variance of fewer is not known to a factor of two")
    least: float = param(0.1, "least factor of the stated noise variance", low=1e-6, why="stated noise is at most three times too large")
    measured: float = param(
        0.05,
        "share of a fitted function of range or amplitude that is wrong",
        low=0.0,
        high=1.0,
        why="range and amplitude are measured to a few per cent",
    )
    image: float = param(
        0.05, "the same of an error smooth in the image that all views share", low=0.0, high=1.0, why="all views determine it"
    )
    view: float = param(0.3, "the same of an error of one view", low=0.0, high=1.0, why="in one view it correlates with the pose")
    light: float = param(
        0.3,
        "the same of the light of other parts",
        low=0.0,
        high=2.0,
        why="second bounces, gloss and albedo are unknown by about as much",
    )
    patches: float = param(16.0, "patches of a view within which such errors are equal", low=1.0, why="a quarter of the image each way")
    first_pixels: int = param(12, "pixels of a view's first robust step", low=7, why="twice the unknowns of a pose")
    first_sigma: float = param(3.0, "median deviations at which that step's weight falls to a half", low=0.5, why="two standard deviations")
