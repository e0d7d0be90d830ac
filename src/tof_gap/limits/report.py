# SPDX-License-Identifier: Apache-2.0
"""Numbers that decide what the report states: how far the gap shrinks, where it is, what is unexplained."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param, section


@dataclass(frozen=True, slots=True)
class ShrinkLimits:
    """How far the gap shrinks, with its interval."""

    above_floor: float = param(
        0.02, "relative excess of the RMS over the floor below which there is no gap", low=0.0, why="the floor is not known better"
    )
    noise_known: float = param(
        0.03, "relative error of the noise variance", low=0.0, high=1.0, why="interpolation between bins of amplitude"
    )
    noise_px: int = param(
        4,
        "side of the squares in which pixels share no noise",
        unit="px",
        low=2,
        high=64,
        why="next neighbours may share noise; a gap is wider",
    )
    noise_shown: float = param(
        0.5,
        "by how much the noise that pixels show may differ from its variance, relative",
        low=0.0,
        high=1.0,
        why="far surfaces 0.09, rows with noise of their own 0.41; beyond, errors are gross",
    )
    resolution: float = param(0.005, "least half width of the interval", low=0.0, high=1.0, why="rounding of depth code and floor")
    healthy_mm: float = param(
        0.3,
        "RMS of a healthy camera's error that poses absorb",
        unit="mm",
        low=0.0,
        why="47 emerging cameras: 0.32 mm RMS, of 0.72 mm; the rest shows in the residual",
    )
    healthy_most_mm: float = param(
        0.5, "the same, exceeded by one camera in twenty, for the interval", unit="mm", low=0.0, why="44 of the 47 are below"
    )
    drawn_share: float = param(
        0.05,
        "least share of the gap's energy in a bootstrap draw",
        low=0.0,
        high=1.0,
        why="the shrink of a draw without a gap is undefined",
    )
    rounds: int = param(400, "bootstrap resamples of the blocks", low=50, high=100_000, why="a 2.5 % quantile rests on ten of them")
    common_left: float = param(
        0.5, "error of the map of noise that neighbours share, relative", low=0.0, high=1.0, why="rows and stripes are known coarsely"
    )
    worsens: float = param(
        0.05, "gain in shrink without an effect from which the effect is dropped", low=0.0, why="sampling error of a shrink: some points"
    )


@dataclass(frozen=True, slots=True)
class ConfidenceLimits:
    """Share of names that proved right on sessions of the emerging camera (docs/foreign_cameras.md)."""

    asserted: float = param(
        0.95, "of effects that all resampled sets of views choose, with little unexplained", low=0.0, high=1.0, why="40 of 43 were right"
    )
    suspected: float = param(0.4, "of effects with much unexplained beside them", low=0.0, high=1.0, why="2 of 5 were right")


@dataclass(frozen=True, slots=True)
class UnexplainedLimits:
    """When the gap that no named effect explains has structure: verdict `unknown`."""

    mm: float = param(
        0.7, "RMS of block means above the floor, beside named effects", unit="mm", low=0.0, why="errors of the named effects' maps"
    )
    alone_mm: float = param(
        0.4,
        "the same, where no effect is named",
        unit="mm",
        low=0.0,
        why="parts of healthy cameras of two authors: 0.23 at most; a pane before the camera 0.60, gloss of one part 0.67",
    )
    part_mm: float = param(
        1.2,
        "RMS error of one part, beside named effects",
        unit="mm",
        low=0.0,
        why="maps of named effects leave 0.7 to 1.2 mm on one or two parts of seven sessions; a pane 2.3 and more, light without a name 3.5",
    )
    share: float = param(
        0.12, "its square, over the whole gap's energy above the floor", low=0.0, high=1.0, why="maps of named effects are never exact"
    )
    misfit: float = param(0.25, "share of the chi-square above the floor that effects may leave", low=0.0, high=1.0, why="the same")
    contradicted: float = param(
        0.35,
        "share of the block means' chi-square, where an effect acts, that all effects may leave",
        low=0.0,
        high=1.0,
        why="true effects of 32 sessions leave 0.25 at most (a pattern of columns), most of them 0.02; a ghost taken for lens_scatter 0.54",
    )
    chosen: float = param(
        0.25,
        "share of resampled sets of views that choose an effect, below which it is not believed",
        low=0.0,
        high=1.0,
        why="of 175 right names the least has 0.34; of wrong ones a bent part beside a wrong lens 0.22, flood light as specular 0.04",
    )
    contradicted_mm: float = param(
        0.15,
        "error left above which an effect that was taken out stands for an unknown mechanism",
        unit="mm",
        low=0.0,
        why="a healthy camera of low noise leaves 0.1 mm, a weak ghost 0.25 mm",
    )
    sure: float = param(2.0, "standard deviations by which it must be exceeded", low=0.0, why="chance: 1 in 40")
    contradicted_px: int = param(8, "side of the blocks of that share", unit="px", low=2, high=64, why="an effect may act on few pixels")
    contradicted_pixels: int = param(38, "pixels of such a block that count", low=1, why="six in ten")
    uneven_views: float = param(
        5.0, "least number of views that determine an effect's size, to judge its variation", low=2.0, why="of four, it is known to a third"
    )
    uneven_chance: float = param(
        0.025, "probability that chance makes the variation of an effect's size that large", low=1e-6, high=0.5, why="1 in 40"
    )
    enlarges: float = param(
        1.0,
        "squared gap that a cause alone adds, over the gap's, from which two such causes are not believed",
        low=0.0,
        why="two causes that cancelled each other before a pane: 2.6 and 8.3; a constant beside a drift, alone of its kind in 120 sessions: 1.7",
    )
    arms: float = param(22.5, "chi-square (6 degrees of freedom) of the mean arm error", low=0.0, why="chance: 1 session in 1000")
    gross_share: float = param(0.004, "share of gross pixels away from edges", low=0.0, high=1.0, why="tools and cables that the CAD lacks")
    doubt: float = param(
        0.05,
        "unexplained share of the gap's energy from which the named effects are only suspected",
        low=0.0,
        high=1.0,
        why="an unknown error biases the fitted effects: of four names beside 0.07 to 0.08 one was right, of four beside 0.02 and less all",
    )
    block_pixels: int = param(40, "pixels of a block", low=1, why="a sixth of the block; its mean is known to a sixth of the noise")
    part_pixels: float = param(
        0.01, "share of the session's pixels of a part that is judged by itself", low=0.0, high=1.0, why="smaller parts are mostly edges"
    )
    noise_share: float = param(
        0.2,
        "RMS left on a part, over the noise of its pixels",
        low=0.0,
        why="healthy cameras: 0.10 to 0.16 on dark and far parts; a pane, a ghost or gloss: 0.4 and more",
    )
    part_share: float = param(0.1, "share of the unexplained energy of a part that is reported", low=0.0, high=1.0, why="brevity")
    parts: int = param(4, "parts that are reported", low=1, why="brevity")
    quantity_share: float = param(0.1, "the same of a quantity's bin means", low=0.0, high=1.0, why="brevity")
    quantity_bins: int = param(3, "least bins of a quantity that the gap depends on", low=2, why="two show no dependence")
    quantities: int = param(4, "quantities that are reported", low=1, why="brevity")


@dataclass(frozen=True, slots=True)
class WhereLimits:
    """Which regions carry the gap."""

    false_discovery: float = param(
        0.05, "share of reported regions that are chance", low=0.0, high=1.0, why="usual level (Benjamini and Hochberg 1995)"
    )
    regions: int = param(40, "regions that are reported", low=1, why="brevity")
    bins: int = param(12, "bins of a quantity, with equal numbers of pixels", low=2, high=100, why="a curve that can be read")


@dataclass(frozen=True, slots=True)
class ExplainableLimits:
    """The most that any model could explain."""

    features: int = param(400, "random features of the ridge regression", low=10, high=10_000, why="time and memory")
    inputs: float = param(
        0.4, "share of the inputs that a feature combines", low=0.05, high=1.0, why="a function of one input must be within reach"
    )
    cell_px: int = param(
        6, "side of the cells whose means are fitted", unit="px", low=1, high=64, why="white noise averages out, smooth errors stay"
    )


@dataclass(frozen=True, slots=True)
class ReportLimits:
    """What the report states."""

    advice_gain: float = param(
        1.2, "visible share of a tied effect after an advised capture, over the present share", low=1.0, why="less is no remedy"
    )
    advice_least: float = param(0.02, "least difference of the two shares", low=0.0, high=1.0, why="the error of a share")
    block_px: int = param(
        16, "side of a block of pixels with a common error", unit="px", low=2, high=256, why="neighbours share errors, blocks less so"
    )
    over_exposed: float = param(
        0.05,
        "over-exposed pixels, of those that see the CAD, from which other captures are advised",
        low=0.0,
        high=1.0,
        why="glints of shiny parts over-expose a few per cent in usual recordings",
    )
    shrink: ShrinkLimits = section(ShrinkLimits, "how far")
    confidence: ConfidenceLimits = section(ConfidenceLimits, "how often names are right")
    unexplained: UnexplainedLimits = section(UnexplainedLimits, "what is unexplained")
    where: WhereLimits = section(WhereLimits, "where")
    explainable: ExplainableLimits = section(ExplainableLimits, "what any model could explain")
