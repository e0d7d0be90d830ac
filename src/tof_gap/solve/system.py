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
    take = np.concatenate([np.arange(POSE), POSE + active, [system.G.shape[-1] - 1]]).astype(np.int64)
    return _placed(system, _without_arms(system, system.G[:, take[:, None], take], inflate))


def _without_arms(system: System, G: Float, inflate: float) -> Float:
    """(V, 12 + K + 1, 12 + K + 1) of [b x | C | r] and of some columns C: Gram matrices with each view's A marginalised."""
    weight = system.arm_sd**-2
    Na = np.delete(G[:, ARM], ARM, axis=2) / inflate
    Na[:, :, -1] -= weight * system.arm0
    M = np.delete(np.delete(G, ARM, axis=1), ARM, axis=2)
    M /= inflate
    M -= np.swapaxes(Na, 1, 2) @ np.linalg.solve(G[:, ARM, ARM] / inflate + np.diag(weight), Na)
    M[:, -1, -1] += (weight * system.arm0**2).sum(axis=1)
    return M


def _placed(system: System, M: Float) -> Reduced:
    """What views say of their own station's b, at its place among all stations'."""
    k, S = M.shape[1] - 13, system.stations
    m = 6 * S + 6 + k
    H, y = np.zeros((len(M), m, m)), np.zeros((len(M), m))
    for s in range(S):
        mine, at = system.station == s, np.concatenate([6 * s + np.arange(6), 6 * S + np.arange(6 + k)])
        H[np.ix_(mine, at, at)] = M[mine, :-1, :-1]
        y[np.ix_(mine, at)] = M[mine, :-1, -1]
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


OFTEN = 20
"""Choices of columns from which it pays to marginalise beside all columns at once: each choice is but one of rows then."""


class Folded:
    """A system dealt into folds, for held-out scores of many choices of columns."""

    def __init__(self, system: System, folds: Ints, inflate: float = 1.0) -> None:
        """`folds` (V,); `inflate` as in `reduce`."""
        self._system = system
        self._inflate, self._asked = inflate, 0
        self._whole: Float | None = None
        names, self._fold = np.unique(folds, return_inverse=True)
        self._other = (self._fold[None, :] != np.arange(len(names))[:, None]).astype(float)

    def held_out(self, active: Ints, *, free_hand: bool = False) -> Float:
        """(V,) chi-square of each view under the fit to all views of the other folds, its A minimised."""
        reduced = self._reduced(active)
        info, mean = _priors(self._system, active, free_hand=free_hand)
        views, m = reduced.y.shape
        H = (self._other @ reduced.H.reshape(views, m * m)).reshape(-1, m, m) + np.diag(info)
        y = self._other @ reduced.y + info * mean
        z = np.linalg.solve(H, y[..., None])[self._fold]
        return np.asarray(reduced.energy + (((reduced.H @ z)[..., 0] - 2 * reduced.y) * z[..., 0]).sum(axis=1))

    def _reduced(self, active: Ints) -> Reduced:
        self._asked += 1
        if self._asked < OFTEN:
            return reduce(self._system, active, self._inflate)
        if self._whole is None:
            self._whole = _without_arms(self._system, self._system.G, self._inflate)
        local = np.concatenate([np.arange(12), 12 + active, [self._whole.shape[2] - 1]])
        return _placed(self._system, self._whole[:, local[:, None], local])


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
