# SPDX-License-Identifier: Apache-2.0
"""Numbers that decide the solution: first poses, linearisation, and which effects are selected."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param, section


@dataclass(frozen=True, slots=True)
class GateLimits:
    """When the depth image holds distance along the ray."""

    better: float = param(
        0.6,
        "ratio of the median residual with depth read as distance along the ray to that with z",
        low=0.0,
        high=1.0,
        why="poses of a few views adapt to either reading",
    )
    least_mm: float = param(
        4.0, "least median residual with depth read as z", unit="mm", low=0.0, why="the wrong reading is off by tens of mm at the corners"
    )
    views: int = param(8, "most views that are read as distances along the ray too", low=1, why="the corners of a single view tell most")


@dataclass(frozen=True, slots=True)
class StartLimits:
    """First poses, before any effect is considered, and whether the session fits the scene at all."""

    rounds: int = param(2, "linearisations at most", low=1, why="bases are near already")
    inflate: float = param(
        100.0, "divisor of the pixels' weight", low=1.0, why="unmodelled errors are shared by neighbours: the robot's prior must hold"
    )
    pixels: int = param(2000, "pixels on the CAD, of the session", low=6, why="fewer do not determine poses")
    view_pixels: int = param(500, "the same per view, in a short session", low=6, why="the same")
    near_share: float = param(
        0.5, "share of those pixels that are not gross", low=0.0, high=1.0, why="else most of what is seen is not the CAD"
    )
    unit_ratio: float = param(
        1.25,
        "median ratio of measured and rendered depth, or its inverse, of a wrong unit",
        low=1.0,
        why="the nearest wrong unit is the foot, 3.3",
    )


@dataclass(frozen=True, slots=True)
class JointLimits:
    """Linearisation of poses and effects."""

    rounds: int = param(3, "linearisations at most", low=1, why="steps shrink fast")
    near_mm: float = param(
        2.0, "step of a camera below which nothing is rendered again", unit="mm", low=1e-3, why="columns change by less than noise"
    )
    near_deg: float = param(0.2, "turn of a camera below which nothing is rendered again", unit="deg", low=1e-4, why="2 mm at 0.6 m")
    lens_px: float = param(
        0.3,
        "difference of two lenses below which nothing is rendered again",
        unit="px",
        low=1e-3,
        why="a pixel sees the same surface point",
    )
    mixed_px: int = param(
        1, "width added to edge bands where pixels mix", unit="px", low=0, high=10, why="rendering without footprints does not show which"
    )
    mixed_every: int = param(3, "every so many views, one is tested for mixed pixels", low=1, why="all views have the same optics")
    settle_pixels: int = param(
        20_000,
        "pixels of a view in the last fit of poses and chosen effects",
        low=200,
        high=2_000_000,
        why="memory: 8 MB a view",
    )
    frame_taps: float = param(
        12.0, "most taps of a frame; a stamp is off their mean time by half of them", low=1.0, why="three frequencies of four taps"
    )
    other_surface_mm: float = param(
        20.0, "difference of a rendered map from its first order", unit="mm", low=0.1, why="beyond, another surface is in view"
    )


@dataclass(frozen=True, slots=True)
class StrayLimits:
    """Views whose pose contradicts the robot, and are left out."""

    sigma: float = param(
        4.0,
        "arm error, RMS over its six components in the robot's standard deviations",
        low=1.0,
        why="as a single pose is refused (`align.verdict.max_step`); 2.4 at most in 30 sessions of other cameras",
    )
    share: float = param(
        0.1, "largest share of the views that are left out", low=0.0, high=1.0, why="more have a common cause, which is to be found"
    )
    misfit_mm: float = param(
        10.0, "residual at a view's first pose that the CAD does not explain", unit="mm", low=1.0, why="three times a usual error"
    )
    misfit_share: float = param(
        0.1,
        "share of such pixels from which a first pose may have followed an object",
        low=0.0,
        high=1.0,
        why="a quarter where it did, 2 % in the other views of that session",
    )
    misfit_sigma: float = param(
        2.0,
        "arm error of such a view at its first pose, RMS in the robot's standard deviations, from which it may have followed an object",
        low=0.0,
        why="2.7 where it did, 1.2 at most in 200 views that see none",
    )


@dataclass(frozen=True, slots=True)
class SelectLimits:
    """When an effect is believed."""

    gain: float = param(
        30.0, "held-out chi-square that an effect must win; n forms of it cost 2 ln n more", low=1.0, why="errors of other maps win some"
    )
    hand_gain: float = param(
        14.0,
        "the same for hand-eye, and for a lens that the stated calibration leaves free",
        low=1.0,
        why="they reduce errors of arm and lens, whose priors are known",
    )
    mount_stated: float = param(
        18.0,
        "chi-square of hand-eye against its stated calibration from which it is wrong",
        low=1.0,
        why="position and turn both at the largest errors that are stated",
    )
    lens_beside_rough: float = param(
        100.0,
        "chi-square of a lens against its stated calibration from which it is wrong beside an effect with an inexact map",
        low=0.0,
        why="a right lens beside multipath of 7 mm: 38; a focal length off by 0.9 % beside weak bounces: 650",
    )
    share: float = param(
        0.015, "share of the visible gap's energy that an effect must explain", low=0.0, high=1.0, why="less changes 3 mm by 0.02 mm"
    )
    own_mm: float = param(
        0.1,
        "RMS over all pixels that an effect's own terms must explain beyond the effect without them",
        unit="mm",
        low=0.0,
        why="a tenth of a healthy camera's error; the logarithm of amplitude explains 0.05 mm of an offset",
    )
    absorbed: float = param(
        0.1,
        "least gain, as a share of the chi-square that an effect could absorb from the others",
        low=0.0,
        high=1.0,
        why="maps of the others are never exact",
    )
    on_one_part: float = param(
        0.1,
        "least gain of an effect of a part, as a share of what all effects of this part explain together",
        low=0.0,
        high=1.0,
        why="a map of a part that moved far is of first order: beside a displacement of 7 mm and 2 degrees, a translucent part explains 3 %",
    )
    steady: float = param(
        0.25, "share of the gain that must remain without the best view", low=0.0, high=1.0, why="an effect shows in more than one view"
    )
    steady_views: int = param(4, "least number of views for that test", low=2, why="fewer cannot spare one")
    exchange: float = param(
        1.0, "least gain in held-out chi-square by an exchange of members", low=0.0, why="above rounding, so that exchanges end"
    )
    margin: float = param(
        2.0,
        "standard errors by which a coefficient may lie beyond its bounds",
        low=0.0,
        why="half of the estimates of a value at its bound lie beyond it",
    )
    tie_left: float = param(
        0.25, "share of a map's visible energy below which another effect hides it", low=0.0, high=1.0, why="half of its size"
    )
    tie_gain: float = param(
        6.0, "largest difference of tied effects in held-out chi-square", low=0.0, why="odds of 20 to 1, as a confidence of 0.95"
    )
    most: int = param(5, "most effects that are named", low=1, high=12, why="more are rarely separable")
    unknown: float = param(25.0, "held-out chi-square that a free function of an observable pays", low=0.0, why="it has up to twelve knots")
    unknown_share: float = param(
        0.03,
        "share of the explained chi-square that it pays besides, and must explain to stay",
        low=0.0,
        high=1.0,
        why="maps of effects are never exact",
    )
    small_share: float = param(
        0.15, "share of the visible gap's energy that an effect beyond the second must explain", low=0.0, high=1.0, why="coincidence"
    )
    small_left: float = param(
        0.15,
        "share of the remaining held-out chi-square that suffices instead",
        low=0.0,
        why="clearly more would remain without it: no coincidence",
    )
    small_shared: float = param(
        0.5,
        "share of the variance of means beside two other effects, noise included, which suffices for a third",
        low=0.0,
        high=1.0,
        why="errors of the others' maps are left beside an effect that only corrects them: those take 0.25 at most, a true third 0.6",
    )
    arm_rms: float = param(
        1.3,
        "RMS of arm errors over the robot's prior, of positions and of turns, above which the robot's poses are wrong",
        low=0.0,
        why="an arm as inaccurate as its prior: 1.0 with a standard deviation of 0.1 in 16 views; 120 sessions have 1.0 at most",
    )
    small_together: float = param(
        0.06, "share of the explained chi-square that such effects may explain together", low=0.0, high=1.0, why="beyond, it is `unknown`"
    )
    least_mm: float = param(
        1.0,
        "RMS over the affected pixels, confirmed by held-out views, that an effect must exceed to be named",
        unit="mm",
        low=0.0,
        why="a healthy camera has errors of up to a millimetre: table, temperature, albedo",
    )
    motion_mm: float = param(
        0.4,
        "the same of motion, times the share of its map that the pixels which it moves show, edges among them",
        unit="mm",
        low=0.0,
        why="read-outs that are slow, seven sessions: 0.51 to 2.2; a filter that smooths edges, and late stamps alone, ten sessions: 0.27 at most",
    )
    motion_moved_mm: float = param(
        0.3, "error of a pixel from which motion moves it", unit="mm", low=0.0, why="less is below the noise of any pixel"
    )
    named_freely: int = param(2, "number of effects up to which small ones are named", low=1, high=12, why="two causes are usual")
    neighbours: float = param(30.0, "drawn pixels that share one unmodelled error", low=1.0, why="such errors are some 15 pixels wide")
    chance: float = param(
        1e-3,
        "probability, times the number of an effect's forms, that views before a board differ by chance as the effect makes them differ",
        low=1e-9,
        high=0.5,
        why="1 session in 1000",
    )
    folds: int = param(6, "parts into which the views are dealt for held-out scores", low=2, high=50, why="two of twelve views each")
    rounds: int = param(300, "resamples of the views behind a confidence", low=20, high=100_000, why="confidence is known to 3 points")


@dataclass(frozen=True, slots=True)
class SolveLimits:
    """First poses and linearisation."""

    views: int = param(
        4, "number of views below which only `radial_depth` is named", low=2, why="fewer leave none to hold out at two stations"
    )
    held_out: int = param(3, "every so many views, one is held out", low=2, high=50, why="most views are fitted, figures rest on several")

    gate: GateLimits = section(GateLimits, "distance along the ray, or depth")
    start: StartLimits = section(StartLimits, "first poses")
    joint: JointLimits = section(JointLimits, "linearisation")
    stray: StrayLimits = section(StrayLimits, "views that contradict the robot")
