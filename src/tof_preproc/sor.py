# SPDX-License-Identifier: Apache-2.0
"""Statistical outlier removal: points unusually far from their nearest neighbours.

`paper` is Open3D's `remove_statistical_outlier`: mean distance to 20 neighbours (the point itself among them, at 0),
removed beyond the mean of all plus 2 standard deviations. In metres this removes far surfaces, whose points lie further
apart. `scaled` measures in units of the point spacing that a surface has at that range and incidence.
"""

from __future__ import annotations

from functools import lru_cache
from math import gcd
from typing import TYPE_CHECKING

import numpy as np

from tof_core.reasons import Reason
from tof_core.stats import robust_std
from tof_preproc.neighbours import Neighbourhood
from tof_preproc.surface import cos_incidence

if TYPE_CHECKING:
    from tof_core.arrays import Image, Ints
    from tof_core.camera import Camera
    from tof_preproc.config import PreprocConfig
    from tof_preproc.frame import Frame

CORNER = 2.2
"""Least ratio of an outlier's mean distance to the median; at a corner of a surface the ratio is 2."""
SAMPLES = 4000
"""Points that a limit is estimated from where there are more than twice as many.

The scaled limit is within 0.3 % of that from all points. Of recorded frames 1 pixel in 20 000 is decided otherwise; of a noisy
slanted plane, whose far end the paper's filter cuts, 13 in 10 000 (`python -m benchmarks --only preproc`)."""
FAR_BEYOND = 1.3
"""Multiple of the sample's limit beyond which every distance enters the final limit: these make the heavy tail."""
LONE_SHARE = 0.1
"""Largest share of a sample whose distances are set to infinity; a median tolerates up to a half."""
FLATTEST = 0.1
"""Least cosine of incidence in the expected spacing."""


def remove_sor(frame: Frame, config: PreprocConfig) -> int:
    """Remove points far from their nearest neighbours."""
    cloud = Neighbourhood(frame.depth, frame.camera, config.sor.neighbours)
    if cloud.points < 2:
        return 0
    outliers = _beyond if config.sor.method == "paper" else _beyond_scaled
    gone = np.zeros(frame.depth.size, bool)
    gone[outliers(cloud, frame, config.sor.ratio)] = True
    return frame.remove(gone.reshape(frame.depth.shape), Reason.SOR)


def _beyond_scaled(cloud: Neighbourhood, frame: Frame, ratio: float) -> Ints:
    """Flat indices of the pixels whose distance, in units of the spacing expected there, is beyond the limit."""
    unit = spacing(frame.depth, frame.camera)
    _, some = _some(cloud)
    some = some[np.isfinite(unit.ravel()[some])]  # Where the lens model folds over, no spacing is expected.
    if some.size < 2:
        return some[:0]
    limit = scaled_threshold(_beyond_medians(cloud, some) / unit.ravel()[some], ratio)
    within = np.float32(limit) * unit
    doubtful = cloud.doubtful(within)
    return doubtful[cloud.beyond(doubtful, within.ravel()[doubtful])]


def _beyond_medians(cloud: Neighbourhood, pixels: Ints) -> Image:
    """(n,) mean distances in metres, infinite beyond the widest window, which a median tolerates.

    If many points are that far apart, as in a sparse cloud, all distances are computed.
    """
    near = cloud.mean_distance_near(pixels)
    lone = near < 0
    if np.count_nonzero(lone) > LONE_SHARE * lone.size:
        return cloud.mean_distance(pixels)
    return np.where(lone, np.float32(np.inf), near)


def _beyond(cloud: Neighbourhood, frame: Frame, ratio: float) -> Ints:
    """Flat indices of the pixels whose distance in metres is beyond the limit.

    Outliers dominate the standard deviation. Therefore it contains all pixels that may be far beyond the limit, and a sample of the others.
    """
    known, some = _some(cloud)
    distance = np.full(frame.depth.size, np.float32(np.nan))
    distance[some] = cloud.mean_distance(some)
    limit = threshold(distance[some], ratio)
    if some.size == known.size:
        return known[~(distance[known] < limit)]
    far = cloud.doubtful(_everywhere(FAR_BEYOND * limit, frame))
    near = np.ones(frame.depth.size, bool)
    near[far] = False
    _measure(cloud, distance, far, FAR_BEYOND * limit)
    limit = _limit_of_two(distance[some[near[some]]], known.size - far.size, distance[far], ratio)
    doubtful = cloud.doubtful(_everywhere(limit, frame), at_rims=False)
    unknown = np.isnan(distance[doubtful])
    beyond = ~(distance[doubtful] < limit)
    beyond[unknown] = cloud.beyond(doubtful[unknown], np.full(np.count_nonzero(unknown), np.float32(limit)))
    return doubtful[beyond]


def _everywhere(metres: float, frame: Frame) -> Image:
    return np.full(frame.depth.shape, np.float32(metres))


def _measure(cloud: Neighbourhood, distance: Image, pixels: Ints, at_least: float) -> None:
    """Fill the distances of those pixels (flat indices) that have none yet; about `at_least` metres or more."""
    unknown = pixels[np.isnan(distance[pixels])]
    distance[unknown] = cloud.mean_distance(unknown, at_least)


def _some(cloud: Neighbourhood) -> tuple[Ints, Ints]:
    """Flat indices of the known pixels, and of those of them that a limit is estimated from: about `SAMPLES` in even steps."""
    known = np.flatnonzero(cloud.known)
    step = max(1, known.size // SAMPLES)
    while gcd(step, cloud.known.shape[1]) > 1:  # else whole columns would be missed
        step += 1
    return known, known[::step].copy()


def threshold(distance: Image, ratio: float) -> float:
    """Open3D's threshold: mean plus `ratio` sample standard deviations of the mean distances (n,)."""
    distance = distance.astype(float)
    return float(distance.mean() + ratio * distance.std(ddof=1))


def _limit_of_two(sample: Image, near: int, far: Image, ratio: float) -> float:
    """`threshold` of `near` distances, known by a sample (n,), and of further ones that are all known (m,)."""
    sample, far = sample.astype(float), far.astype(float)
    total = near + far.size
    mean = (near * sample.mean() + far.sum()) / total
    squares = near * np.mean((sample - mean) ** 2) + np.sum((far - mean) ** 2)
    return float(mean + ratio * np.sqrt(squares / (total - 1)))


def scaled_threshold(distance: Image, ratio: float) -> float:
    """Median plus `ratio` robust standard deviations, so that outliers do not mask each other; above the corner of a surface."""
    median = np.median(distance)
    return float(max(median + ratio * robust_std(distance, float(median)), CORNER * median))


def spacing(depth: Image, camera: Camera) -> Image:
    """(H, W) root of the area in m^2 that a pixel covers on the surface it sees; NaN where there is no depth."""
    cosine = np.maximum(cos_incidence(depth, camera), np.float32(FLATTEST))
    length = _length(camera)
    pixel = np.float32(1 / np.sqrt(camera.fx * camera.fy))
    # A pixel's solid angle shrinks with the cube of the ray's length, its distance grows with it.
    return np.asarray(depth * pixel / np.sqrt(length * cosine), np.float32)


@lru_cache(maxsize=16)
def _length(camera: Camera) -> Image:
    """(H, W) length of the rays with z = 1, as float32."""
    return camera.ray_length().astype(np.float32)
