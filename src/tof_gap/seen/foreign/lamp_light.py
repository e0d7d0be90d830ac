# SPDX-License-Identifier: Apache-2.0
"""The light of another camera's lamp on the cells of a view, from many places and at many frequencies: compiled."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from tof_core.arrays import Float, Mask

STRONGEST = 50.0
"""Most of the foreign light over the own, in units of their ratio at equal ways."""
RIDGE = 1e-3
"""Ridge of a view's four waves, of their mean square: where few pixels are lit, waves are alike."""


def lag_of(k: float, range_m: Float) -> Float:
    """(2, n) cosine and sine of 4 k r."""
    return np.stack([np.cos(4 * k * range_m), np.sin(4 * k * range_m)])


@njit(cache=True, nogil=True)
def waves_from(at: Float, k: float, points: Float, normals: Float, range_m: Float, cosine: Float, lag: Float, lit: Mask) -> Float:
    """(4, n) strength of a lamp's light over the own, as cosine and sine of its phases k (d - r) and k (d + 3 r), 0 where it is not `lit` (n,).

    lag (2, n): cosine and sine of 4 k r.
    """
    out = np.zeros((4, len(points)))
    for i in range(len(points)):
        if not lit[i]:
            continue
        x, y, z = at[0] - points[i, 0], at[1] - points[i, 1], at[2] - points[i, 2]
        d = max(np.sqrt(x * x + y * y + z * z), 1e-3)
        facing = (normals[i, 0] * x + normals[i, 1] * y + normals[i, 2] * z) / d
        if facing <= 0:
            continue
        ratio = min(facing * range_m[i] ** 2 / (d * d * cosine[i]), STRONGEST)
        phase = k * (d - range_m[i])
        c, s = ratio * np.cos(phase), ratio * np.sin(phase)
        out[0, i], out[1, i] = c, s
        out[2, i], out[3, i] = c * lag[0, i] - s * lag[1, i], s * lag[0, i] + c * lag[1, i]
    return out


# Sums of a hundred terms and more at once, in whichever order: a quarter of the time of small matrix products.
@njit(cache=True, nogil=True, fastmath=True)
def gains_at(
    places: Float, k: float, count: int, points: Float, normals: Float, range_m: Float, cosine: Float, lag: Float, sigma: Float,
    smooth: Float, error: Float, lit: Mask,
) -> Float:  # fmt: skip
    """(count, places) chi-square that the light of a lamp at each place explains in a view, beside its smooth fields, at k, 2 k, ... radians per metre.

    lit (places, n): cells that the light of a lamp reaches.

    Phases are taken once: those of a multiple come by the sines and cosines of sums. `error` and the waves less their part in `smooth`
    have the products of the waves alone, less those of their parts.
    """
    out = np.zeros((count, len(places)))
    fields = np.ascontiguousarray(smooth.T)
    part, normal, right = np.empty((4, len(fields))), np.empty((4, 4)), np.empty(4)
    for p in range(len(places)):
        first = waves_from(places[p], k, points, normals, range_m, cosine, lag, lit[p])
        turn, waves = np.empty_like(first), np.empty_like(first)
        for i in range(len(error)):
            ratio = np.sqrt(first[0, i] ** 2 + first[1, i] ** 2)
            over = 1.0 / ratio if ratio > 0 else 1.0
            for j in range(4):
                turn[j, i], waves[j, i] = first[j, i] * over, first[j, i] / sigma[i]
        for n in range(count):
            _beside(fields, waves, error, part, normal, right)
            out[n, p] = _explained(normal, right)
            for j in (0, 2):
                for i in range(len(error)):
                    c, s = waves[j, i], waves[j + 1, i]
                    waves[j, i], waves[j + 1, i] = c * turn[j, i] - s * turn[j + 1, i], s * turn[j, i] + c * turn[j + 1, i]
    return out


@njit(cache=True, nogil=True, fastmath=True)
def _beside(fields: Float, waves: Float, error: Float, part: Float, normal: Float, right: Float) -> None:
    """Fill `normal` (w, w), the products of waves (w, n) less their `part` (w, f) in the orthonormal fields (f, n), and `right` (w,), theirs with the error."""
    for a in range(len(waves)):
        for f in range(len(fields)):
            part[a, f] = _product(waves[a], fields[f])
        right[a] = _product(waves[a], error)
        for b in range(a + 1):
            normal[a, b] = _product(waves[a], waves[b]) - _product(part[a], part[b])


@njit(cache=True, nogil=True)
def _explained(normal: Float, right: Float) -> float:
    """Chi-square b . (A + ridge)^-1 b by Cholesky's factor, which takes the place of A's lower triangle.

    Of waves that smooth fields make nearly wholly, rounding is left, which may be negative: no pivot is below the ridge.
    """
    trace = 0.0
    for i in range(len(right)):
        trace += normal[i, i]
    ridge, chi2 = RIDGE * max(trace, 0.0) / len(right) + 1e-12, 0.0
    for i in range(len(right)):
        for j in range(i + 1):
            rest = normal[i, j] + (ridge if i == j else 0.0)
            for m in range(j):
                rest -= normal[i, m] * normal[j, m]
            normal[i, j] = np.sqrt(max(rest, ridge)) if i == j else rest / normal[j, j]
        for j in range(i):
            right[i] -= normal[i, j] * right[j]
        right[i] /= normal[i, i]
        chi2 += right[i] * right[i]
    return chi2


@njit(cache=True, nogil=True, fastmath=True, inline="always")
def _product(one: Float, other: Float) -> float:
    total = 0.0
    for i in range(len(one)):
        total += one[i] * other[i]
    return total
