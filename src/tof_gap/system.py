# SPDX-License-Identifier: Apache-2.0
"""The session as one linear system: poses with the robot's priors beside columns of effects.

Around the reference poses a residual along z is r = J xi + C theta + noise, where the camera's
step xi comes from B (station), X (hand-eye) and A (view) of the chain. Each view is reduced once
to the Gram matrix of [b x a | C | r]; every fit and every held-out score afterwards is algebra on
small matrices, all views at once, so hundreds of hypotheses cost about a second.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Float, Ints

BASE, HAND, ARM = slice(0, 6), slice(6, 12), slice(12, 18)
POSE = 18
"""Pose columns of a view: its station's b, the session's x, its own a."""

HAND_FREE_SD = np.repeat([0.05, 0.1], 3)
"""A hand-eye error under test: anything a mount could do (50 mm, 6 degrees)."""


@dataclass(frozen=True, slots=True, eq=False)
class System:
    """V views, S stations, K effect columns.

    G (V, 18 + K + 1, 18 + K + 1) weighted Gram matrices; station (V,); n (V,) pixels and weight
    (V,) their sums of 1 / sigma^2; prior standard deviations (6,) of B, A, X and present values
    base0 (S, 6), arm0 (V, 6), hand0 (6,); theta_sd (K,) weak priors of the columns' coefficients.
    """

    G: Float
    station: Ints
    n: Float
    weight: Float
    base_sd: Float
    arm_sd: Float
    hand_sd: Float
    base0: Float
    arm0: Float
    hand0: Float
    theta_sd: Float

    @property
    def stations(self) -> int:
        """How many stations."""
        return len(self.base0)

    @property
    def sigma(self) -> float:
        """Metres: the typical pixel's noise."""
        return float(np.sqrt(self.n.sum() / self.weight.sum()))


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A solution: z = (b of every station, x, theta of the active columns) and its covariance."""

    active: Ints
    z: Float
    cov: Float
    energy: float
    stations: int

    @property
    def base(self) -> Float:
        """(S, 6) steps of B."""
        return self.z[: 6 * self.stations].reshape(-1, 6)

    @property
    def hand(self) -> Float:
        """(6,) step of X."""
        return self.z[6 * self.stations : 6 * self.stations + 6]

    @property
    def theta(self) -> Float:
        """(k,) coefficients of the active columns, in metres (columns have unit RMS)."""
        return self.z[6 * self.stations + 6 :]

    @property
    def theta_cov(self) -> Float:
        """(k, k) covariance of theta."""
        g = 6 * self.stations + 6
        return self.cov[g:, g:]


@dataclass(frozen=True, slots=True, eq=False)
class Reduced:
    """Normal equations H (V, m, m), y (V, m), energy (V,) over z, each view's A marginalised."""

    H: Float
    y: Float
    energy: Float


def reduce(system: System, active: Ints, inflate: float = 1.0) -> Reduced:
    """Marginalise every view's A under its prior.

    `inflate` divides the data's weight: discrepancy shared by neighbours counts once.
    """
    k, S = len(active), system.stations
    take = np.concatenate([np.arange(POSE), POSE + active, [system.G.shape[-1] - 1]]).astype(np.int64)
    N = system.G[:, take[:, None], take] / inflate
    weight = system.arm_sd**-2
    Naa = N[:, ARM, ARM] + np.diag(weight)
    rest = np.concatenate([np.arange(12), POSE + np.arange(k + 1)])
    Na = N[:, ARM][:, :, rest]
    Na[:, :, -1] -= weight * system.arm0
    M = N[:, rest[:, None], rest] - np.swapaxes(Na, 1, 2) @ np.linalg.solve(Naa, Na)
    M[:, -1, -1] += (weight * system.arm0**2).sum(axis=1)
    m = 6 * S + 6 + k
    H, y = np.zeros((len(N), m, m)), np.zeros((len(N), m))
    for v, s in enumerate(system.station):
        at = np.concatenate([6 * s + np.arange(6), 6 * S + np.arange(6 + k)])
        H[v][np.ix_(at, at)] = M[v, :-1, :-1]
        y[v, at] = M[v, :-1, -1]
    return Reduced(H, y, M[:, -1, -1])


def fit(system: System, active: Ints, *, inflate: float = 1.0, free_hand: bool = False) -> Fit:
    """Weighted least squares of B, X and theta over all views; X is held unless `free_hand`."""
    reduced = reduce(system, active, inflate)
    info, mean = _priors(system, active, free_hand=free_hand)
    H = reduced.H.sum(axis=0) + np.diag(info)
    y = reduced.y.sum(axis=0) + info * mean
    cov = np.linalg.inv(H)
    z = cov @ y
    energy = float(reduced.energy.sum() + (info * mean**2).sum() - y @ z)
    return Fit(active, z, cov, energy, system.stations)


def cross_validate(
    system: System,
    active: Ints,
    folds: Ints,
    *,
    inflate: float = 1.0,
    free_hand: bool = False,
) -> Float:
    """(V,) chi-square of each view under the fit to all views of the other folds, its A minimised."""
    reduced = reduce(system, active, inflate)
    info, mean = _priors(system, active, free_hand=free_hand)
    names = np.unique(folds)
    mine = (folds[None, :] == names[:, None]).astype(float)
    H = reduced.H.sum(axis=0) - np.einsum("fv,vij->fij", mine, reduced.H) + np.diag(info)
    y = reduced.y.sum(axis=0) - mine @ reduced.y + info * mean
    z = np.linalg.solve(H, y[..., None])[np.searchsorted(names, folds), :, 0]
    return np.asarray(reduced.energy - 2 * np.einsum("vi,vi->v", reduced.y, z) + np.einsum("vi,vij,vj->v", z, reduced.H, z))


def _priors(system: System, active: Ints, *, free_hand: bool) -> tuple[Float, Float]:
    """Inverse variances and means of z."""
    hand_sd = HAND_FREE_SD if free_hand else system.hand_sd
    sd = np.concatenate([np.tile(system.base_sd, system.stations), hand_sd, system.theta_sd[active]])
    mean = np.concatenate([-system.base0.ravel(), -system.hand0, np.zeros(len(active))])
    return sd**-2.0, mean


def arm_steps(system: System, solution: Fit, *, inflate: float = 1.0) -> Float:
    """(V, 6) step of each view's A under a solution."""
    k = len(solution.active)
    take = np.concatenate([np.arange(POSE), POSE + solution.active, [system.G.shape[-1] - 1]]).astype(np.int64)
    N = system.G[:, take[:, None], take][:, ARM] / inflate
    weight = system.arm_sd**-2
    z = np.concatenate(
        [
            solution.base[system.station],
            np.broadcast_to(solution.hand, (len(N), 6)),
            np.broadcast_to(solution.theta, (len(N), k)),
        ],
        axis=1,
    )
    rest = np.concatenate([np.arange(12), POSE + np.arange(k)])
    rhs = N[:, :, -1] - weight * system.arm0 - np.einsum("vij,vj->vi", N[:, :, rest], z)
    return np.asarray(np.linalg.solve(N[:, :, ARM] + np.diag(weight), rhs[..., None])[..., 0])


def map_energy(system: System, target: Ints, coefficients: Float, others: Ints, *, inflate: float = 1.0) -> float:
    """Chi-square that pose and the columns `others` leave of the map C[target] @ coefficients.

    The map takes the residual's place and everything else is fitted to it: what is left is what
    the session can see of it (the separability of issue 3).
    """
    take = np.concatenate([np.arange(POSE), POSE + others]).astype(np.int64)
    rows = system.G[:, take][:, :, POSE + target] @ coefficients
    size = len(take) + 1
    G = np.empty((len(system.G), size, size))
    G[:, :-1, :-1] = system.G[:, take[:, None], take]
    G[:, :-1, -1] = G[:, -1, :-1] = rows
    G[:, -1, -1] = np.einsum("i,vij,j->v", coefficients, system.G[:, (POSE + target)[:, None], POSE + target], coefficients)
    at_zero = replace(
        system,
        G=G,
        base0=np.zeros_like(system.base0),
        arm0=np.zeros_like(system.arm0),
        hand0=np.zeros(6),
        theta_sd=system.theta_sd[others],
    )
    return fit(at_zero, np.arange(len(others)), inflate=inflate).energy * inflate
