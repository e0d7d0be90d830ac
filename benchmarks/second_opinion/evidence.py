# SPDX-License-Identifier: Apache-2.0
"""Marginal likelihood of a set of effects in closed form: the Gaussian integral over poses and coefficients, bounds included."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import log_ndtr

from tof_align.columns import HAND_EYE_FREE
from tof_align.mixed import reduce
from tof_gap.solve.hypotheses.candidate import HAND_EYE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from tof_align.columns import ColumnSystem
    from tof_core.arrays import Float, Ints
    from tof_gap.solve.hypotheses.columns import Design

VANISHES = 1e-7
"""Of a group's largest eigenvalue, what a direction must have: below, columns in single precision are alike to rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Quadratic:
    """Minus twice the log-posterior, x' H x - 2 b' x + energy, of unknowns x; their normal prior, of inverse variances `prior`, is in it."""

    H: Float
    b: Float
    energy: float
    prior: Float

    def log_integral(self, bounded: Float, low: ArrayLike, high: ArrayLike) -> float:
        """ln of the likelihood's integral over the prior, the prior cut off where `bounded` (n, x) @ x leaves [low, high].

        Exact without bounds and for one; of several, errors are taken for independent of each other.
        """
        L = np.linalg.cholesky(self.H)
        z = solve_triangular(L, self.b, lower=True, check_finite=False)
        whole = 0.5 * float(z @ z - self.energy + np.log(self.prior).sum()) - float(np.log(np.diag(L)).sum())
        if not len(bounded):
            return whole
        B = solve_triangular(L, bounded.T, lower=True, check_finite=False)
        before = np.sqrt((bounded**2 / self.prior).sum(axis=1))
        inside = log_between(low, high, B.T @ z, np.linalg.norm(B, axis=0)) - log_between(low, high, 0.0, before)
        return whole + float(inside.sum())

    def solved(self) -> tuple[Float, Float]:
        """(x,) the most probable unknowns, (x, x) their covariance."""
        cov = np.linalg.inv(self.H)
        return np.asarray(cov @ self.b), np.asarray(cov, float)


def log_between(low: ArrayLike, high: ArrayLike, mean: ArrayLike, sd: ArrayLike) -> Float:
    """ln of the probability that a normal variable lies in [low, high]."""
    a, b = np.subtract(low, mean) / sd, np.subtract(high, mean) / sd
    # Above the mean both distribution functions are near 1: the mirrored interval keeps its digits.
    a, b = np.where(a > 0, -b, a), np.where(a > 0, -a, b)
    top, bottom = log_ndtr(b), log_ndtr(a)
    return np.asarray(top + np.log1p(-np.exp(np.minimum(bottom - top, -1e-15))))


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """The columns of one candidate in coordinates whose mean square is that of its map.

    columns (k,): of the system; whitened (k, r): from coordinates to coefficients; bounded (n, r), low, high (n,): directions
    whose coefficients have bounds, and these, in the coefficients' own units.
    """

    columns: Ints
    whitened: Float
    bounded: Float
    low: Float
    high: Float

    @classmethod
    def of(cls, design: Design, member: int, mean_square: Float) -> Group:
        """A candidate's; mean_square (K, K): weighted products of all columns over the sum of weights."""
        columns = design.groups[member]
        values, vectors = np.linalg.eigh(mean_square[np.ix_(columns, columns)])
        seen = values > VANISHES * values.max(initial=0.0)
        whitened = vectors[:, seen] / np.sqrt(values[seen])
        low, high = bounds(design, member)
        has = np.flatnonzero((np.isfinite(low) | np.isfinite(high)) & whitened.any(axis=1))
        return cls(columns, whitened, whitened[has] / design.scale[columns[has], None], low[has], high[has])


def bounds(design: Design, member: int) -> tuple[Float, Float]:
    """(k,), (k,) bounds of a candidate's coefficients as the diagnosis asks them; infinite for a form without a formula."""
    effect, k = design.candidates[member].effect, len(design.groups[member])
    if effect is None or effect.free_form or len(effect.LINEAR) != k:
        return np.full(k, -np.inf), np.full(k, np.inf)
    return effect.bounds


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """A session's normal equations at one inflation of its noise, the arm's errors integrated out, every candidate whitened.

    quadratic: of [poses, columns of every hypothesis | coordinates of all candidates], the latter without a prior; base: how many
    come first; starts (candidates + 1,): where each candidate's coordinates begin; hand: which of the candidates is hand-eye, -1
    for none; hand_at: where its step stands; hand_error (6,): how far that is from its prior's mean.
    """

    design: Design
    groups: tuple[Group, ...]
    quadratic: Quadratic
    base: int
    starts: Ints
    hand: int
    hand_at: slice
    hand_error: Float

    @classmethod
    def of(cls, design: Design, inflate: float) -> Evidence:
        """Of a design, the weights of all pixels divided by `inflate`."""
        system, every = design.system, np.arange(design.system.columns)
        square = mean_square(system)
        groups = tuple(Group.of(design, m, square) for m in range(len(design.candidates)))
        whole = system.chosen(every, inflate=inflate)
        info = whole.info.copy()
        info[system.poses + np.setdiff1d(every, design.always)] = 0.0
        r = reduce(replace(whole, info=info), {})
        first = np.concatenate([np.arange(system.poses), system.poses + design.always]).astype(np.int64)
        T = np.zeros((len(r.b), len(first) + sum(g.whitened.shape[1] for g in groups)))
        T[first, np.arange(len(first))] = 1.0
        starts = len(first) + np.cumsum([0, *(g.whitened.shape[1] for g in groups)])
        for g, a, b in zip(groups, starts, starts[1:], strict=False):
            T[system.poses + g.columns, a:b] = g.whitened
        prior = np.concatenate([info[first], np.zeros(T.shape[1] - len(first))])
        hand = slice(system.poses - 6, system.poses)
        which = next((m for m, c in enumerate(design.candidates) if c.name == HAND_EYE), -1)
        quadratic = Quadratic(T.T @ r.H @ T, T.T @ r.b, r.energy, prior)
        return cls(design, groups, quadratic, len(first), starts, which, hand, whole.error[hand])

    def log_likelihood(self, members: Sequence[int], size_m: float) -> float:
        """ln of the marginal likelihood of some candidates together, the map of each `size_m` RMS a priori; up to the session's constant."""
        q, groups = self.joined(members, size_m), [self.groups[m] for m in members]
        low, high = (np.concatenate([np.zeros(0), *(getattr(g, side) for g in groups)]) for side in ("low", "high"))
        rows, start = np.zeros((len(low), len(q.b))), 0
        for g, at in zip(groups, self.places(members), strict=True):
            rows[start : start + len(g.low), at] = g.bounded
            start += len(g.low)
        return q.log_integral(rows, low, high)

    def places(self, members: Sequence[int]) -> list[slice]:
        """Where each member's coordinates stand in `joined`."""
        ends = self.base + np.cumsum([0, *(self.starts[m + 1] - self.starts[m] for m in members)])
        return [slice(int(a), int(b)) for a, b in pairwise(ends)]

    def joined(self, members: Sequence[int], size_m: float) -> Quadratic:
        """The quadratic form of poses and the members' coordinates."""
        at = np.concatenate([np.arange(self.base), *(np.arange(self.starts[m], self.starts[m + 1]) for m in members)])
        H, b, prior = self.quadratic.H[np.ix_(at, at)], self.quadratic.b[at], self.quadratic.prior[at]
        for place in self.places(members):
            prior[place] = (place.stop - place.start) / size_m**2
        diagonal = np.arange(self.base, len(at))
        H[diagonal, diagonal] += prior[self.base :]
        energy = self.quadratic.energy
        if self.hand in members:  # Its prior is as wide as any mount instead of the stated calibration.
            hand = np.arange(self.hand_at.start, self.hand_at.stop)
            change = HAND_EYE_FREE**-2.0 - prior[hand]
            H[hand, hand] += change
            b[hand] -= change * self.hand_error
            prior[hand] += change
            energy += float(change @ self.hand_error**2)
        return Quadratic(H, b, energy, prior)


def mean_square(system: ColumnSystem) -> Float:
    """(K, K) weighted products of all columns over the sum of the pixels' weights."""
    n = system.normal
    at = slice(n.shared - system.columns, n.shared)
    return np.asarray(n.gram[:, at, at].sum(axis=0) / system.weight.sum())
