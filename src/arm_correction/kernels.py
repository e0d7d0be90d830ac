# SPDX-License-Identifier: Apache-2.0
"""Compiled loops over points: score many motions, or linearise one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numba
import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Float, Ints, Mask


@numba.njit(cache=True, nogil=True)
def misfits(
    motions: Float, points: Float, slack: Float, depth: Float, K: Float, limit: float, neutral: float, least: float
) -> tuple[Float, Float]:
    """(m,) mean of min(|dz| - slack, limit) of points (n, 3) under motions (m, 4, 4), against depth (H, W).

    slack (n,): error by noise that does not count. The result is inf if less than the share `least` of the points meets a depth.
    A point that leaves the image, meets no depth, or lies far behind the reference's surface, where it was hidden, is no evidence and
    counts as `neutral`. A point in front of the surface counts in full. Also returns the share (m,) of neutral points.
    """
    h, w = depth.shape
    out, silent = np.empty(len(motions)), np.empty(len(motions))
    for m in range(len(motions)):
        T = motions[m]
        total, met = 0.0, 0
        for i in range(len(points)):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            qz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
            error = neutral
            if qz > 0.05:
                u = K[0] * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / qz + K[2]
                v = K[1] * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / qz + K[3]
                if -0.5 < u < w - 0.5 and -0.5 < v < h - 0.5:
                    d = depth[int(v + 0.5), int(u + 0.5)]
                    if d > 0.0 and qz - d < 2.0 * limit + slack[i]:
                        error = min(max(abs(qz - d) - slack[i], 0.0), limit)
                        met += 1
            total += error
        out[m] = total / len(points) if met >= least * len(points) else np.inf
        silent[m] = 1.0 - met / len(points)
    return out, silent


@numba.njit(cache=True, nogil=True)
def associate(
    T: Float, points: Float, depth: Float, normal: Float, usable: Mask, rays: Float, K: Float
) -> tuple[Ints, Float, Float, Float]:
    """Point to plane by projection: indices of the points (k,) that meet a usable pixel, its flat index, residual (k,), J (k, 6).

    e = n . (T p - r), where r is the reference's point in the pixel that T p falls into; J = [R' n, p x R' n].
    Also the cosine (k,) of the plane against the reference's ray, by which noise along z becomes noise along n.
    """
    h, w = depth.shape
    at = np.empty((len(points), 2), np.int64)
    e, J, c = np.empty(len(points)), np.empty((len(points), 6)), np.empty(len(points))
    k = 0
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        qx = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
        qy = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
        qz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if qz < 0.05:
            continue
        u, v = K[0] * qx / qz + K[2], K[1] * qy / qz + K[3]
        if not (-0.5 < u < w - 0.5 and -0.5 < v < h - 0.5):
            continue
        row, col = int(v + 0.5), int(u + 0.5)
        if not usable[row, col]:
            continue
        d = depth[row, col]
        nx, ny, nz = normal[row, col, 0], normal[row, col, 1], normal[row, col, 2]
        rx, ry = rays[row, col, 0], rays[row, col, 1]
        e[k] = nx * (qx - d * rx) + ny * (qy - d * ry) + nz * (qz - d)
        c[k] = abs(nx * rx + ny * ry + nz)
        a = T[0, 0] * nx + T[1, 0] * ny + T[2, 0] * nz
        b = T[0, 1] * nx + T[1, 1] * ny + T[2, 1] * nz
        g = T[0, 2] * nx + T[1, 2] * ny + T[2, 2] * nz
        J[k, 0], J[k, 1], J[k, 2] = a, b, g
        J[k, 3], J[k, 4], J[k, 5] = y * g - z * b, z * a - x * g, x * b - y * a
        at[k, 0], at[k, 1] = i, row * w + col
        k += 1
    return at[:k], e[:k], J[:k], c[:k]
