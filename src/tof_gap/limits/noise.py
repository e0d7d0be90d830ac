# SPDX-License-Identifier: Apache-2.0
"""Limits of what noise shows: rows, columns and single pixels, foreign light, steps, noise beyond the photon law."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param, section
from tof_gap.limits.foreign import BeatLimits, CapturesLimits, ForeignLampLimits, ForeignLightLimits, LitLimits, RepeatedLimits


@dataclass(frozen=True, slots=True)
class LineLimits:
    """When whole rows or columns change together from view to view."""

    pixels: int = param(20, "least pixels of a line", low=2, why="its mean is known to a quarter of the noise")
    views: int = param(5, "least number of views that see a line", low=2, why="a variance of fewer is not known to a factor of two")
    lines: int = param(
        12, "least number of lines that are compared", low=3, why="a few lines beside edges are not all; differences of three overlap"
    )
    sigma: float = param(
        8.0, "standard errors of the lines' excess variance", low=0.0, why="neighbouring differences overlap: as 5.7 of independent ones"
    )
    shared: float = param(
        0.5,
        "noise that quarters of a line have in common which are not adjacent, over the least noise that is named",
        low=0.0,
        high=1.0,
        why="noise of rows in nine sessions: 1.1 and more; rims and creases in 25 healthy sessions: 0.37 at most",
    )
    most_ratio: float = param(
        12.0, "cap of one line's variance ratio", low=1.0, why="one line must not decide; lowers the mean of chi-square by 0.2 %"
    )


@dataclass(frozen=True, slots=True)
class PixelLimits:
    """When single pixels are noisier than their amplitude predicts."""

    ratio: float = param(
        6.0, "median squared deviation over the views, over that of quiet pixels", low=1.0, why="1 in 2000 quiet pixels of 12 views"
    )
    usual: float = param(
        5e-4, "share of quiet pixels beyond `ratio`", low=0.0, high=1.0, why="normal noise: 1 in 1000 of 8 views, fewer of more"
    )
    chance: float = param(
        1e-3, "probability of as many noisy pixels by chance", low=0.0, high=1.0, why="a single pixel in 300 is no evidence"
    )
    views: int = param(8, "views that see the pixel", low=2, why="the median of fewer exceeds `ratio` by chance")
    noisiest: float = param(
        0.02, "share of the pixels that are the noisiest of half of the views", low=1e-3, high=0.5, why="unstable pixels are a few percent"
    )
    least_pixels: int = param(1000, "pixels that both halves of the views see", low=100, why="twenty of them are the noisiest")
    line: float = param(
        0.4,
        "ln variance of a whole line, above or below all, from which its pixels are not judged",
        low=0.01,
        why="noise of pixels by chance, averaged over a line, stays within 0.2",
    )
    repeated: float = param(
        0.5,
        "standard deviations of ln variance by which the noisiest pixels of half of the views exceed all in the other half",
        low=0.0,
        why="unstable pixels of eleven sessions: 0.9 to 2.2; 24 other sessions: 0.27 at most",
    )
    own_mm: float = param(1.0, "noise of such pixels of their own", unit="mm", low=0.0, why="less over few pixels is a usual camera's")
    of_offsets: float = param(
        0.5,
        "their noise RMS over the image, over constant offsets of single pixels",
        low=0.0,
        why="neighbours that an average takes in by chance leave up to 0.7 of their offsets: 0.4 in two such cameras; 7 and 0.8 of unstable pixels",
    )
    around_px: int = param(
        16, "side of the squares whose pixels are compared", unit="px", low=4, high=256, why="a hundred pixels know their median to 10 %"
    )


@dataclass(frozen=True, slots=True)
class StereoLimits:
    """When noise follows range and not amplitude: a camera that triangulates."""

    bins: int = param(8, "bins of amplitude per view", low=3, high=60, why="two slopes need no more")
    least_bins: int = param(12, "least bins of amplitude in the session", low=4, why="four per unknown")
    span: float = param(0.3, "span of ln range^2 and of ln amplitude", low=0.0, why="16 % of range; less shows no slope")
    own_span: float = param(
        0.2, "standard deviation of ln amplitude that range does not explain", low=0.0, why="else the two slopes are one"
    )
    amplitude_power: float = param(
        -0.3, "exponent of amplitude in the variance above which amplitude plays no part", low=-2.0, high=2.0, why="photons: -1 to -2"
    )
    range_power: float = param(
        1.2, "exponent of range^2 in the variance above which range decides", low=-4.0, high=4.0, why="disparity: 2; shot noise: 0"
    )


@dataclass(frozen=True, slots=True)
class NoiseLimits:
    """When there is more noise than photon noise."""

    extra_share: float = param(0.35, "constant noise, over the median noise", low=0.0, high=1.0, why="less changes the total by 6 %")
    law_excess: float = param(
        0.35,
        "relative excess of the median variance over the stated photon law from which noise may be named",
        low=0.0,
        why="by offsets of pixels and errors of maps, healthy sessions exceed single captures of a target by 0.1 to 0.3",
    )
    extra_mm: float = param(
        0.4, "least noise at every amplitude that is named", unit="mm", low=0.0, why="the floor of a usual camera is 0.3 mm"
    )
    extra_filtered_mm: float = param(
        0.8, "the same, of a camera that averages over neighbours", unit="mm", low=0.0, why="it rounds creases by up to 0.5 mm"
    )
    extra_sigma: float = param(4.0, "constant noise, in its own standard errors", low=0.0, why="chance: 1 in 30,000")
    burst: float = param(
        1.12, "noise of a view over that of the quiet views", low=1.02, high=10.0, why="views of one camera differ by some per cent"
    )
    burst_filtered: float = param(1.4, "the same, of a camera that averages over neighbours", low=1.02, high=10.0, why="healthy: 1.21")
    burst_knots: int = param(
        5,
        "knots of the noise's dependence on range and on amplitude",
        low=2,
        why="noise over a pulse's gates has one or two extrema; more knots follow single views",
    )
    burst_sigma: float = param(3.0, "the same, in standard deviations of the quiet views' ln variance", low=0.0, why="chance: 1 in 700")
    alone: float = param(
        2.0, "variance of a single view over that of the quiet views", low=1.0, why="one view may be another kind of scene"
    )
    quiet_share: float = param(
        0.25, "least share of the views without a burst", low=0.0, high=1.0, why="with fewer there is nothing to compare"
    )
    quiet_margin: float = param(1.3, "variance of a quiet view over that of the quietest quarter", low=1.0, why="the same, in variance")
    exposure_chance: float = param(
        0.003,
        "probability that the noise of views follows their brightness as it does by chance, below which exposure is automatic",
        low=0.0,
        high=1.0,
        why="a session in three hundred; of 27 sessions with automatic exposure, all have less than 1 in 2000",
    )
    exposure_slope: float = param(
        0.4,
        "least rise of ln variance with the ln brightness of the view, beyond the light of the longest exposure",
        low=0.0,
        why="photons: 1; 27 sessions with automatic exposure have 0.67 to 1.92, six with a fixed one 0.11 at most",
    )
    exposure_rise: float = param(
        1.2,
        "variance of noise over that at a lower amplitude from which long and short exposures are merged",
        low=1.0,
        why="one exposure, 28 sessions: 1.0, beside noise of lines 1.1; a camera that merges two: 1.35",
    )
    line_mm: float = param(
        0.3,
        "least noise of whole rows or columns that is named",
        unit="mm",
        low=0.0,
        why="51 emerging cameras without it show 0.27 mm at most",
    )
    line_share: float = param(
        0.25, "least noise of whole rows or columns, over the median noise", low=0.0, high=1.0, why="less changes the total by 3 %"
    )
    pixel_share: float = param(0.004, "least share of noisy pixels that is named", low=0.0, high=1.0, why="eight times the share by chance")
    step_mm: float = param(1.5, "step of a usual depth code", unit="mm", low=0.0, why="16UC1 codes are 1 mm apart")
    bins: int = param(12, "bins of amplitude per view", low=3, high=60, why="the law has four terms")
    least_bins: int = param(6, "least bins of amplitude in the session", low=4, why="the law has four terms")
    bin_samples: int = param(60, "least samples of a bin of amplitude", low=2, why="the variance is known to 18 %")
    view_samples: int = param(200, "least samples of a view", low=2, why="fewer fill no three bins")
    smoothed_bins: int = param(
        9, "neighbouring bins in amplitude whose median variance gives a bin's weight", low=1, why="one odd bin must not decide"
    )
    outlier_sigma: float = param(3.0, "robust standard deviations from which a bin is an outlier", low=1.0, why="chance: 1 in 370")
    outlier_least: float = param(0.2, "least deviation in ln variance of an outlier", low=0.0, why="sampling error of small bins")
    lines: LineLimits = section(LineLimits, "rows and columns")
    foreign_light: ForeignLightLimits = section(ForeignLightLimits, "another camera's light")
    foreign_lamp: ForeignLampLimits = section(ForeignLampLimits, "another camera's lamp")
    repeated: RepeatedLimits = section(RepeatedLimits, "captures of a dwell with the same bias")
    lit: LitLimits = section(LitLimits, "places under foreign light")
    pixels: PixelLimits = section(PixelLimits, "single pixels")
    beat: BeatLimits = section(BeatLimits, "stripes")
    captures: CapturesLimits = section(CapturesLimits, "captures of a dwell")
    stereo: StereoLimits = section(StereoLimits, "cameras that triangulate")
