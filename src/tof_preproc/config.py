# SPDX-License-Identifier: Apache-2.0
"""Configuration of preprocessing: the stages, their order and their numbers.

Two presets: `default`, and `paper`, which filters as section 3.1 of Kim et al. (Appl. Sci. 2024, 14, 4595)
describes it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from tof_core.config import param, section
from tof_core.errors import ConfigError

SAMPLE = ("iqr", "sigma3")
"""Stages that reject single captures of a pixel: they compare the captures of one dwell."""
RASTER = ("range", "amplitude", "self", "flying", "grazing", "sor")
"""Stages that remove pixels of one raster: before `accumulate` of each capture, after it of the view."""
ORDER = "range,amplitude,self,iqr,sigma3,accumulate,flying,grazing,sor"
PAPER_ORDER = "iqr,sigma3,accumulate,sor"


@dataclass(frozen=True, slots=True)
class RangeConfig:
    """Depth outside the bounds is removed (OUT_OF_RANGE)."""

    enable: bool = param(True, "remove depth outside the bounds")
    low: float = param(0.05, "least depth along z", unit="m", low=0.0, high=100.0)
    high: float = param(15.0, "largest depth along z", unit="m", low=0.0, high=1000.0)


@dataclass(frozen=True, slots=True)
class AmplitudeConfig:
    """Pixels with too low or too high amplitude are removed (MASKED_AMPLITUDE); no effect without amplitude."""

    enable: bool = param(True, "remove pixels by amplitude")
    low: float = param(0.0, "least amplitude in the camera's own unit; 0 is no bound", low=0.0)
    high: float = param(0.0, "largest amplitude in the camera's own unit; 0 is no bound", low=0.0)


@dataclass(frozen=True, slots=True)
class SelfConfig:
    """The robot's own gripper is removed (SELF)."""

    path: str = param("", "path of an image of the raster's size, not black where the camera sees the robot itself; empty: no mask")


@dataclass(frozen=True, slots=True)
class AccumulateConfig:
    """How the captures of a dwell become one depth per pixel."""

    method: str = param("mean", "mean or median of the captures kept, or the paper's equation 1", choices=("mean", "median", "paper"))
    max_captures: int = param(15, "captures after which a new dwell begins", low=1, high=256)
    min_share: float = param(0.3, "least share of the captures in which a pixel must have a depth", low=0.0, high=1.0)


@dataclass(frozen=True, slots=True)
class IqrConfig:
    """Captures of a pixel far from its quantiles over the dwell are rejected (IQR)."""

    enable: bool = param(True, "reject by quantiles over time")
    method: str = param(
        "tukey", "tukey: beyond fences outside the quantiles; paper: outside the band between them", choices=("tukey", "paper")
    )
    low: float = param(0.2, "lower quantile of a pixel's captures", low=0.0, high=0.5)
    high: float = param(0.8, "upper quantile of a pixel's captures", low=0.5, high=1.0)
    fence: float = param(1.5, "distance of the fences from the quantiles, in widths of the band", low=0.0, high=100.0)
    min_captures: int = param(5, "with fewer captures the stage is skipped", low=2, high=256)


@dataclass(frozen=True, slots=True)
class Sigma3Config:
    """Captures of a pixel further than `ratio` standard deviations from its centre are rejected (THREE_SIGMA)."""

    enable: bool = param(True, "reject by standard deviations over time")
    method: str = param(
        "robust",
        "robust: from the median, deviation by MAD but no less than the expected noise; paper: from the mean, by the standard deviation",
        choices=("robust", "paper"),
    )
    ratio: float = param(3.0, "a capture farther from the mean than this many standard deviations is rejected", low=0.5, high=20.0)
    min_captures: int = param(3, "with fewer captures the stage is skipped", low=2, high=256)


@dataclass(frozen=True, slots=True)
class FlyingConfig:
    """Pixels between two surfaces are removed (FLYING): they continue neither side of a depth edge."""

    enable: bool = param(True, "remove mixed pixels at depth edges")
    ratio: float = param(4.0, "deviation from each side's surface, in its standard deviations", low=1.0, high=50.0)
    slope_deg: float = param(70.0, "a depth step is steeper than a surface at this incidence", unit="deg", low=30.0, high=89.0)


@dataclass(frozen=True, slots=True)
class GrazingConfig:
    """Surfaces at grazing incidence are removed (GRAZING)."""

    enable: bool = param(True, "remove surfaces at grazing incidence")
    max_deg: float = param(82.0, "largest angle between ray and surface normal", unit="deg", low=30.0, high=90.0)


@dataclass(frozen=True, slots=True)
class SorConfig:
    """Points far from their nearest neighbours are removed (SOR)."""

    enable: bool = param(True, "remove statistical outliers of the cloud")
    method: str = param(
        "scaled",
        "scaled: distances in units of the point spacing expected there; paper: distances in metres (Open3D's remove_statistical_outlier)",
        choices=("scaled", "paper"),
    )
    neighbours: int = param(20, "nearest neighbours, the point itself among them (as Open3D counts)", low=2, high=100)
    ratio: float = param(2.0, "standard deviations above the mean distance", low=0.1, high=20.0)


@dataclass(frozen=True, slots=True)
class MotionConfig:
    """A capture taken in motion, or at another pose, is not accumulated: it is a view of one."""

    enable: bool = param(True, "accumulate only while nothing moves")
    tolerance_mm: float = param(1.0, "largest camera translation within a dwell", unit="mm", low=0.0, high=100.0)
    tolerance_deg: float = param(0.1, "largest camera rotation within a dwell", unit="deg", low=0.0, high=10.0)
    max_gap_s: float = param(2.0, "a longer pause between captures begins a new dwell", unit="s", low=0.01, high=3600.0)


@dataclass(frozen=True, slots=True)
class FrozenConfig:
    """A frame that repeats the stamp or the content of the one before is the same frame."""

    enable: bool = param(True, "drop repeated frames")


@dataclass(frozen=True, slots=True)
class PreprocConfig:
    """All of preprocessing."""

    preset: str = param("default", "paper: use the paper's order and methods instead of those given here", choices=("default", "paper"))
    order: str = param(ORDER, "the stages in their order, joined by commas; a stage that is not named is off")
    range: RangeConfig = section(RangeConfig)
    amplitude: AmplitudeConfig = section(AmplitudeConfig)
    self_mask: SelfConfig = section(SelfConfig)
    accumulate: AccumulateConfig = section(AccumulateConfig)
    iqr: IqrConfig = section(IqrConfig)
    sigma3: Sigma3Config = section(Sigma3Config)
    flying: FlyingConfig = section(FlyingConfig)
    grazing: GrazingConfig = section(GrazingConfig)
    sor: SorConfig = section(SorConfig)
    motion: MotionConfig = section(MotionConfig)
    frozen: FrozenConfig = section(FrozenConfig)

    def __post_init__(self) -> None:
        """Refuse orders and bounds that cannot work."""
        stages_of(self.order)
        if self.range.low >= self.range.high:
            msg = f"low {self.range.low:g} m is not below high {self.range.high:g} m"
            raise ConfigError(msg, where="preproc.range")

    @property
    def resolved(self) -> PreprocConfig:
        """The configuration that a preset stands for: the paper's is its section 3.1, with the numbers given here."""
        if self.preset == "default":
            return self
        return replace(
            self,
            preset="default",
            order=PAPER_ORDER,
            accumulate=replace(self.accumulate, method="paper", min_share=0.0),
            iqr=replace(self.iqr, method="paper"),
            sigma3=replace(self.sigma3, method="paper"),
            sor=replace(self.sor, method="paper"),
        )


def stages_of(order: str) -> tuple[str, ...]:
    """The stages that an order names, checked.

    Raises:
        ConfigError: a stage is unknown, named twice, or compares captures after they were accumulated.
    """
    stages = tuple(s.strip() for s in order.split(",") if s.strip())
    known = (*SAMPLE, "accumulate", *RASTER)
    for s in stages:
        if s not in known or stages.count(s) > 1:
            msg = f"stage '{s}' is {'named twice' if s in known else 'unknown'}"
            raise ConfigError(msg, where="preproc.order", todo=f"stages: {', '.join(known)}")
    if "accumulate" not in stages:
        raise ConfigError("has no 'accumulate'", where="preproc.order", todo=f"for example {ORDER}")
    late = [s for s in SAMPLE if s in stages[stages.index("accumulate") :]]
    if late:
        msg = f"stage '{late[0]}' compares captures and so comes before 'accumulate'"
        raise ConfigError(msg, where="preproc.order")
    return stages
