# SPDX-License-Identifier: Apache-2.0
"""Numbers that decide the solution: first poses, linearisation, and which effects are selected."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param, section


@dataclass(frozen=True, slots=True)
class GateLimits:
    """When the depth image holds distance along the ray."""

    better: float = param(
        0.6, "median residual read as distance along the ray, over that read as depth", low=0.0, high=1.0, why="a few views bend poses"
    )
    least_mm: float = param(
        4.0, "median residual read as depth", unit="mm", low=0.0, why="the wrong reading gives tens of millimetres at the corners"
    )


@dataclass(frozen=True, slots=True)
class StartLimits:
    """First poses, before any effect is considered, and whether the session fits the scene at all."""

    rounds: int = param(2, "linearisations at most", low=1, why="bases are near already")
    inflate: float = param(
        100.0, "divisor of the pixels' weight", low=1.0, why="unmodelled errors are shared by neighbours: the robot's prior must hold"
    )
    pixels: int = param(2000, "pixels on the CAD, of the session", low=6, why="fewer do not determine poses")
    view_pixels: int = param(500, "pixels on the CAD per view, of a short session", low=6, why="the same")
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
        2.0, "step of a camera below which nothing is rendered anew", unit="mm", low=1e-3, why="columns change by less than noise"
    )
    near_deg: float = param(0.2, "the same, rotation", unit="deg", low=1e-4, why="2 mm at 0.6 m")
    lens_px: float = param(
        0.3, "difference of two lenses below which nothing is rendered anew", unit="px", low=1e-3, why="a pixel sees one surface point"
    )
    mixed_px: int = param(
        1, "width added to edge bands where pixels mix", unit="px", low=0, high=10, why="rendering without footprints does not show which"
    )
    mixed_every: int = param(3, "of so many views, one is tested for mixed pixels", low=1, why="all views have the same optics")
    settle_pixels: int = param(
        20_000,
        "pixels of a view that the poses and the chosen effects are fitted to last",
        low=200,
        high=2_000_000,
        why="memory: 8 MB a view",
    )
    frame_taps: float = param(
        12.0, "taps of a frame at most: a stamp is off their mean time by half of them", low=1.0, why="three frequencies of four taps"
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
        0.1, "share of the views that may be left out", low=0.0, high=1.0, why="more have a cause in common, which is to be found"
    )


@dataclass(frozen=True, slots=True)
class SelectLimits:
    """When an effect is believed."""

    gain: float = param(
        30.0, "held-out chi-square that an effect must win; one tried in n forms pays 2 ln n besides", low=1.0, why="inexact maps win some"
    )
    hand_gain: float = param(
        14.0,
        "the same for hand-eye, and for a lens that the stated calibration leaves free",
        low=1.0,
        why="the evidence are errors of the arm and of the lens, whose priors are known",
    )
    share: float = param(
        0.015, "of the visible gap's energy, what an effect must explain", low=0.0, high=1.0, why="less changes a gap of 3 mm by 0.02 mm"
    )
    own_mm: float = param(
        0.1,
        "error that an effect's own terms explain beyond the effect of which it is a form, RMS over all pixels",
        unit="mm",
        low=0.0,
        why="a tenth of what a healthy camera errs by; an offset leaves 0.05 mm to the logarithm of amplitude",
    )
    absorbed: float = param(
        0.1,
        "minimum gain, of the chi-square that an effect could absorb from the others",
        low=0.0,
        high=1.0,
        why="maps of the others are never exact",
    )
    steady: float = param(
        0.25, "of the gain, what must remain without the best view", low=0.0, high=1.0, why="an effect shows in more than one view"
    )
    steady_views: int = param(4, "views of a session in which that is asked", low=2, why="fewer cannot spare one")
    exchange: float = param(
        1.0, "held-out chi-square for which one member is exchanged for another", low=0.0, why="rounding; exchanges end"
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
        6.0, "held-out chi-square by which tied effects differ at most", low=0.0, why="odds of 20 to 1: what a name with 0.95 states"
    )
    most: int = param(5, "effects named at most", low=1, high=12, why="more are rarely separable")
    unknown: float = param(25.0, "held-out chi-square that a free function of an observable pays", low=0.0, why="it has up to twelve knots")
    unknown_share: float = param(
        0.03,
        "of the explained chi-square, what it pays besides, and must win to stay",
        low=0.0,
        high=1.0,
        why="maps of effects are never exact",
    )
    small_share: float = param(
        0.15, "of the visible gap's energy, what an effect beyond the second must explain", low=0.0, high=1.0, why="coincidence"
    )
    small_left: float = param(
        0.15,
        "of the held-out chi-square that is left, what suffices for it instead",
        low=0.0,
        why="without it clearly more would be left: no coincidence",
    )
    small_together: float = param(
        0.06, "of the explained chi-square, what such effects explain together", low=0.0, high=1.0, why="beyond, it is `unknown`"
    )
    least_mm: float = param(
        1.0,
        "RMS over the affected pixels, confirmed by held-out views, that an effect must exceed to be named",
        unit="mm",
        low=0.0,
        why="a healthy camera errs by up to a millimetre: table, temperature, albedo",
    )
    named_freely: int = param(2, "effects of which small ones are believed", low=1, high=12, why="two causes are usual")
    neighbours: float = param(30.0, "drawn pixels that share one unmodelled error", low=1.0, why="such errors are some 15 pixels wide")
    folds: int = param(6, "parts into which the views are dealt for held-out scores", low=2, high=50, why="two of twelve views each")
    rounds: int = param(300, "resamples of the views behind a confidence", low=20, high=100_000, why="confidence is known to 3 points")


@dataclass(frozen=True, slots=True)
class SolveLimits:
    """First poses and linearisation."""

    views: int = param(
        4, "views below which nothing but `radial_depth` is named", low=2, why="fewer leave none to hold out at two stations"
    )
    held_out: int = param(3, "of so many views, one is held out", low=2, high=50, why="most views fit, and every figure rests on several")

    gate: GateLimits = section(GateLimits, "distance along the ray, or depth")
    start: StartLimits = section(StartLimits, "first poses")
    joint: JointLimits = section(JointLimits, "linearisation")
    stray: StrayLimits = section(StrayLimits, "views that contradict the robot")
