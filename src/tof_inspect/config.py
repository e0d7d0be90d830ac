# SPDX-License-Identifier: Apache-2.0
"""Configuration of inspection."""

from __future__ import annotations

from dataclasses import dataclass

from tof_align.config import WeightConfig
from tof_core.config import param, section


@dataclass(frozen=True, slots=True)
class ColourConfig:
    """Evidence from colour, beside depth."""

    enabled: bool = param(True, "use colour where a reference image is given")
    pixels: int = param(4000, "pixels of a part and its surroundings that are used", low=100)
    margin_px: int = param(24, "surroundings reach this far beyond the part", unit="px", low=2)
    min_pixels: int = param(12, "least pixels of the part, and of the background, with a known colour", low=1)
    alike: float = param(0.8, "least cosine between the normals of the surroundings and of the background", low=0.0, high=1.0)
    light_pixels: int = param(6000, "pixels from which the change of lighting is estimated", low=200)
    light_floor: float = param(0.35, "least sigma of log brightness: near lamps, gloss, interreflection", low=0.001)
    tint_floor: float = param(0.03, "least sigma of the log ratio of two channels", low=0.001)
    surprise: float = param(0.1, "share of parts in unmodelled lighting", low=1e-3, high=0.9)

    @property
    def floors(self) -> tuple[float, float, float]:
        """Least sigma of each tone."""
        return self.light_floor, self.tint_floor, self.tint_floor


@dataclass(frozen=True, slots=True)
class InspectConfig:
    """When a part counts as observable, present, absent or displaced."""

    min_pixels: int = param(30, "least distinctive pixels of an observable part", low=1)
    stand_out: float = param(3.0, "a pixel is distinctive if presence and absence differ by this many of its sigmas", low=0.5)
    grazing_deg: float = param(82.0, "surfaces seen flatter than this are no evidence", unit="deg", low=10.0, high=90.0)
    mixed: float = param(0.25, "pixels with a larger share of a second surface are no evidence", low=0.0, high=0.5)
    outliers: float = param(0.05, "share of outlier pixels, whose depth is unrelated to the scene", low=1e-4, high=0.5)
    wide_m: float = param(0.3, "range of depth of an outlier pixel", unit="m", low=0.01)
    shared_mm: float = param(
        1.0, "error that neighbouring pixels share (bias of the camera) and that does not average out", unit="mm", low=0.0
    )
    cell_px: int = param(6, "side of a cell of neighbouring pixels that count as correlated", unit="px", low=1, high=64)
    prior: float = param(0.98, "prior probability that a part is present", low=0.5, high=0.9999)
    decide: float = param(0.99, "least probability of a verdict; otherwise the part is not observable", low=0.6, high=0.99999)
    search_mm: float = param(12.0, "largest displacement that is searched", unit="mm", low=0.5)
    moved_cost: float = param(12.0, "log likelihood that a displaced pose must gain, since it is rare and one of many", low=0.0)
    min_agreement: float = param(0.94, "least share of a view's pixels on the CAD; otherwise its pose is not trusted", low=0.0, high=1.0)
    displaced_sigma: float = param(3.0, "a part is displaced if it exceeds its tolerance by this many sigmas of the fit", low=1.0)
    weights: WeightConfig = section(WeightConfig, "noise of pixels, used where the view has no estimate")
    colour: ColourConfig = section(ColourConfig, "evidence from colour")
