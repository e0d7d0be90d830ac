# SPDX-License-Identifier: Apache-2.0
"""The linear mixed model of a session: unknowns that all views share, unknowns of each view, and sizes (prior deviations) of both.

Each view has normal equations in the order [shared unknowns | own unknowns | residual]. Own unknowns are eliminated view by view (Schur
complement); the rest is one small dense system. Prior deviations that are to be estimated follow from MacKay's fixed point on the
marginal likelihood, size^2 = |u|^2 / (n - trace(C) / size^2), with `DOUBT` added to n.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tof_core.arrays import Float, Ints


SETTLED = 0.02
"""Change of ln size in a round below which the estimate ends."""
LITTLE = 0.05
"""Share of a kind's coefficients that the data determine below which the fixed point overshoots."""
DOUBT = 1.0
"""Coefficients of value zero that are added to every kind: one view's single offset is no evidence that cameras drift."""


@dataclass(frozen=True, slots=True, eq=False)
class Alike:
    """Views (k,) whose shared columns stand at the same places (s,) among the globals (those of one station), and the sum (s, s) of their products."""

    where: Ints
    views: Ints
    gram: Float


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations of V views.

    gram (V, p, p) with p = s + o + 1: weighted products of [shared | own | residual] columns;
    where (V, s): places of each view's shared columns among the G global unknowns;
    info (G,), own_info (o,): inverse prior variances of unknowns with a fixed prior, 0 elsewhere;
    error (G,), own_error (V, o): deviation of the present state from the prior's mean;
    kinds: name -> indices among the global unknowns; own_kinds: the same among a view's own.
    """

    gram: Float
    where: Ints
    info: Float
    own_info: Float
    error: Float
    own_error: Float
    kinds: dict[str, Ints] = field(default_factory=dict)
    own_kinds: dict[str, Ints] = field(default_factory=dict)

    @property
    def shared(self) -> int:
        """Shared columns per view."""
        return int(self.where.shape[1])

    @cached_property
    def alike(self) -> tuple[Alike, ...]:
        """The views by the places of their columns: whatever the sizes, their products are summed once."""
        return tuple(Alike(at, mine, self.gram[mine, : len(at), : len(at)].sum(axis=0)) for at, mine in _alike(self.where))


@dataclass(frozen=True, slots=True, eq=False)
class Mixed:
    """The answer: x (G,), own (V, o), cov (G, G), sizes per kind.

    gain (V, o, s) and own_cov (V, o, o): own = own0 - gain @ shared, and the covariance of own
    given shared. energy: chi-square of the residual.
    """

    x: Float
    own: Float
    cov: Float
    gain: Float
    own_cov: Float
    where: Ints
    sizes: dict[str, float]
    energy: float

    def joint_cov(self, view: int) -> Float:
        """Covariance (s + o, s + o) of a view's shared and own unknowns."""
        C = self.cov[np.ix_(self.where[view], self.where[view])]
        F = self.gain[view]
        cross = -C @ F.T
        return np.block([[C, cross], [cross.T, self.own_cov[view] + F @ C @ F.T]])


@dataclass(frozen=True, slots=True, eq=False)
class ByView:
    """Each view's normal equations in the shared unknowns, with its own eliminated.

    H (V, s, s), b (V, s), energy (V,): with the priors of the view's own unknowns, without those of the shared ones.
    own0 (V, o), gain (V, o, s), own_cov (V, o, o): the own unknowns follow as own = own0 - gain @ shared.
    """

    H: Float
    b: Float
    energy: Float
    own0: Float
    gain: Float
    own_cov: Float

    def placed(self, where: Ints, count: int) -> tuple[Float, Float]:
        """(V, G, G), (V, G): every view's equations at their places `where` (V, s) among `count` unknowns."""
        views = np.arange(len(where))
        H, b = np.zeros((len(where), count, count)), np.zeros((len(where), count))
        H[views[:, None, None], where[:, :, None], where[:, None, :]] = self.H
        b[views[:, None], where] = self.b
        return H, b


@dataclass(frozen=True, slots=True, eq=False)
class Own:
    """Intermediate results of the elimination: right (V, o, s), products of own with shared columns; the others as in `ByView`."""

    right: Float
    gain: Float
    own_cov: Float
    own0: Float
    b: Float
    energy: Float


@dataclass(frozen=True, slots=True, eq=False)
class Reduced:
    """The session's normal equations, with every view's own unknowns eliminated.

    H (G, G), b (G,): with the priors; energy: chi-square with all global unknowns zero; own: the equations of each view.
    """

    H: Float
    b: Float
    energy: float
    own: Own


def own_eliminated(normal: Normal, prior: Float, inflate: float = 1.0) -> Own:
    """Eliminate each view's own unknowns with inverse prior variances (o,), up to the products of shared columns; inflate divides all."""
    s, o, K = normal.shared, normal.own_info.size, normal.gram
    right, residual = K[:, s : s + o, :s] / inflate, K[:, :, -1] / inflate
    own_cov = np.asarray(np.linalg.inv(K[:, s : s + o, s : s + o] / inflate + np.diag(prior)), float)
    own_right = residual[:, s : s + o] - prior * normal.own_error
    own0 = np.einsum("vij,vj->vi", own_cov, own_right)
    return Own(
        right=right,
        gain=own_cov @ right,
        own_cov=own_cov,
        own0=own0,
        b=residual[:, :s] - np.einsum("vji,vj->vi", right, own0),
        energy=residual[:, -1] + (prior * normal.own_error**2).sum(axis=1) - (own_right * own0).sum(axis=1),
    )


def by_view(normal: Normal, sizes: dict[str, float]) -> ByView:
    """Eliminate each view's own unknowns (Schur complement), for given sizes in metres."""
    s, own = normal.shared, _eliminated(normal, sizes)
    H = normal.gram[:, :s, :s] - np.swapaxes(own.gain, 1, 2) @ own.right
    return ByView(H, own.b, own.energy, own.own0, own.gain, own.own_cov)


def _eliminated(normal: Normal, sizes: dict[str, float]) -> Own:
    """Each view's own unknowns eliminated, for given sizes in metres."""
    return own_eliminated(normal, _with_sizes(normal.own_info, normal.own_kinds, sizes))


def _with_sizes(info: Float, kinds: dict[str, Ints], sizes: dict[str, float]) -> Float:
    """Inverse prior variances, those of each kind by its size."""
    prior = info.copy()
    for kind, size in sizes.items():
        if kind in kinds:
            prior[kinds[kind]] = size**-2
    return prior


def reduce(normal: Normal, sizes: dict[str, float]) -> Reduced:
    """Eliminate each view's own unknowns, and sum the equations in the shared ones."""
    own, prior = _eliminated(normal, sizes), _with_sizes(normal.info, normal.kinds, sizes)
    H, b = _scatter(normal, own)
    H += np.diag(prior)
    b -= prior * normal.error
    return Reduced(H, b, float(own.energy.sum() + (prior * normal.error**2).sum()), own)


def solve(normal: Normal, sizes: dict[str, float], pull: tuple[Float, Float] | None = None) -> Mixed:
    """The most probable unknowns for given sizes (metres) of the discrepancy's kinds.

    `pull` adds information (G, G) and a right side (G,) about the globals.
    """
    r = reduce(normal, sizes)
    H, b = (r.H, r.b) if pull is None else (r.H + pull[0], r.b + pull[1])
    cov, x = _solve(H, b)
    own = r.own.own0 - np.einsum("vij,vj->vi", r.own.gain, x[normal.where])
    return Mixed(x, own, cov, r.own.gain, r.own.own_cov, normal.where, dict(sizes), float(r.energy - b @ x))


def _scatter(normal: Normal, own: Own) -> tuple[Float, Float]:
    """Sums (G, G), (G,) of the views' equations; for views at the same places (of one station) one product eliminates what is their own."""
    G, s = normal.info.size, normal.shared
    H, b = np.zeros((G, G)), np.zeros(G)
    for one in normal.alike:
        gain, right = (a[one.views].reshape(-1, s) for a in (own.gain, own.right))
        H[one.where[:, None], one.where] += one.gram - gain.T @ right
        b[one.where] += own.b[one.views].sum(axis=0)
    return H, b


def _alike(where: Ints) -> list[tuple[Ints, Ints]]:
    """Places (s,) that views share, and those views."""
    views: dict[tuple[int, ...], list[int]] = {}
    for view, places in enumerate(where.tolist()):
        views.setdefault(tuple(places), []).append(view)
    return [(np.array(at), np.array(mine)) for at, mine in sorted(views.items())]


def _solve(H: Float, b: Float) -> tuple[Float, Float]:
    """Inverse and solution, with a unit diagonal so that metres and radians are of one order; ridge 1e-12."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-30))
    scaled = H * scale[:, None] * scale + 1e-12 * np.eye(len(H))
    cov = _inverse(scaled) * scale[:, None] * scale
    cov = 0.5 * (cov + cov.T)
    return cov, cov @ b


def _inverse(H: Float) -> Float:
    """Inverse by Cholesky's factor, in half the time of `numpy.linalg.inv`, which is used where rounding leaves H indefinite."""
    from scipy.linalg.lapack import dpotrf, dpotri

    factor, wrong = dpotrf(H, lower=1)
    if wrong:
        return np.asarray(np.linalg.inv(H))
    inverse, _ = dpotri(factor, lower=1)
    return np.asarray(np.tril(inverse) + np.tril(inverse, -1).T)


def estimate(
    normal: Normal,
    sizes: dict[str, float],
    *,
    rounds: int,
    low: Mapping[str, float],
    high: float,
    pull: tuple[Float, Float] | None = None,
) -> Mixed:
    """Solve, with the sizes (metres, between `low` of each kind and `high`) of maximum marginal likelihood."""
    answer = solve(normal, sizes, pull)
    for _ in range(rounds if sizes else 0):
        own = _own_variance(normal, answer)
        new = {kind: float(np.clip(_size(normal, answer, kind, own), low[kind], high)) for kind in answer.sizes}
        still = all(abs(np.log(new[k] / answer.sizes[k])) < SETTLED for k in new)
        answer = solve(normal, new, pull)
        if still:
            break
    return answer


def _size(normal: Normal, answer: Mixed, kind: str, own: Float) -> float:
    """One fixed-point step for one kind; own (V, o): marginal variances of the views' own unknowns."""
    variance = answer.sizes[kind] ** 2
    if kind in normal.kinds:
        at = normal.kinds[kind]
        square = float((answer.x[at] ** 2).sum())
        posterior = float(np.diag(answer.cov)[at].sum())
        count = len(at)
    else:
        at = normal.own_kinds[kind]
        square = float((answer.own[:, at] ** 2).sum())
        posterior = float(own[:, at].sum())
        count = len(at) * len(answer.own)
    learnt = count - posterior / variance
    # EM's step where the data determine little: it is slower but never overshoots.
    if learnt < LITTLE * count:
        return float(np.sqrt((square + posterior) / (count + DOUBT)))
    return float(np.sqrt(square / (learnt + DOUBT)))


def _own_variance(normal: Normal, answer: Mixed) -> Float:
    """(V, o) marginal variances of the views' own unknowns."""
    variance = np.diagonal(answer.own_cov, axis1=1, axis2=2).copy()
    for one in normal.alike:
        gain = answer.gain[one.views].reshape(-1, normal.shared)
        variance[one.views] += np.einsum("ij,ij->i", gain @ answer.cov[one.where[:, None], one.where], gain).reshape(len(one.views), -1)
    return variance
