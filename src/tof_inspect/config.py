# SPDX-License-Identifier: Apache-2.0
"""What inspection can be told."""

from __future__ import annotations

from dataclasses import dataclass

from tof_align.config import WeightConfig
from tof_core.config import param, section


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
