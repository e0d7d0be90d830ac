# SPDX-License-Identifier: Apache-2.0
"""Statistical outlier removal: points unusually far from their nearest neighbours.

`paper` is Open3D's `remove_statistical_outlier`: mean distance to 20 neighbours (the point itself among them, at 0),
removed beyond the mean of all plus 2 standard deviations. In metres this removes far surfaces, whose points lie further
apart. `scaled` measures in units of the point spacing that a surface has at that range and incidence.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.reasons import Reason
from tof_core.stats import robust_std
from tof_preproc.neighbours import mean_distance
from tof_preproc.surface import cos_incidence

if TYPE_CHECKING:
    from tof_core.arrays import Image
    from tof_core.camera import Camera
    from tof_preproc.config import PreprocConfig
    from tof_preproc.frame import Frame

CORNER = 2.2
"""Least ratio of an outlier's mean distance to the median; at a corner of a surface the ratio is 2."""
FLATTEST = 0.1
"""Least cosine of incidence in the expected spacing."""


def remove_sor(frame: Frame, config: PreprocConfig) -> int:
    """Remove points far from their nearest neighbours."""
    distance = mean_distance(frame.depth, frame.camera, config.sor.neighbours)
    known = np.isfinite(distance)
    if np.count_nonzero(known) < 2:
        return 0
    if config.sor.method == "paper":
        limit = threshold(distance[known], config.sor.ratio)
    else:
        distance = distance / spacing(frame.depth, frame.camera)
        limit = scaled_threshold(distance[known], config.sor.ratio)
    with np.errstate(invalid="ignore"):
        return frame.remove(known & ~(distance < limit), Reason.SOR)


def threshold(distance: Image, ratio: float) -> float:
    """Open3D's threshold: mean plus `ratio` sample standard deviations of the mean distances (n,)."""
    distance = distance.astype(float)
    return float(distance.mean() + ratio * distance.std(ddof=1))


def scaled_threshold(distance: Image, ratio: float) -> float:
    """Median plus `ratio` robust standard deviations, so that outliers do not mask each other; above the corner of a surface."""
    median = np.median(distance)
    return float(max(median + ratio * robust_std(distance, float(median)), CORNER * median))


def spacing(depth: Image, camera: Camera) -> Image:
    """(H, W) root of the area in m^2 that a pixel covers on the surface it sees; NaN where there is no depth."""
    cosine = np.maximum(cos_incidence(depth, camera), np.float32(FLATTEST))
    length = camera.ray_length().astype(np.float32)
    pixel = np.float32(1 / np.sqrt(camera.fx * camera.fy))
    # A pixel's solid angle shrinks with the cube of the ray's length, its distance grows with it.
    return np.asarray(depth * pixel / np.sqrt(length * cosine), np.float32)
