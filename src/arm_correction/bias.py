# SPDX-License-Identifier: Apache-2.0
"""The covariance that the camera's bias adds to a pose: a surface seen from another place is measured with another bias.

The bias of a ToF camera is a function of range (wiggling) and of amplitude, which is proportional to cos(incidence) / range^2. If view
and reference see a surface at the same range, it cancels. After a motion the difference remains, and the pose absorbs a part of it. Its
size is not known beforehand; it is estimated from the residuals, which contain the other part.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from arm_correction.unknown import SCALE

if TYPE_CHECKING:
    from arm_correction.unknown import Unknown
    from tof_core.arrays import Float

RANGE_M = 0.1
"""Distance of the knots over range: a quarter of the shortest period of usual wiggling, 0.37 m at 100 MHz."""
LIGHT = 0.5
"""Distance of the knots over ln(cos / range^2): amplitude bias changes little within half of that."""
KNOTS = 161
"""Number of knots: 8 m of range each way; those without a point are left out."""
SIZES_MM = np.linspace(0.0, 10.0, 101)
"""Sizes of the bias that are tried."""
USUAL_MM = 2.0
"""Scale of the prior (half normal) of the size: the bias of usual cameras is one to three millimetres."""


def sights(direction: Float, normal: Float, radial: Float) -> Float:
    """(k, m) change of n . point, metres, per metre of bias at each knot.

    Args:
        direction: (k, 3) unit rays.
        normal: (k, 3) unit normals in the same frame.
        radial: (k,) range, metres.
    """
    cosine = np.einsum("ij,ij->i", direction, normal)
    light = np.log(np.maximum(np.abs(cosine), 0.05) / radial**2)
    return np.concatenate([cosine[:, None] * _hats(radial, RANGE_M), cosine[:, None] * _hats(light, LIGHT)], axis=1)


def _hats(x: Float, step: float) -> Float:
    """(k, KNOTS) linear hat functions on knots `step` apart, the middle one at 0."""
    place = np.clip(x / step + KNOTS // 2, 0, KNOTS - 1.001)
    low = place.astype(int)
    out = np.zeros((len(x), KNOTS))
    out[np.arange(len(x)), low], out[np.arange(len(x)), low + 1] = 1 - (place - low), place - low
    return out


def bias_covariance(e: Float, J: Float, weight: Float, D: Float, unknown: Unknown, inflation: float) -> Float:
    """(6, 6) covariance that the bias adds, metres and radians.

    Args:
        e: (k,) residuals, metres.
        J: (k, 6) their derivative by the pose.
        weight: (k,) inverse variances, 1/m^2.
        D: (k, m) their derivative by the bias at each knot.
        unknown: undetermined directions, along which nothing is added.
        inflation: variance of the whitened residuals, with what neighbours share.
    """
    D = D[:, np.abs(D).max(axis=0) > 1e-6]
    if not unknown.rank or not D.shape[1]:
        return np.zeros((6, 6))
    root = np.sqrt(weight)
    known = np.linalg.svd(np.eye(6) - unknown.null.T @ unknown.null)[0][:, : unknown.rank]
    A, B = (root[:, None] * J / SCALE) @ known, root[:, None] * D
    taken = np.linalg.lstsq(A, B, rcond=None)[0]
    left, values, _ = np.linalg.svd(B - A @ taken, full_matrices=False)
    white = root * e
    size = _size(left.T @ white, values, inflation)
    gain = known @ taken * size
    return np.asarray(gain @ gain.T / np.outer(SCALE, SCALE))


def _size(c: Float, values: Float, noise: float) -> float:
    """Root mean square size of the bias, metres, by its posterior: each coefficient has variance noise + size^2 values^2.

    Only coefficients in which a usual bias would exceed the noise count: the others contain errors at edges and curved surfaces.
    """
    shows = 1e-3 * USUAL_MM * values > np.sqrt(noise)
    variance = noise + (1e-3 * SIZES_MM[:, None] * values[shows]) ** 2
    log = -0.5 * (np.log(variance) + c[shows] ** 2 / variance).sum(axis=1) - 0.5 * (SIZES_MM / USUAL_MM) ** 2
    p = np.exp(log - log.max())
    return float(1e-3 * np.sqrt((p * SIZES_MM**2).sum() / p.sum()))
