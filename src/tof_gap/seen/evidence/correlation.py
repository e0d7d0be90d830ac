# SPDX-License-Identifier: Apache-2.0
"""Correlation of the noise of neighbouring pixels, which a filter in the camera causes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.optimize import nnls

from tof_core.stats import second_differences, trimmed_std

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Image, Ints, Mask
    from tof_gap.limits.evidence import CorrelationLimits

WIDTHS_PX = np.arange(1, 8)
"""Pixels: widths of averaging windows; 1 is independent noise."""
DEVIATIONS_PX = np.array([0.6, 0.8, 1.0, 1.25, 1.5, 2.0])
"""Pixels: standard deviations of Gaussian windows."""
WIDEST, WIDE_SHARE = 6.5, 0.5
"""Cameras average over 3 to 6 pixels. If wider windows hold this share of the variance, it is structure, such as that of a printed board."""
INTERPOLATED_PX = np.arange(1, 17)
"""Pixels: widths over which a camera shares noise that interpolates depth between projected dots, some 5 to 10 pixels apart."""
VIEWS = 6
"""Views from which the window is estimated: the filter is the same in all."""
MOST_ROUNDING = 0.7
"""Most of the variance of next neighbours that is counted as rounding: of the rest the growth is known to a tenth."""
LOCAL_SHARE = 0.5
"""Least share of what captures differ by that pixels apart show, too: foreign light and a hand that sways shift whole images."""
LEAST_SAMPLES = 1000
"""Differences of which the variance is known to 5 %."""


@dataclass(frozen=True, slots=True)
class NoiseCorrelation:
    """The noise of pixels whose neighbours share some of it.

    lever: variance of one pixel beyond that which second differences of next neighbours show, over the growth of the latter from next
    neighbours to pixels two apart; 0 for independent pixels. A part of the noise that is independent, such as that of rounding, shows no
    growth: so the lever holds at every amplitude, whatever the share of that part.
    line, area: variance of the mean of many pixels of a line, or of an area, over that of as many independent pixels; 1 for these.
    growth: variance that second differences show of pixels two apart, over that of next neighbours.
    """

    lever: float = 0.0
    line: float = 1.0
    area: float = 1.0
    growth: float = 1.0

    @property
    def correlated(self) -> bool:
        """Whether neighbours share noise."""
        return self.area > 1.0

    @property
    def window_px(self) -> int:
        """Width of the window over which noise was averaged: pixels farther apart share none."""
        return round(float(np.sqrt(self.area)))

    @property
    def interpolated(self) -> bool:
        """Whether more pixels share noise than cameras average, as between projected dots; its size is then that of the captures' differences."""
        return self.window_px > WIDEST

    @property
    def steps(self) -> tuple[int, ...]:
        """Pixels between the samples of the second differences whose variances `variance` takes."""
        return (1, 2) if self.correlated else (1,)

    def variance(self, shown: Sequence[float]) -> float:
        """Variance of one pixel, by the variances of second differences of samples `steps` pixels apart."""
        return shown[0] + self.lever * max(shown[-1] - shown[0], 0.0)

    def sampled(self, share: float) -> float:
        """Variance of the mean of a random `share` of an area's pixels, over that of as many independent pixels."""
        return 1.0 + (self.area - 1.0) * share


INDEPENDENT = NoiseCorrelation()
"""The noise of pixels that share none of it."""


def noise_correlation(
    residuals: Sequence[Float | Image], masks: Sequence[Mask], limits: CorrelationLimits, rounding2: float = 0.0, between2: float = 0.0
) -> NoiseCorrelation:
    """The correlation of the noise of a camera, from residuals over their standard deviation (H, W) per view at the pixels of masks (H, W).

    The autocorrelation of noise that was averaged over an even window is triangular, over a Gaussian window Gaussian: the variance of
    second differences rises with the distance of the samples until it exceeds the window. The measured variances are a non-negative sum
    of those of windows of all sizes, and of the fourth power of the distance for errors that are smooth over the image. Windows are
    taken as alike along rows and columns. Pixels are independent where differences of next neighbours understate the variance by less
    than the factor `limits.variance`, or where windows wider than those of cameras would be needed: unless the captures of dwells differ
    by as much as that, by the variance `between2` of a mean of captures (0: unknown). Cameras that interpolate depth between projected dots do.
    """
    views = np.unique(np.linspace(0, len(masks) - 1, min(len(masks), VIEWS)).astype(int))
    seen = [np.where(masks[v], residuals[v], np.nan) for v in views]
    near, next_but_one = variance_apart(seen, 1), variance_apart(seen, 2)
    rounding2 = min(rounding2, MOST_ROUNDING * near)
    if not (near > 0.0 and next_but_one - rounding2 > limits.growth * (near - rounding2)):
        return INDEPENDENT
    growth = next_but_one / near
    shown = _further([near, next_but_one], seen, WIDTHS_PX)
    found = _Windows.fitted(shown, WIDTHS_PX)
    if found is not None and found.whole >= limits.variance * near and not found.wider_than(WIDEST):
        return NoiseCorrelation(found.lever, found.mean(1), found.mean(2), growth)
    wide = _Windows.fitted(_further(shown, seen, INTERPOLATED_PX), INTERPOLATED_PX) if between2 > limits.variance * near else None
    if wide is None or wide.whole < LOCAL_SHARE * between2:
        return NoiseCorrelation(growth=growth)
    # Structure of the scene is in the residuals, and not in what captures differ by.
    return NoiseCorrelation((between2 - near) / (next_but_one - near), wide.mean(1), wide.mean(2), growth)


class _Windows(NamedTuple):
    """Averaging windows whose noise shows the measured variances: the variance of each, and its width (windows,).

    next_two: (2, windows) of unit variance, as second differences of samples 1 and 2 pixels apart show it.
    """

    part: Float
    width: Float
    next_two: Float

    @classmethod
    def fitted(cls, variances: Sequence[float], widths: Ints) -> _Windows | None:
        """The windows of these even widths and of Gaussian ones, from the variances of `_further`; None where too few pixels show one of them."""
        steps, shown = np.arange(1, len(variances) + 1), np.array(variances)
        if not (shown > 0.0).all():
            return None
        windows = _windows(steps, widths)
        columns = np.stack([*windows, (steps / steps[-1]) ** 4.0], axis=1)
        part = nnls(columns / shown[:, None], np.ones(len(steps)))[0][:-1]
        width = np.concatenate([widths, 2.0 * np.sqrt(np.pi) * DEVIATIONS_PX])
        return cls(part, width, windows[:, :2].T) if part.sum() > 0.0 else None

    @property
    def whole(self) -> float:
        """Variance of one pixel."""
        return float(self.part.sum())

    @property
    def lever(self) -> float:
        """`NoiseCorrelation.lever`."""
        near, apart = (float(self.part @ of) for of in self.next_two)
        return (self.whole - near) / (apart - near)

    def mean(self, power: int) -> float:
        """Variance of the mean of many pixels of a line (power 1) or of an area (2), over that of as many independent pixels."""
        return float(self.part @ self.width**power) / self.whole

    def wider_than(self, width: float) -> bool:
        """Whether wider windows hold `WIDE_SHARE` of the variance."""
        return bool(self.part[self.width > width].sum() > WIDE_SHARE * self.whole)


def _further(variances: Sequence[float], seen: Sequence[Float], widths: Ints) -> list[float]:
    """The `variances` of samples 1, 2, ... pixels apart, and those up to the widest window and two beyond: there noise and smooth errors separate."""
    return [*variances, *(variance_apart(seen, step) for step in range(len(variances) + 1, int(widths[-1]) + 3))]


def variance_apart(images: Sequence[Float], step: int) -> float:
    """Variance of the second differences, along rows and columns, of samples `step` pixels apart; 0 for too few of them."""
    every = np.concatenate([second_differences(image, axis, step).ravel() for image in images for axis in (0, 1)])
    every = every[np.isfinite(every)]
    return trimmed_std(every) ** 2 if len(every) >= LEAST_SAMPLES else 0.0


def _windows(steps: Ints, widths: Ints) -> Float:
    """(windows, steps) variance of second differences of noise of unit variance that was averaged over each window."""
    return np.asarray((6.0 - 8.0 * _autocorrelation(steps, widths) + 2.0 * _autocorrelation(2 * steps, widths)) / 6.0)


def _autocorrelation(lag: Ints, widths: Ints) -> Float:
    """(windows, lags) of noise that was averaged over each window, at a distance of `lag` pixels."""
    even = np.maximum(0.0, 1.0 - lag / widths[:, None])
    return np.concatenate([even, np.exp(-((lag / (2.0 * DEVIATIONS_PX[:, None])) ** 2))])
