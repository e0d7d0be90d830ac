# SPDX-License-Identifier: Apache-2.0
"""Limits of contradictions between measurement and CAD, and of objects and absent parts."""

from __future__ import annotations

from dataclasses import dataclass

from tof_core.config import param


@dataclass(frozen=True, slots=True)
class WorldLimits:
    """Limits of contradictions between measurement and CAD, and of the conclusions from them."""

    least_mm: float = param(
        6.0, "least contradiction between measurement and CAD", unit="mm", low=0.5, why="two sigma of usual sensor errors, 3 mm RMS"
    )
    spread_sigma: float = param(
        1.0,
        "standard deviations that are allowed of the smooth part of the session's residuals that no range, amplitude or view explains",
        low=0.0,
        high=10.0,
        why="errors beyond what range, amplitude and view explain are smooth",
    )
    cad_sigma: float = param(
        2.0, "standard deviations of the rendered depth (pose, CAD) that are allowed beside", low=0.0, high=10.0, why="95 %"
    )
    noise_sigma: float = param(
        1.3,
        "standard deviations of one pixel's noise that the median of nine pixels is allowed: three of its own",
        low=0.0,
        high=10.0,
        why="three standard deviations of a median of nine",
    )
    patch_px: int = param(8, "least pixels of a contradiction", unit="px", low=1, why="fewer are noise and mixed pixels")
    weak: float = param(
        0.7,
        "a pixel beside a contradiction belongs to it from this share of the limit on",
        low=0.1,
        high=1.0,
        why="noise lowers some pixels of a contradiction",
    )
    rim_px: int = param(
        2, "pixels without a return up to this far from a contradiction belong to it", unit="px", low=0, why="its rim is mixed"
    )
    stray_mm: float = param(
        12.0,
        "a single pixel beside a contradiction, or beside a part that stands off its CAD, belongs to it from this deviation on",
        unit="mm",
        low=1.0,
        why="twice the least contradiction: where something is known to be wrong, no patch is asked for",
    )
    bias_most_mm: float = param(
        40.0,
        "largest residual from which the session's own sensor effects are estimated, by range and by amplitude",
        unit="mm",
        low=1.0,
        why="bias of a ToF camera is millimetres to a few centimetres",
    )
    voxel_mm: float = param(25.0, "measured points at most two voxels apart are one object", unit="mm", low=1.0, why="a finger is as wide")
    agree_mm: float = param(
        25.0, "two views measure the same surface where they agree to within this", unit="mm", low=1.0, why="poses and noise, twice"
    )
    stands_out_mm: float = param(
        20.0, "an object stands this far out of the CAD at least", unit="mm", low=1.0, why="less may be a part that is bent or displaced"
    )
    lies_mm: float = param(
        10.0,
        "an object that ends in a step, on a part that is in its place around it, stands this far out of the CAD at least",
        unit="mm",
        low=1.0,
        why="beyond the least contradiction of 6 mm, noise and mixed pixels cause steps of a few mm",
    )
    object_px: int = param(40, "least pixels, over all views, of an object", unit="px", low=1, why="5 cm at 1.5 m are more")
    object_view_px: int = param(
        10, "least pixels of an object in a view that counts as showing it", unit="px", low=1, why="a quarter of that"
    )
    moving_share: float = param(
        0.01, "least share of a view's pixels that something seen in that view alone fills", low=0.0, high=1.0, why="a hand fills more"
    )
    absent_px: int = param(
        25, "least pixels, over all views, that decide whether a part is there", unit="px", low=1, why="a share is known to a tenth"
    )
    absent_share: float = param(
        0.85,
        "least share of those in which the scene without the part was measured",
        low=0.5,
        high=1.0,
        why="edges and mixed pixels are the rest",
    )
