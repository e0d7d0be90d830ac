# SPDX-License-Identifier: Apache-2.0
"""Numbers that decide when lost, wrapped and mixed pixels are an effect."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param, section
from tof_gap.limits.filters import FilterLimits, SmearLimits


@dataclass(frozen=True, slots=True)
class LossLimits:
    """The chance from which a quantity separates a lost pixel from a measured one (area under the ROC curve): 0.5 never, 1 always."""

    by_amplitude: float = param(
        0.99,
        "least separation by the amplitude image",
        low=0.5,
        high=1.0,
        why="two cameras with a threshold: 1.00; a part or a range that is lost: 0.98 at most",
    )
    by_range: float = param(
        0.999, "least separation by range", low=0.5, high=1.0, why="a measuring range ends sharply; low amplitude far away: 0.99"
    )
    by_light: float = param(
        0.95, "by the amplitude that the CAD predicts", low=0.5, high=1.0, why="two cameras with a threshold: at least 0.98"
    )
    by_part: float = param(
        0.8,
        "least separation by the part",
        low=0.5,
        high=1.0,
        why="a third of a quarter of the pixels lost on one part: 0.91; at random: 0.51",
    )
    shown: float = param(
        0.5, "share of the lost pixels that have an amplitude", low=0.0, high=1.0, why="some cameras state 0 for all of them"
    )
    carried: float = param(0.8, "share of the loss that the named parts carry together", low=0.0, high=1.0, why="the rest is spread")


@dataclass(frozen=True, slots=True)
class MissingLimits:
    """When missing, wrapped or mixed pixels are an effect."""

    lost_share: float = param(
        0.01, "share of CAD pixels missing, away from edges", low=1e-6, high=1.0, why="single dead or dark pixels are usual"
    )
    lost_on_part: float = param(
        0.05,
        "the same, on one part",
        low=1e-6,
        high=1.0,
        why="healthy cameras lose 0.1 % of a part at most; a small dark part is little of the CAD",
    )
    weakest: float = param(
        0.02,
        "share of the CAD's pixels, the darkest ones, whose loss is not attributed to their part",
        low=0.0,
        high=1.0,
        why="a far floor at 55 degrees is below a healthy camera's threshold; twice `lost_share`",
    )
    by_design_mm: float = param(
        6.0,
        "noise of one capture at the threshold amplitude from which the loss of weak light is by design",
        unit="mm",
        low=0.0,
        why="a healthy threshold of another author's camera, four sessions: 7.9 to 9.0; a threshold that is too strict: 3.2",
    )
    by_design_light: float = param(
        0.25,
        "threshold amplitude over the session's median up to which that holds",
        low=0.0,
        why="healthy thresholds of the same camera: 0.10 to 0.20, with up to 10 % of the pixels lost; a raised threshold in much noise: 0.39",
    )
    by_design_share: float = param(
        0.05,
        "or share of the pixels that are lost up to which it holds",
        low=0.0,
        high=1.0,
        why="one pixel in twenty, each noisier than `by_design_mm`, is no cost, whatever the session's usual light",
    )
    brighter: float = param(
        0.8, "chance that a saturated pixel is brighter than a measured one of its part", low=0.5, high=1.0, why="lost at random: 0.5"
    )
    part_pixels: int = param(500, "pixels of a part whose loss is judged by itself", low=1, why="5 % are known to 1 %")
    filter_px: int = param(
        18, "largest hole that a filter leaves around an outlier", unit="px", low=1, why="two outliers, each with its 3 x 3"
    )
    filter_single: float = param(
        0.1,
        "share of single pixels in such holes above which no filter made them",
        low=0.0,
        high=1.0,
        why="lost at random, most are single",
    )
    lost_grazing_deg: float = param(
        60.0,
        "incidence beyond which a missing pixel is usual",
        unit="deg",
        low=30.0,
        high=90.0,
        why="filters of flying pixels mistake slopes for edges; across a pixel's diagonal and with noise from 65 degrees on",
    )
    saturated: float = param(
        0.999,
        "quantile of the session's amplitudes that counts as the brightest",
        low=0.0,
        high=1.0,
        why="single pixels are brighter by noise",
    )
    bright: float = param(
        0.95,
        "amplitude of a saturated pixel, over the brightest",
        low=0.0,
        why="where charge is cut off, amplitude stays or falls by some per cent",
    )
    half_lost: float = param(0.5, "loss at the stated threshold amplitude", low=0.0, high=1.0, why="definition of the threshold")
    dark_lost: float = param(
        0.1,
        "loss away from edges of pixels that are too dark to judge edges by",
        low=0.0,
        high=1.0,
        why="a fifth of the mixed pixels that are required",
    )
    albedo_pixels: int = param(50, "pixels with an amplitude that determine a part's albedo", low=1, why="their median is known to 10 %")
    lost_bins: int = param(40, "bins of amplitude of the predicted loss", low=2, why="loss follows amplitude closely")
    half_bins: int = param(20, "bins of amplitude of the threshold", low=2, why="the threshold is known to 5 % of the pixels")
    near_px: int = param(7, "side of the window of local loss", unit="px", low=1, high=99, why="49 pixels: a share is known to 7 %")
    turn_share: float = param(
        0.002, "share of pixels off by a common jump", low=1e-6, high=1.0, why="foreign objects make jumps of many sizes"
    )
    turn_spread_mm: float = param(60.0, "spread of a common jump", unit="mm", low=1.0, why="bias beside the wrap: the gross bound")
    turn_majority: float = param(
        0.5, "share of all jumps that have the common size", low=0.0, high=1.0, why="else they are foreign objects"
    )
    turn_least_mm: float = param(200.0, "least jump that counts", unit="mm", low=1.0, why="wraps are longer: 375 mm at 400 MHz")
    turn_reach: float = param(
        0.4,
        "largest deviation of a wrapped pixel from the known jump, over the jump",
        low=0.0,
        high=0.5,
        why="nearer to a wrap than to none",
    )
    turn_start: float = param(
        0.02, "quantile of the wrapped pixels' range that is the stated start", low=0.0, high=0.5, why="2 % may be outliers"
    )
    lamp_m: float = param(
        0.05,
        "farthest place of the lamp beside the lens, for its shadows",
        unit="m",
        low=1e-3,
        high=0.5,
        why="hand-held cameras: 2 to 4 cm",
    )
    edge_reach_px: int = param(
        4,
        "distance beyond the edge band within which jumps may be edges, and lost pixels shadows of the lamp",
        unit="px",
        low=0,
        high=64,
        why="pose errors move edges",
    )
    flying_share: float = param(
        0.25,
        "mixed pixels measured between their surfaces, over those expected",
        low=1e-6,
        high=1.0,
        why="pose errors place some there without mixing",
    )
    unfiltered_share: float = param(
        0.4,
        "the same ratio, from which `flying_pixels` is named",
        low=1e-6,
        high=1.0,
        why="working edge filters of three cameras: 0.03 to 0.25; switched off, of two cameras: 0.46 and 0.48",
    )
    step_mm: float = param(
        30.0, "depth step of an edge that can show mixing", unit="mm", low=1.0, why="ten standard deviations of usual noise"
    )
    step_sigma: float = param(10.0, "the same, in noise standard deviations", low=1.0, why="noise alone would lie between")
    mixed_pixels: int = param(80, "mixed pixels of the session", low=4, why="a share is known to 6 %")
    mixed_least: float = param(0.05, "mixed share of a pixel that counts", low=0.0, high=1.0, why="less moves it by less than noise")
    mixed_fitted: float = param(0.02, "mixed share of a pixel that is fitted", low=0.0, high=1.0, why="the fit weighs by size")
    between: float = param(
        0.15,
        "least distance of a pixel between two surfaces from either, over their step",
        low=0.0,
        high=0.5,
        why="pose and noise blur the surfaces",
    )
    fitted_mm: float = param(2.0, "predicted mixing of a pixel that is fitted", unit="mm", low=0.0, why="the usual noise")
    filter: FilterLimits = section(FilterLimits, "holes that a filter leaves")
    smear: SmearLimits = section(SmearLimits, "edges that a filter smears")
    loss: LossLimits = section(LossLimits, "what separates lost pixels from measured ones")
