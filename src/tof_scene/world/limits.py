# SPDX-License-Identifier: Apache-2.0
"""When measurement and CAD contradict each other, and when contradictions are an object."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param


@dataclass(frozen=True, slots=True)
class WorldLimits:
    """Limits of contradictions and of what is made of them."""

    least_mm: float = param(
        6.0, "least contradiction between measurement and CAD: two sigma of usual sensor errors, 3 mm RMS", unit="mm", low=0.5
    )
    spread_sigma: float = param(
        1.0,
        "standard deviations that are allowed of the smooth part of the session's residuals that no range, amplitude or view explains",
        low=0.0,
        high=10.0,
    )
    cad_sigma: float = param(2.0, "standard deviations of the rendered depth (pose, CAD) that are allowed beside", low=0.0, high=10.0)
    noise_sigma: float = param(
        1.3, "standard deviations of one pixel's noise that the median of nine pixels is allowed: three of its own", low=0.0, high=10.0
    )
    patch_px: int = param(8, "least pixels of a contradiction; fewer are noise and mixed pixels", unit="px", low=1)
    weak: float = param(0.7, "a pixel beside a contradiction belongs to it from this share of the limit on", low=0.1, high=1.0)
    rim_px: int = param(2, "pixels without a return up to this far from a contradiction belong to it: its rim is mixed", unit="px", low=0)
    bias_most_mm: float = param(
        40.0, "largest residual from which the session's own sensor effects are estimated, by range and by amplitude", unit="mm", low=1.0
    )
    voxel_mm: float = param(25.0, "measured points at most two voxels apart are one object", unit="mm", low=1.0)
    agree_mm: float = param(25.0, "two views measure the same surface where they agree to within this", unit="mm", low=1.0)
    stands_out_mm: float = param(
        20.0, "an object stands this far out of the CAD at least; less is a part that is bent or displaced", unit="mm", low=1.0
    )
    object_px: int = param(40, "least pixels, over all views, of an object", unit="px", low=1)
    object_view_px: int = param(10, "least pixels of an object in a view that counts as showing it", unit="px", low=1)
    moving_share: float = param(0.01, "least share of a view's pixels that something seen in that view alone fills", low=0.0, high=1.0)
    absent_px: int = param(25, "least pixels, over all views, that decide whether a part is there", unit="px", low=1)
    absent_share: float = param(0.85, "least share of those in which the scene without the part was measured", low=0.5, high=1.0)
