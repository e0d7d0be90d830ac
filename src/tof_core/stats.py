# SPDX-License-Identifier: Apache-2.0
"""Robust spread, second differences, and samples grouped by several integer keys."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from tof_core.arrays import Float, Ints, Mask

MAD_TO_STD = 1.4826
"""Standard deviation of a normal distribution divided by its median absolute deviation: 1 / Phi^-1(3/4)."""
SECOND_DIFFERENCE_STD = float(np.sqrt(6.0))
"""Standard deviation of a - 2 b + c divided by that of a, where a, b and c are independent and equally noisy."""
CHI2_MEDIAN = 0.4549
"""Median of chi-square with one degree of freedom."""
CORE = 5.0
"""Robust standard deviations from the median beyond which `trimmed_std` counts a sample as an outlier."""


AFFECTED, AFFECTED_QUANTILE = 0.1, 0.995
"""Entries count as affected from this share of this quantile on; the largest value may be an outlier."""


def robust_std(values: ArrayLike, centre: float | None = None) -> float:
    """Standard deviation of samples (n,), estimated by the median absolute deviation; 0 for no samples.

    Args:
        values: (n,) finite samples, at most half of them outliers.
        centre: what deviations are measured from; the median of the samples if not given.
    """
    x = np.asarray(values)
    if not x.size:
        return 0.0
    return float(MAD_TO_STD * np.median(np.abs(x - (np.median(x) if centre is None else centre))))


def robust_stds(values: Float, centre: Float | float | None = None) -> Float:
    """(k,) `robust_std` of each column of samples (n, k), n at least 1."""
    around = values - (np.median(values, axis=0) if centre is None else centre)
    return np.asarray(MAD_TO_STD * np.median(np.abs(around), axis=0))


def trimmed_std(values: Float) -> float:
    """Standard deviation about the median of the samples (n,), n at least 1, within `CORE` robust standard deviations of it.

    Outliers are left out, the tails of a mixture are not. Where more than half of the samples are equal, all of them count.
    """
    around = values - _median(values)
    size = np.abs(around)
    scale = MAD_TO_STD * _median(size)
    if scale <= 0:
        return float(values.std())
    core = around[size < CORE * scale]
    return float(np.sqrt((core * core).mean()))


def _median(values: Float) -> Any:
    """Median of finite samples (n,), n at least 1: of a few thousand samples, `np.median` takes most of its time for checks."""
    high = len(values) // 2
    if len(values) % 2:
        return np.partition(values, high)[high]
    return np.partition(values, (high - 1, high))[high - 1 : high + 1].mean()


def group_medians(values: Float, group: Ints, groups: int, least: int = 1) -> Float:
    """(groups,) median of the samples (n,) of each group (n,); 0 for a group with fewer than `least` samples."""
    return np.array([float(np.median(p)) if len(p) >= least else 0.0 for p in by_group(values, group, groups)])


def by_group(values: Float, group: Ints, groups: int) -> list[Float]:
    """The samples (n,) of each of some groups, by the group of each (n,)."""
    order = np.argsort(group.astype(np.min_scalar_type(groups)), kind="stable")  # One or two bytes are sorted by counting.
    return np.split(values[order], np.cumsum(np.bincount(group, minlength=groups))[:-1])


def joined(parts: Iterable[Float], most: int) -> Float:
    """(n,) the parts one after the other in single precision, n at most `most`: of a long session's pixels, no two copies at once."""
    out, end = np.empty(most, np.float32), 0
    for part in parts:
        start, end = end, end + len(part)
        out[start:end] = part
    return cast("Float", out[:end])


def beside(basis: Float, values: Float) -> Float:
    """Values (n,) or (n, k) less their part in orthonormal columns (n, f)."""
    return np.asarray(values - basis @ (basis.T @ values))


def pairs_below(ascending: Float, others: Float) -> float:
    """Number of pairs (a, b) of `ascending` values (n,) and `others` (m,) with a < b; a pair with a = b counts half.

    Divided by n m, it is the probability of a < b: the area under the ROC curve.
    """
    return 0.5 * sum(float(np.searchsorted(ascending, others, side).sum()) for side in ("left", "right"))


def hats(values: Float, knots: Sequence[float] | Float) -> Float:
    """(n, knots) piecewise linear functions that are 1 at one of the ascending knots and 0 at all others; constant beyond the ends."""
    return np.stack([np.interp(values, knots, row) for row in np.eye(len(knots))], axis=1)


def touched(values: Float) -> Mask:
    """Entries of a map that an effect touches: those above a tenth of the 99.5 % quantile of |values| other than 0.

    Over these entries, an effect on few pixels and an effect on all are measured alike.
    """
    size = np.abs(values)
    return size >= least_touched(size[size > 0])


def least_touched(sizes: Float) -> float:
    """The value from which entries of a map count as touched; sizes (n,): of those other than 0, which it reorders. Infinite without any."""
    return AFFECTED * float(np.quantile(sizes, AFFECTED_QUANTILE, overwrite_input=True)) if len(sizes) else np.inf


def second_differences(values: Float, axis: int = -1, step: int = 1) -> Float:
    """(a - 2 b + c) / sqrt(6) of samples `step` apart along an axis, which gets 2 `step` shorter.

    A linear trend along the axis is removed; independent noise keeps its standard deviation.
    """
    v = np.moveaxis(np.asarray(values), axis, -1)
    first = v[..., step:] - v[..., :-step]
    second = (first[..., step:] - first[..., :-step]) / SECOND_DIFFERENCE_STD
    return np.asarray(np.moveaxis(second, -1, axis))


@dataclass(frozen=True, slots=True, eq=False)
class Groups:
    """Samples (n,) of which those with equal keys form a group; groups (g,) are in lexicographic order of their keys.

    which (n,): the group of each sample; count (g,): samples of each group; keys: (g,) per key, its value in each group.
    """

    which: Ints
    count: Ints
    keys: tuple[Ints, ...]

    def sum(self, values: NDArray[np.number] | Mask) -> Float:
        """(g,) sums of values (n,)."""
        return np.bincount(self.which, values, len(self.count)).astype(np.float64, copy=False)

    def mean(self, values: NDArray[np.number] | Mask) -> Float:
        """(g,) means of values (n,)."""
        return np.asarray(self.sum(values) / self.count)


DEVIATION_ROUNDS = 20
"""Iterations of reweighted least squares that give least absolute deviations."""


def least_deviations(columns: Float, target: Float, agrees: float) -> Float:
    """(k,) coefficients of columns (n, k) with the least absolute deviations from the target (n,); deviations below `agrees` count alike."""
    out, left = np.zeros(columns.shape[1]), target
    for _ in range(DEVIATION_ROUNDS):
        w = 1 / np.sqrt(np.maximum(np.abs(left), agrees))
        out = np.asarray(np.linalg.lstsq(columns * w[:, None], target * w, rcond=None)[0], float)
        left = target - columns @ out
    return out


def grouped(*keys: Ints) -> Groups:
    """Group samples by one or more keys (n,), each a non-negative integer per sample.

    Raises:
        ValueError: a key is negative, or the product of the keys' ranges exceeds 63 bits.
    """
    dims = tuple(int(key.max(initial=0)) + 1 for key in keys)
    unique, which, count = np.unique(np.ravel_multi_index(keys, dims), return_inverse=True, return_counts=True)
    return Groups(which, count, tuple(np.unravel_index(unique, dims)))


def blocks(where: Mask, side: int, *further: Ints) -> Groups:
    """Group the pixels of a mask (H, W), in the order of `image[where]`, by squares of `side` pixels and further keys (n,).

    The keys of a group are its row of blocks, its column of blocks, and then those given.
    """
    rows, columns = np.nonzero(where)
    return grouped(rows // side, columns // side, *further)


def squares(image: Float, side: int) -> Float:
    """(rows, side, columns, side): the squares of `side` pixels of an image (H, W), with zeros beyond its end."""
    h, w = (-n % side for n in image.shape)
    padded = np.pad(np.asarray(image, float), ((0, h), (0, w)))
    return padded.reshape(padded.shape[0] // side, side, -1, side)
