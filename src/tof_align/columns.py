# SPDX-License-Identifier: Apache-2.0
"""A session linearised once with many extra columns; any choice of them is fitted without rendering again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_align.discrepancy import shared_inflation
from tof_align.mixed import solve
from tof_align.system import assemble, camera_cov

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from tof_align.chain import Chain
    from tof_align.mixed import Mixed, Normal
    from tof_core.arrays import Float, Ints

HAND_EYE_FREE = np.repeat([0.05, 0.1], 3)
"""Prior deviations (m, rad) of a hand-eye error under test: the largest of a mount (50 mm, 6 degrees)."""


@dataclass(frozen=True, slots=True, eq=False)
class Priors:
    """Prior deviations (6,) of bases and of hand-eye; at_chain: whether the bases' prior is centred on the chain, not on the robot's."""

    base: Float
    hand_eye: Float
    at_chain: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class ColumnFit:
    """A solution with some columns.

    active (k,): the columns; answer: poses and coefficients; poses: number of unknowns of bases and hand-eye in the answer.
    """

    active: Ints
    answer: Mixed
    poses: int

    @property
    def base(self) -> Float:
        """(S, 6) steps of the stations' bases."""
        return self.answer.x[: self.poses - 6].reshape(-1, 6)

    @property
    def hand_eye(self) -> Float:
        """(6,) step of hand-eye."""
        return self.answer.x[self.poses - 6 : self.poses]

    @property
    def hand_eye_cov(self) -> Float:
        """(6, 6) covariance of that step."""
        at = slice(self.poses - 6, self.poses)
        return self.answer.cov[at, at]

    @property
    def theta(self) -> Float:
        """(k,) coefficients of the active columns."""
        return self.answer.x[self.poses :]

    @property
    def theta_cov(self) -> Float:
        """(k, k) covariance of the coefficients."""
        return self.answer.cov[self.poses :, self.poses :]

    @property
    def arm(self) -> Float:
        """(V, 6) steps of the arm's own errors."""
        return self.answer.own

    def moved(self, chain: Chain) -> Chain:
        """The chain after the solution's steps of bases, hand-eye and every arm error."""
        return chain.moved(self.answer.x[: self.poses], self.arm)

    @property
    def energy(self) -> float:
        """Chi-square of the residual, priors included."""
        return self.answer.energy


@dataclass(frozen=True, slots=True, eq=False)
class ColumnSystem:
    """Normal equations of V views in poses and K columns.

    chain: the poses of linearisation; normal: [base 6 | hand-eye 6 | columns K | arm 6 | residual] in each view, with all columns;
    columns: K; pixels (V,): number of independent pixels used; weight (V,): sums of their 1 / sigma^2; drawn (V,): number of pixels used.
    """

    chain: Chain
    normal: Normal
    columns: int
    pixels: Float
    weight: Float
    drawn: Float

    @classmethod
    def of(
        cls, grams: Iterable[Float], chain: Chain, theta_sd: Float, priors: Priors, pixels: Float, weight: Float, drawn: Float
    ) -> ColumnSystem:
        """From each view's weighted products (p, p) of [camera 6 | columns K | residual]; theta_sd (K,): the coefficients' prior deviations."""
        normal = assemble(grams, chain, None, theta_sd**-2.0)
        info, error, g = normal.info.copy(), normal.error.copy(), chain.globals_
        info[: g - 6] = np.tile(priors.base**-2.0, len(chain.names))
        info[g - 6 : g] = priors.hand_eye**-2.0
        if priors.at_chain:
            error[: g - 6] = 0.0
        return cls(chain, replace(normal, info=info, error=error), len(theta_sd), pixels, weight, drawn)

    @property
    def poses(self) -> int:
        """Number of unknowns of bases and hand-eye in the normal equations."""
        return int(self.normal.info.size) - self.columns

    @property
    def sigma(self) -> float:
        """Metres: noise of a typical pixel."""
        return float(np.sqrt(self.pixels.sum() / self.weight.sum()))

    def products(self, columns: Ints) -> Float:
        """(k, k) weighted products of columns over all views: of coefficients x, x @ products @ x is the chi-square of their map."""
        at = self.normal.shared - self.columns + columns
        return np.asarray(self.normal.gram[:, at[:, None], at].sum(axis=0))

    def chosen(self, active: Ints, *, inflate: float = 1.0, free_hand: bool = False) -> Normal:
        """The normal equations with the columns `active` alone.

        inflate: divides the weight of the data, since errors that neighbours share count once; free_hand: whether hand-eye is under test.
        """
        n = self.normal
        take = np.concatenate([self.local(active), np.arange(n.shared, n.gram.shape[1])])
        info, error = self.prior(active, free_hand=free_hand)
        return replace(n, gram=n.gram[:, take[:, None], take] / inflate, where=self.placed(len(active)), info=info, error=error)

    def prior(self, active: Ints, *, free_hand: bool = False) -> tuple[Float, Float]:
        """(g,), (g,) inverse prior variances of poses and of the columns `active`, and deviation of the state from the prior's mean."""
        at = np.concatenate([np.arange(self.poses), self.poses + active]).astype(np.int64)
        info = self.normal.info[at]
        if free_hand:
            info[self.poses - 6 : self.poses] = HAND_EYE_FREE**-2.0
        return info, self.normal.error[at]

    def mount_chi2(self, fit: ColumnFit) -> float:
        """Chi-square of a solution's hand-eye against its prior."""
        at = slice(self.poses - 6, self.poses)
        return float((self.normal.error[at] + fit.hand_eye) ** 2 @ self.normal.info[at])

    def local(self, active: Ints) -> Ints:
        """Places of poses and of the columns `active` among a view's shared unknowns."""
        pose = self.normal.shared - self.columns
        return np.concatenate([np.arange(pose), pose + active]).astype(np.int64)

    def placed(self, k: int) -> Ints:
        """(V, s) places of each view's shared unknowns among the session's, with k columns chosen."""
        pose = self.normal.where[:, : self.normal.shared - self.columns]
        return np.concatenate([pose, np.broadcast_to(self.poses + np.arange(k), (len(pose), k))], axis=1)

    def fit(self, active: Ints, *, inflate: float = 1.0, free_hand: bool = False) -> ColumnFit:
        """Poses and the coefficients of some columns over all views."""
        return ColumnFit(active, solve(self.chosen(active, inflate=inflate, free_hand=free_hand), {}), self.poses)

    def inflation(self, active: Ints, neighbours: float, *, free_hand: bool = False) -> float:
        """Factor that divides the weight of the data, since errors that neighbours share count once (`discrepancy.shared_inflation`).

        Where `neighbours` drawn pixels share noise, too, they are fewer independent ones.
        """
        independent = float(self.pixels.sum())
        share = neighbours * independent / max(float(self.drawn.sum()), 1.0)
        return shared_inflation(self.fit(active, free_hand=free_hand).energy, independent, max(share, 1.0))

    def subset(self, views: Sequence[int]) -> ColumnSystem:
        """The system of some views only; all stations stay."""
        at, n = np.asarray(views, np.int64), self.normal
        normal = replace(n, gram=n.gram[at], where=n.where[at], own_error=n.own_error[at])
        return replace(
            self, chain=self.chain.subset(views), normal=normal, pixels=self.pixels[at], weight=self.weight[at], drawn=self.drawn[at]
        )

    def fit_to(self, views: Sequence[int], solution: ColumnFit, *, inflate: float, free_hand: bool) -> ColumnFit:
        """The columns of a solution fitted again to some views, with the bases held at the solution's.

        With free bases, coefficients of some views alone would correlate with a base and not fit the solution's poses.
        """
        part, b = self.subset(views), self.poses - 6
        info, error = part.normal.info.copy(), part.normal.error.copy()
        info[:b], error[:b] = BASE_HELD_M**-2.0, -solution.base.ravel()
        held = replace(part, normal=replace(part.normal, info=info, error=error))
        return held.fit(solution.active, inflate=inflate, free_hand=free_hand)

    def camera_covs(self, solution: ColumnFit) -> Float:
        """(V, 6, 6) covariance of each camera's right perturbation."""
        return np.stack([camera_cov(self.chain, solution.answer, v) for v in range(len(self.pixels))])

    def with_free_distances(self) -> ColumnSystem:
        """The same system with every view free along its optical axis, for chains whose poses have a covariance each."""
        root, n, s = self.chain.root, self.normal, self.normal.shared
        assert root is not None
        along = np.zeros((6, 6))
        along[2, 2] = DISTANCE_FREE_M**2
        wider: Float = np.linalg.cholesky(root @ np.swapaxes(root, 1, 2) + along).astype(np.float64)
        ratio = np.linalg.solve(root, wider)
        gram, own = n.gram.copy(), slice(s, s + 6)
        gram[:, own] = np.swapaxes(ratio, 1, 2) @ gram[:, own]
        gram[:, :, own] = gram[:, :, own] @ ratio
        error: Float = np.linalg.solve(ratio, n.own_error[..., None])[..., 0].astype(np.float64)
        return replace(self, chain=replace(self.chain, root=wider), normal=replace(n, gram=gram, own_error=error))

    def left_of(self, target: Ints, coefficients: Float, others: Ints, *, inflate: float = 1.0, free_hand: bool = False) -> float:
        """Chi-square of the map C[target] @ coefficients that poses and the columns `others` cannot explain.

        The map replaces the residual, and poses and columns are fitted to it: the rest is the part of the map that the session can see.
        """
        n, mine = self.normal, self.normal.shared - self.columns + target
        whole = self.chosen(others, free_hand=free_hand)
        take = np.concatenate([self.local(others), np.arange(n.shared, n.gram.shape[1] - 1)])
        gram = whole.gram.copy()
        gram[:, :-1, -1] = gram[:, -1, :-1] = n.gram[:, take[:, None], mine] @ coefficients
        gram[:, -1, -1] = np.einsum("i,vij,j->v", coefficients, n.gram[:, mine[:, None], mine], coefficients)
        at_zero = replace(whole, gram=gram / inflate, error=np.zeros_like(whole.error), own_error=np.zeros_like(whole.own_error))
        return solve(at_zero, {}).energy * inflate


DISTANCE_FREE_M = 0.1
"""Prior deviation of a view's distance that is free: no camera's error is larger."""
BASE_HELD_M = 1e-7
"""Prior deviation (m, rad) of a base that is held: a millionth of what any camera resolves."""
