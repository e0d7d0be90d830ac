# SPDX-License-Identifier: Apache-2.0
"""Numbers that decide what a session shows: which pixels count, what is noise, what is loss."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param, section
from tof_gap.limits.foreign import BeatLimits, CapturesLimits, ForeignLampLimits, ForeignLightLimits, LitLimits, RepeatedLimits
from tof_scene.world.limits import WorldLimits


@dataclass(frozen=True, slots=True)
class CodeLimits:
    """When the range along the ray comes in steps."""

    pixels: int = param(1000, "pixels of a view with depth", low=100, why="by chance, a share of 0.1 of them is on some code")
    least_mm: float = param(1.5, "step", unit="mm", low=0.5, why="codes of 1 mm along z are usual, and finer ones do no harm")
    share: float = param(0.5, "share of the ranges on codes", low=0.1, high=1.0, why="noise of a fifth of a step leaves 0.45")
    harmonic: float = param(
        0.9, "share of a longer step over that of the best", low=0.5, high=1.0, why="a half and a third of the step fit as well as it does"
    )
    spread: float = param(
        1.0,
        "longest step, over the standard deviation of the ranges",
        low=0.1,
        high=3.0,
        why="by the scene alone, the share on such a step is 0.1 at most",
    )


@dataclass(frozen=True, slots=True)
class LevelLimits:
    """Estimate of a view's noise and of its depth code's step, from differences between neighbours."""

    bins: int = param(32, "bins of amplitude", low=1, high=1000, why="noise changes little within a bin")
    bin_samples: int = param(30, "samples of a bin", low=2, why="the standard deviation is known to 13 %")
    samples: int = param(50, "samples of a view", low=2, why="fewer do not fill two bins")
    unknown_mm: float = param(2.0, "noise of a view with fewer samples", unit="mm", low=1e-3, why="usual of one capture at 1 m")
    least_mm: float = param(0.01, "least noise", unit="mm", low=1e-6, why="a pixel that never changes would outweigh all others")
    code_pixels: int = param(100, "pixels with depth", low=10, why="fewer do not show the codes")
    code_gap_mm: float = param(
        0.005, "least step between depth codes", unit="mm", low=1e-6, why="rounding of float32 at 5 m is a tenth of it"
    )
    code_gaps: int = param(5, "different codes", low=1, why="one plane at rest may have two or three")
    code_whole: float = param(
        1.5,
        "share of pixels on codes of one capture, over that by chance, above which a mean of captures has them",
        low=1.0,
        why="with noise of half a step, all fractions of a step are equally frequent to 2 %",
    )
    code_share: float = param(0.5, "codes per pixel above which depth is continuous", low=0.0, high=1.0, why="16-bit codes repeat")
    of_range: CodeLimits = section(CodeLimits, "steps of the range along the ray")


@dataclass(frozen=True, slots=True)
class BlurLimits:
    """Motion blur of edges, in a view taken while the camera moved."""

    exposure_s: float = param(0.2, "longest exposure", unit="s", low=0.0, high=10.0, why="four taps of some tens of milliseconds")
    brief_s: float = param(
        0.05, "exposure of a brief frame", unit="s", low=0.0, high=10.0, why="twelve sub-frames of 4 ms: three frequencies, four taps"
    )
    creases: bool = param(True, "leave out brightness edges of moving views, too")
    flow_quantile: float = param(0.9, "quantile of the image flow over the pixels", low=0.0, high=1.0, why="near surfaces blur most")
    still_px: float = param(0.25, "blur below which a view is still", unit="px", low=0.0, why="TF jitters by as much")
    most_share: float = param(0.04, "most blur, of the image width", low=0.0, high=1.0, why="a wider edge band leaves too few pixels")
    streak_sigma: float = param(
        5.0, "deviation of a streak's pixel from the local median, in standard deviations", low=1.0, why="chance: 1 in 1.7 million"
    )
    streak_px: int = param(9, "side of the square of the local median", unit="px", low=3, high=99, why="over twice the width of a streak")


@dataclass(frozen=True, slots=True)
class PatternLimits:
    """When pixels have an offset of their own."""

    window_px: int = param(15, "side of the window of the high-pass", unit="px", low=3, high=199, why="what is wider is a smooth field")
    area_px: int = param(
        45, "side of the window beyond which an offset of areas is a smooth field", unit="px", low=5, high=999, why="a fifth of the image"
    )
    sigma: float = param(4.0, "standard errors of the pixels' common variance", low=0.0, why="chance: 1 in 30,000")
    pixels: int = param(200, "pixels that both halves of the views see", low=10, why="the variance is known to 10 %")
    clip: float = param(0.002, "quantile at which products are clipped", low=0.0, high=0.4, why="one gross pixel must not decide")
    noise_share: float = param(
        0.1, "least noise beside the pattern, of the pattern's variance", low=0.0, high=1.0, why="differences overlap"
    )
    level_share: float = param(0.25, "least noise without the pattern, of the variance with it", low=0.0, high=1.0, why="the same")


@dataclass(frozen=True, slots=True)
class WorldEvidence:
    """When a part is missing and an object foreign, before poses and effects are solved together."""

    pose_mm: float = param(2.0, "error of the first poses along a surface's normal", unit="mm", low=0.0, why="arm, hand-eye and bias")
    least_cosine: float = param(0.2, "least cosine of incidence", low=0.01, high=1.0, why="its inverse grows without bound")
    rim_px: int = param(2, "rim around foreign objects that does not count", unit="px", low=0, high=50, why="its pixels mix both")
    world: WorldLimits = section(WorldLimits, "when measurement and CAD contradict each other")


@dataclass(frozen=True, slots=True)
class CorrelationLimits:
    """When neighbouring pixels share noise: growth of the variance that their differences show, if they are farther apart."""

    growth: float = param(1.2, "from next neighbours to pixels two apart", low=1.0, why="independent: 1.04, at blurred edges 1.18")
    variance: float = param(1.3, "from next neighbours to pixels that share none", low=1.0, why="independent: 1.1; 3 x 3 means: 4.5")


@dataclass(frozen=True, slots=True)
class EvidenceLimits:
    """Which pixels count."""

    pixels: int = param(3000, "pixels of a view used in fits, drawn evenly", low=200, high=200_000, why="time and memory")
    gross_mm: float = param(
        60.0, "residual that no bias reaches", unit="mm", low=5.0, high=1e4, why="bias of a ToF camera is millimetres to a few centimetres"
    )
    gross_sigma: float = param(5.0, "noise standard deviations within which no residual is gross", low=1.0, why="chance: 1 in 1.7 million")
    gross_most_mm: float = param(300.0, "residual gross under any noise", unit="mm", low=5.0, high=1e5, why="another surface, or a wrap")
    survivors: float = param(0.25, "share of the pixels around that are measured rightly", low=0.0, high=1.0, why="fewer: a filter chose")
    edge_px: int = param(2, "distance from a depth edge up to which pixels are counted apart", unit="px", low=0, high=10, why="footprints")
    edge_slope: float = param(
        2.0, "depth edge: step between neighbours, over the tilted plane's own", low=1.0, why="curved surfaces stay below"
    )
    crease: float = param(0.05, "brightness edge: relative step between neighbours", low=0.0, why="no smooth surface has it")
    grazing_deg: float = param(
        80.0, "incidence beyond which a pixel is left out", unit="deg", low=30.0, high=90.0, why="1 mm of pose is 6 mm of z"
    )
    own_share: float = param(
        0.35, "mixed share up to which a pixel's own surface is certain", low=0.0, high=0.5, why="beyond, half a pixel of pose decides"
    )
    concavity_px: int = param(
        6, "spacing of the pixels that concavity is computed at", unit="px", low=1, high=64, why="concavity is smooth"
    )
    seed: int = param(0, "seed of the draw", low=0, why="the same pixels in every run")
    level: LevelLimits = section(LevelLimits, "noise of a view")
    correlation: CorrelationLimits = section(CorrelationLimits, "noise that neighbouring pixels share")
    blur: BlurLimits = section(BlurLimits, "motion blur")
    pattern: PatternLimits = section(PatternLimits, "offsets of pixels")


@dataclass(frozen=True, slots=True)
class LineLimits:
    """When whole rows or columns change together from view to view."""

    pixels: int = param(20, "pixels of a line", low=2, why="its mean is known to a quarter of the noise")
    views: int = param(5, "views that see a line", low=2, why="a variance of fewer is not known to a factor of two")
    lines: int = param(12, "lines that are compared", low=3, why="a few lines beside edges are not all; differences of three overlap")
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
    least_bins: int = param(12, "bins of the session", low=4, why="four per unknown")
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
    extra_mm: float = param(0.4, "constant noise", unit="mm", low=0.0, why="the floor of a usual camera is 0.3 mm")
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
        0.3, "noise of whole rows or columns", unit="mm", low=0.0, why="51 emerging cameras without it show 0.27 mm at most"
    )
    line_share: float = param(0.25, "the same, over the median noise", low=0.0, high=1.0, why="less changes the total by 3 %")
    pixel_share: float = param(0.004, "share of noisy pixels", low=0.0, high=1.0, why="eight times the share by chance")
    step_mm: float = param(1.5, "step of a usual depth code", unit="mm", low=0.0, why="16UC1 codes are 1 mm apart")
    bins: int = param(12, "bins of amplitude per view", low=3, high=60, why="the law has four terms")
    least_bins: int = param(6, "bins of the session", low=4, why="the law has four terms")
    bin_samples: int = param(60, "samples of a bin", low=2, why="the variance is known to 18 %")
    view_samples: int = param(200, "samples of a view", low=2, why="fewer fill no three bins")
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
