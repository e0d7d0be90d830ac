# SPDX-License-Identifier: Apache-2.0
"""Motions that two depth images do not determine, corrected for the information that noise of the normals feigns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh

from tof_align.observability import describe
from tof_core import se3

if TYPE_CHECKING:
    from arm_correction.config import TrustConfig
    from tof_core.arrays import Float

LEVER_M = 0.3
"""Metres that are equivalent to one radian where directions mix."""
SCALE = np.repeat([1.0, LEVER_M], 3)


@dataclass(frozen=True, slots=True, eq=False)
class Unknown:
    """null (k, 6): orthonormal in (x, y, z, lever * rotX, lever * rotY, lever * rotZ), axes of the camera as it is now; names in words."""

    null: Float
    names: tuple[str, ...]

    @property
    def rank(self) -> int:
        """Number of determined directions, of six."""
        return 6 - len(self.null)

    @classmethod
    def all_(cls) -> Unknown:
        """Nothing is known."""
        return cls(np.eye(6), ("everything",))


def unknown_directions(e: Float, J: Float, weight: Float, tilt: Float, points: Float, trust: TrustConfig) -> tuple[Unknown, Float]:
    """Undetermined directions and the covariance (6, 6) of a right perturbation.

    Noisy normals make a plane look rough, and roughness looks like information about sliding along it. This false
    information, the sum of w tilt^2 over the two directions across each normal, is subtracted. A direction is undetermined
    if the share `chance` of its information is false, or if its sigma exceeds the limit.

    Args:
        e: (k,) residuals, metres.
        J: (k, 6) their derivative.
        weight: (k,) inverse variances with the robust weight in, 1/m^2.
        tilt: (k,) standard deviation of the normals, radians.
        points: (k, 3) camera frame.
        trust: limits.
    """
    Js = J / SCALE
    H = (Js * weight[:, None]).T @ Js
    pretended = _pretended(J[:, :3], points, weight * tilt**2)
    size = np.sqrt(np.trace(H) / 6.0)
    share, vectors = eigh(pretended / size**2, H / size**2 + 1e-9 * np.eye(6))
    vectors = vectors / np.linalg.norm(vectors, axis=0)
    chance = share > trust.chance
    real = H - pretended
    values, axes = np.linalg.eigh(0.5 * (real + real.T))
    inflation = inflation_of(e, weight)
    std = np.sqrt(inflation / np.maximum(values, 1e-6 * size**2))
    wanted = np.where(
        np.linalg.norm(axes[:3], axis=0) > np.linalg.norm(axes[3:], axis=0), trust.known_mm * 1e-3, np.radians(trust.known_deg) * LEVER_M
    )
    open_ = np.concatenate([vectors[:, chance].T, axes[:, std > wanted].T])
    null = _span(open_)
    cov = (axes * std**2) @ axes.T
    if len(null):
        cov = cov + null.T @ null * 1.0
    names = tuple(describe(n, np.zeros(3), LEVER_M).replace("cell", "camera") for n in null)
    return Unknown(null, names), cov / np.outer(SCALE, SCALE)


def _pretended(normal: Float, points: Float, weight: Float) -> Float:
    """(6, 6) false information due to noise of the normals (k, 3), of the given weight times tilt^2 (k,); scaled."""
    across = np.cross(normal, np.where(np.abs(normal[:, :1]) < 0.7, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    out = np.zeros((6, 6))
    for t in (across, np.cross(normal, across)):
        j = np.concatenate([t, np.cross(points, t)], axis=1) / SCALE
        out += (j * weight[:, None]).T @ j
    return out


def inflation_of(e: Float, weight: Float, run: int = 12) -> float:
    """Factor by which the correlation of neighbouring residuals inflates the variance; points are in raster order."""
    white = np.sqrt(weight) * e
    whole = len(white) // run * run
    sums = white[:whole].reshape(-1, run).sum(axis=1)
    return float(max((white**2).mean(), (sums**2).mean() / run, 0.1))


def _span(directions: Float) -> Float:
    """Orthonormal basis (k, 6) of what directions (n, 6) span; nearly equal ones are one."""
    if not len(directions):
        return np.zeros((0, 6))
    _, size, basis = np.linalg.svd(directions)
    return np.asarray(basis[: int((size > 0.2).sum())])


def smallest_motion(T: Float, null: Float, rounds: int = 10) -> Float:
    """The smallest of all motions T exp(undetermined directions), so that nothing moves along an undetermined direction."""
    for _ in range(rounds):
        step = null.T @ (null @ (SCALE * se3.log(T))) / SCALE
        T = T @ se3.exp(-step)
        if np.linalg.norm(step) < 1e-9:
            break
    return T
