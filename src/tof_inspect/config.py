# SPDX-License-Identifier: Apache-2.0
"""What inspection can be told."""

from __future__ import annotations

from dataclasses import dataclass

from tof_align.config import WeightConfig
from tof_core.config import param, section


@dataclass(frozen=True, slots=True)
class ColourConfig:
    """What a first picture in colour says beside depth."""

    enabled: bool = param(True, "weigh colour where a first picture is given")
    pixels: int = param(4000, "pixels of a part and its surroundings that are looked at", low=100)
    margin_px: int = param(24, "surroundings reach this far beyond the part", unit="px", low=2)
    min_pixels: int = param(12, "pixels of the part, and of what is behind it, that must be known", low=1)
    alike: float = param(0.8, "surroundings face the same way as what is behind the part: cosine at least", low=0.0, high=1.0)
    light_pixels: int = param(6000, "pixels that tell how the light changed", low=200)
    light_floor: float = param(
        0.35, "brightness never counts as known better than this (log): near lamps, gloss, light from neighbours", low=0.001
    )
    tint_floor: float = param(0.03, "nor the ratio of two channels better than this (log)", low=0.001)
    surprise: float = param(0.1, "share of parts whose light nobody could foresee", low=1e-3, high=0.9)

    @property
    def floors(self) -> tuple[float, float, float]:
        """By tone."""
        return self.light_floor, self.tint_floor, self.tint_floor


@dataclass(frozen=True, slots=True)
class InspectConfig:
    """When a part counts as seen, there, gone or displaced."""

    min_pixels: int = param(30, "valid pixels that stand out, at least, for a part to be observable", low=1)
    stand_out: float = param(3.0, "a pixel stands out where presence and absence differ by this many of its sigmas", low=0.5)
    grazing_deg: float = param(82.0, "surfaces seen flatter than this are no evidence", unit="deg", low=10.0, high=90.0)
    mixed: float = param(0.25, "pixels with a larger share of a second surface are no evidence", low=0.0, high=0.5)
    outliers: float = param(0.05, "share of pixels that say nothing whatever is there", low=1e-4, high=0.5)
    wide_m: float = param(0.3, "such a pixel may lie anywhere within this", unit="m", low=0.01)
    shared_mm: float = param(1.0, "error that neighbours share (bias of the camera): it does not average out", unit="mm", low=0.0)
    cell_px: int = param(6, "neighbours within this are one witness", unit="px", low=1, high=64)
    prior: float = param(0.98, "probability that a part is there before anything is seen", low=0.5, high=0.9999)
    decide: float = param(0.99, "a verdict needs this probability, else it is uncertain and not observable", low=0.6, high=0.99999)
    search_mm: float = param(12.0, "a part may have moved by this and still be the same part", unit="mm", low=0.5)
    moved_cost: float = param(12.0, "log likelihood that a displaced place must earn: it is rare, and one of many", low=0.0)
    min_agreement: float = param(0.94, "share of a view's pixels that must lie on the CAD; else its pose is not trusted", low=0.0, high=1.0)
    displaced_sigma: float = param(3.0, "displaced is said when beyond tolerance and beyond this many of its own sigmas", low=1.0)
    weights: WeightConfig = section(WeightConfig, "noise of pixels where the view does not tell it")
    colour: ColourConfig = section(ColourConfig, "evidence from colour")
