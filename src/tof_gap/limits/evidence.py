# SPDX-License-Identifier: Apache-2.0
"""Limits of the evidence of a view: which pixels count, the level and correlation of their noise, blur, offsets of pixels."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param, section
from tof_scene.world.limits import WorldLimits


@dataclass(frozen=True, slots=True)
class CodeLimits:
    """When the range along the ray comes in steps."""

    pixels: int = param(1000, "least pixels of a view with depth", low=100, why="by chance, a share of 0.1 of them is on some code")
    least_mm: float = param(
        1.5, "least step of the range code", unit="mm", low=0.5, why="codes of 1 mm along z are usual, and finer ones do no harm"
    )
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
    bin_samples: int = param(30, "least samples of a bin of amplitude", low=2, why="the standard deviation is known to 13 %")
    samples: int = param(50, "least samples of a view", low=2, why="fewer do not fill two bins")
    unknown_mm: float = param(2.0, "noise of a view with fewer samples", unit="mm", low=1e-3, why="usual of one capture at 1 m")
    least_mm: float = param(
        0.01, "least noise that a pixel is taken to have", unit="mm", low=1e-6, why="a pixel that never changes would outweigh all others"
    )
    code_pixels: int = param(
        100, "least pixels with depth from which the step of the depth code is read", low=10, why="fewer do not show the codes"
    )
    code_gap_mm: float = param(
        0.005, "least step between depth codes", unit="mm", low=1e-6, why="rounding of float32 at 5 m is a tenth of it"
    )
    code_gaps: int = param(5, "least number of different depth codes", low=1, why="one plane at rest may have two or three")
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

    exposure_s: float = param(
        0.2, "longest exposure that is considered", unit="s", low=0.0, high=10.0, why="four taps of some tens of milliseconds"
    )
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

    growth: float = param(
        1.2, "least growth from next neighbours to pixels two apart", low=1.0, why="independent: 1.04, at blurred edges 1.18"
    )
    variance: float = param(
        1.3, "least growth from next neighbours to pixels that share none", low=1.0, why="independent: 1.1; 3 x 3 means: 4.5"
    )


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
