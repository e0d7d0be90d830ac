# SPDX-License-Identifier: Apache-2.0
"""The session as one linear system: poses with the robot's priors beside columns of effects.

Around the reference poses a residual along z is r = J xi + C theta + noise, with
xi = Ad(T^-1) b + Ad(X^-1) a + x for B (station), A (view) and X (hand-eye) of the chain. Each view
is reduced once to the Gram matrix of [J C r]; every fit and every held-out score afterwards is
algebra on small matrices, so hundreds of hypotheses cost about a second.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints

POSE = 6


@dataclass(frozen=True, slots=True, eq=False)
class ViewGram:
    """One view: G (6 + K + 1, 6 + K + 1) of [J C r] with weights 1 / sigma^2, and its place in the chain.

    to_base, to_arm (6, 6) turn b and a into the camera's own axes; `arm0` (6,) is A's present
    value, `n` the pixels behind it and `weight` their sum of 1 / sigma^2.
    """

    G: Float
    to_base: Float
    to_arm: Float
    arm0: Float
    station: int
    n: int
    weight: float

    @property
    def columns(self) -> int:
        """K, effect columns."""
        return len(self.G) - POSE - 1


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """Priors (standard deviations (6,)) and present values of B per station and of X."""

    base_sd: Float
    arm_sd: Float
    hand_sd: Float
    base0: Float
    hand0: Float

    @property
    def stations(self) -> int:
        """How many stations."""
        return len(self.base0)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Solution of some views: b (S, 6), x (6,), theta (k,) of the active columns, with covariance."""

    active: Ints
    base: Float
    hand: Float
    theta: Float
    cov: Float
    energy: float

    @property
    def theta_cov(self) -> Float:
        """(k, k) covariance of theta."""
        k = len(self.theta)
        return self.cov[len(self.cov) - k :, len(self.cov) - k :]


def _pieces(view: ViewGram, active: Ints, chain: Chain) -> tuple[Float, Float]:
    """Normal equations of one view over [b, x, theta | a | r], and the prior of a."""
    take = np.concatenate([np.arange(POSE), POSE + active, [len(view.G) - 1]]).astype(np.int64)
    G = view.G[np.ix_(take, take)]
    k = len(active)
    # xi = to_base b + x + to_arm a; the remaining columns stay themselves.
    M = np.zeros((POSE + k + 1, 3 * POSE + k + 1))
    M[:POSE, :POSE] = view.to_base
    M[:POSE, POSE : 2 * POSE] = np.eye(POSE)
    M[POSE : POSE + k, 2 * POSE : 2 * POSE + k] = np.eye(k)
    M[:POSE, 2 * POSE + k : 3 * POSE + k] = view.to_arm
    M[-1, -1] = 1.0
    return M.T @ G @ M, 1.0 / chain.arm_sd**2


def _eliminate_arm(view: ViewGram, active: Ints, chain: Chain, inflate: float) -> tuple[Float, Float, float]:
    """Normal matrix, right side and energy over [b, x, theta] with the view's A marginalised."""
    N, weight = _pieces(view, active, chain)
    N = N / inflate
    g = 2 * POSE + len(active)
    a = slice(g, g + POSE)
    Naa = N[a, a] + np.diag(weight)
    Nga, Nag_r = N[:g, a], N[a, -1] - weight * view.arm0
    gain = np.linalg.solve(Naa, np.column_stack([Nga.T, Nag_r]))
    H = N[:g, :g] - Nga @ gain[:, :g]
    y = N[:g, -1] - Nga @ gain[:, g]
    energy = float(N[-1, -1] + (weight * view.arm0**2).sum() - Nag_r @ gain[:, g])
    return H, y, energy


@dataclass(frozen=True, slots=True, eq=False)
class Reduced:
    """One view's normal equations over [b, x, theta] with its A marginalised."""

    H: Float
    y: Float
    energy: float
    station: int


def reduce_view(view: ViewGram, active: Ints, chain: Chain, inflate: float = 1.0) -> Reduced:
    """Marginalise A under its prior; `inflate` divides the data's weight (discrepancy of neighbours)."""
    H, y, energy = _eliminate_arm(view, active, chain, inflate)
    return Reduced(H, y, energy, view.station)


def solve(views: Sequence[Reduced], chain: Chain, active: Ints, theta_sd: Float, *, free_hand: bool = False) -> Fit:
    """Weighted least squares of B, X and theta over reduced views.

    `theta_sd` (K,) are weak priors of all columns; X is held at its prior `hand_sd` unless
    `free_hand`.
    """
    k, S = len(active), chain.stations
    size = POSE * S + POSE + k
    H, y = np.zeros((size, size)), np.zeros(size)
    energy = 0.0
    for view in views:
        at = np.concatenate([POSE * view.station + np.arange(POSE), POSE * S + np.arange(POSE + k)])
        H[np.ix_(at, at)] += view.H
        y[at] += view.y
        energy += view.energy
    prior, mean = _priors(chain, theta_sd[active], free_hand)
    H[np.diag_indices(size)] += prior
    y += prior * mean
    energy += float((prior * mean**2).sum())
    cov = np.linalg.inv(H)
    z = cov @ y
    return Fit(active, z[: POSE * S].reshape(S, POSE), z[POSE * S : POSE * (S + 1)], z[POSE * (S + 1) :], cov,
               float(energy - y @ z))


def fit(
    views: Sequence[ViewGram], chain: Chain, active: Ints, theta_sd: Float, *, inflate: float = 1.0,
    free_hand: bool = False,
) -> Fit:
    """`reduce_view` and `solve` in one."""
    reduced = [reduce_view(v, active, chain, inflate) for v in views]
    return solve(reduced, chain, active, theta_sd, free_hand=free_hand)


HAND_FREE_SD = np.array([0.05, 0.05, 0.05, 0.1, 0.1, 0.1])
"""A hand-eye error under test: anything a mount could do (50 mm, 6 degrees)."""


def _priors(chain: Chain, theta_sd: Float, free_hand: bool) -> tuple[Float, Float]:
    hand_sd = HAND_FREE_SD if free_hand else chain.hand_sd
    sd = np.concatenate([np.tile(chain.base_sd, chain.stations), hand_sd, theta_sd])
    mean = np.concatenate([-chain.base0.ravel(), -chain.hand0, np.zeros(len(theta_sd))])
    return 1.0 / sd**2, mean


def held_out_energy(view: Reduced, solution: Fit) -> float:
    """Chi-square of a view that the solution has not seen, its own A minimised under its prior."""
    z = np.concatenate([solution.base[view.station], solution.hand, solution.theta])
    return float(view.energy - 2 * view.y @ z + z @ view.H @ z)


def twist_of_view(view: ViewGram, chain: Chain, solution: Fit, *, inflate: float = 1.0) -> Float:
    """(6,) correction of the camera's pose (right perturbation) that the solution gives a view."""
    N, weight = _pieces(view, solution.active, chain)
    N = N / inflate
    g = 2 * POSE + len(solution.active)
    z = np.concatenate([solution.base[view.station], solution.hand, solution.theta])
    rhs = N[g : g + POSE, -1] - weight * view.arm0 - N[g : g + POSE, :g] @ z
    a = np.linalg.solve(N[g : g + POSE, g : g + POSE] + np.diag(weight), rhs)
    return np.asarray(view.to_base @ z[:POSE] + z[POSE : 2 * POSE] + view.to_arm @ a)


def energy_left(views: Sequence[ViewGram], chain: Chain, target: Ints, coefficients: Float, other: Ints,
                theta_sd: Float) -> tuple[float, float, float]:
    """Energies of the map C[target] @ coefficients: whole, after pose, after pose and `other`.

    The map takes the residual's place and pose (and `other`) are fitted to it: what is left is
    what the session can see of it (the scorer's separability, issue 3).
    """
    as_residual = [_map_as_residual(v, target, coefficients) for v in views]
    whole = sum(float(v.G[-1, -1]) for v in as_residual)
    none = np.zeros(0, np.int64)
    at_zero = Chain(chain.base_sd, chain.arm_sd, chain.hand_sd, np.zeros_like(chain.base0), np.zeros_like(chain.hand0))
    return (whole, fit(as_residual, at_zero, none, theta_sd).energy, fit(as_residual, at_zero, other, theta_sd).energy)


def _map_as_residual(view: ViewGram, target: Ints, coefficients: Float) -> ViewGram:
    size = len(view.G)
    M = np.eye(size)
    M[-1, -1] = 0.0
    M[POSE + target, -1] = coefficients
    return ViewGram(M.T @ view.G @ M, view.to_base, view.to_arm, np.zeros(POSE), view.station, view.n, view.weight)
