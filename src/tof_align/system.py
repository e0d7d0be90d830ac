# SPDX-License-Identifier: Apache-2.0
"""A session linearised once: poses, discrepancy and extra columns in one set of normal equations.

`SessionSystem` holds for each view the Jacobian with respect to the camera (n, 6), the residual (n,), the weights (n,), and the links
from base, arm and hand-eye to the camera; extra columns are metres of z per unit of their coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np

from tof_align.chain import Rig
from tof_align.discrepancy import LOCAL, SHARED, Basis
from tof_align.mixed import Mixed, Normal, solve
from tof_align.parts import MOTIONS, PART, stand_off
from tof_align.view_columns import columns_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from tof_align.linearise import Linearised
    from tof_align.view_columns import ViewColumns
    from tof_core.arrays import Float, Ints

FREE_PART_M = 0.005
"""Metres: size of a free part's motion, larger than usual displacements and multipath, and small enough to keep a base determined."""
R = TypeVar("R", bound=Rig)


@dataclass(frozen=True, slots=True, eq=False)
class SessionSystem(Generic[R]):
    """The linear system of a session at one state.

    rig: the state (a `Chain` for a session); views: each view's result of `linearise`; weights:
    (n,) inverse variances per view in 1/m^2 (robust, and reduced where neighbours are not
    independent); basis, sizes: the discrepancy's columns and their estimated sizes;
    theta_std: (k,) prior deviations of extra columns' coefficients, None for none.
    """

    rig: R
    views: tuple[Linearised, ...]
    weights: tuple[Float, ...]
    basis: Basis
    sizes: dict[str, float]
    theta_std: Float | None = None

    def normal(self, columns: Sequence[Float] | None = None, *, discrepancy: bool = True) -> Normal:
        """Normal equations in poses, discrepancy (if wanted) and `columns` (per view (n, k))."""
        basis = self.basis if discrepancy else None
        grams = [
            columns_of(view, basis, None if columns is None else columns[v]).gram(weight)
            for v, (view, weight) in enumerate(zip(self.views, self.weights, strict=True))
        ]
        return assemble(grams, self.rig, basis, self.theta_info(columns[0].shape[1] if columns else 0))

    @property
    def kinds(self) -> dict[str, Ints]:
        """Places of the columns of each shared kind among the session's unknowns."""
        return kinds_of(self.basis, self.rig.globals_)

    def theta_info(self, k: int) -> Float:
        """(k,) inverse prior variances of the coefficients of k extra columns."""
        return np.zeros(k) if self.theta_std is None or not k else np.asarray(self.theta_std, float) ** -2

    def solve(self, columns: Sequence[Float] | None = None, *, discrepancy: bool = True) -> Mixed:
        """Poses, discrepancy and the columns' coefficients together."""
        return solve(self.normal(columns, discrepancy=discrepancy), self.sizes if discrepancy else {})

    def camera_steps(self, answer: Mixed) -> Float:
        """(V, 6) right perturbations of the cameras by an answer."""
        return np.array([camera_step(self.rig, answer, v) for v in range(len(self.views))])

    def camera_cov(self, answer: Mixed, v: int) -> Float:
        """(6, 6) of the right perturbation of a camera, from all its links together."""
        return camera_cov(self.rig, answer, v)

    def without_each_part(self, answer: Mixed) -> Float:
        """(P, V, 6) right perturbations of the cameras if one part after the other is free to be anywhere, and so has no influence.

        The part's prior information is subtracted from the solution (Woodbury's identity), so nothing is solved again.
        """
        at = self._part_columns
        out = np.zeros((len(at), len(self.views), 6))
        for p, own in enumerate(at):
            size = answer.sizes[f"{PART}{self.basis.parts.index[p]}"]
            freed = answer.cov[np.ix_(own, own)] - np.eye(MOTIONS) / (size**-2 - FREE_PART_M**-2)
            step = -answer.cov[:, own] @ np.linalg.solve(freed, answer.x[own])
            for v in range(len(self.views)):
                shared, arm = self.rig.links(v)
                mine = step[answer.where[v]]
                out[p, v] = shared @ mine[: shared.shape[1]] - arm @ (answer.gain[v] @ mine)[: arm.shape[1]]
        return out

    @property
    def _part_columns(self) -> Ints:
        """(P, 6) places of the columns of each part among the session's unknowns."""
        parts = len(self.basis.parts.index)
        start = self.rig.globals_ + sum(self.basis.shared) - MOTIONS * parts
        return start + np.arange(MOTIONS * parts).reshape(-1, MOTIONS)

    def stand_off(self, answer: Mixed, count: int) -> tuple[Float, Float]:
        """(count,), (count,) metres: displacement of each part of the scene from its CAD, RMS along its normal, and its standard deviation."""
        parts, at = self.basis.parts, self._part_columns
        motion, cov = answer.x[at], answer.cov[at[:, :, None], at[:, None, :]]
        apart, std = np.zeros(count), np.zeros(count)
        apart[parts.index] = stand_off(parts, self.views, motion[:, :, None] * motion[:, None, :])
        std[parts.index] = stand_off(parts, self.views, cov)
        return apart, std

    def explained(self, answer: Mixed, v: int, columns: Sequence[Float] | None = None) -> Float:
        """(n,) metres of a view that discrepancy and columns explain."""
        of = columns_of(self.views[v], self.basis, None if columns is None else columns[v])
        return explained_by(of, self.rig, self.basis, answer, v)


def camera_step(rig: Rig, answer: Mixed, v: int) -> Float:
    """(6,) right perturbation of a camera by an answer."""
    shared, own = rig.links(v)
    return np.asarray(shared @ answer.x[rig.where(v)] + own @ answer.own[v, : rig.own])


def camera_cov(rig: Rig, answer: Mixed, v: int) -> Float:
    """(6, 6) of the right perturbation of a camera, from all its links together."""
    shared, own = rig.links(v)
    C = answer.joint_cov(v)
    at = np.concatenate([np.arange(shared.shape[1]), answer.where.shape[1] + np.arange(own.shape[1])])
    L = np.concatenate([shared, own], axis=1)
    return np.asarray(L @ C[np.ix_(at, at)] @ L.T)


def unmodelled(columns: ViewColumns, rig: Rig, basis: Basis, answer: Mixed, v: int) -> Float:
    """(n, kinds) metres of a view that each kind of `SHARED` and `LOCAL` explains."""
    g, o = rig.globals_, rig.own
    return columns.unmodelled(answer.x[g : g + sum(basis.shared)], answer.own[v, o : o + sum(basis.local)])


def explained_by(columns: ViewColumns, rig: Rig, basis: Basis, answer: Mixed, v: int) -> Float:
    """(n,) metres of a view that discrepancy and extra columns explain."""
    smooth = unmodelled(columns, rig, basis, answer, v).sum(axis=1)
    return np.asarray(smooth + columns.of_extra(answer.x[rig.globals_ + sum(basis.shared) :]))


def assemble(grams: Iterable[Float], rig: Rig, basis: Basis | None, theta_info: Float, shifts: Float | None = None) -> Normal:
    """Normal equations of all views: [pose, shared, columns | own pose, own | residual] in each.

    shifts (V, 6): how far the cameras moved (right perturbation) since they were linearised.
    """
    shared_sizes = basis.shared if basis is not None else ()
    local_sizes = basis.local if basis is not None else ()
    m, k, q, g = sum(shared_sizes), len(theta_info), sum(local_sizes), rig.globals_
    tail = np.arange(g, g + m + k)
    info, own_info, error, own_error = rig.prior()
    views, (shared, own) = len(own_error), (links.shape[1] for links in rig.links(0))
    moved = np.zeros((views, 6)) if shifts is None else shifts
    # Each view's products are put in their place at once: those of hundreds of columns in sixty views take a quarter of a gigabyte.
    gram = np.empty((views, *(2 * (shared + m + k + own + q + 1,))))
    for v, G in enumerate(grams):
        gram[v] = _expand(G, *rig.links(v), m + k, moved[v])
    return Normal(
        gram=gram,
        where=np.array([np.concatenate([rig.where(v), tail]) for v in range(views)]),
        info=np.concatenate([info, np.zeros(m), theta_info]),
        error=np.concatenate([error, np.zeros(m + k)]),
        own_info=np.concatenate([own_info, np.zeros(q)]),
        own_error=np.concatenate([own_error, np.zeros((views, q))], axis=1),
        kinds=kinds_of(basis, g),
        own_kinds=_indices(LOCAL, local_sizes, rig.own),
    )


def kinds_of(basis: Basis | None, start: int) -> dict[str, Ints]:
    """Places of the columns of each shared kind; every part is a kind of its own."""
    if basis is None:
        return {}
    kinds = _indices(SHARED, basis.shared, start)
    motions = kinds.pop("part", np.zeros(0, np.int64)).reshape(-1, MOTIONS)
    return kinds | {f"{PART}{index}": at for index, at in zip(basis.parts.index, motions, strict=True)}


def _indices(names: Sequence[str], sizes: Sequence[int], start: int) -> dict[str, Ints]:
    out: dict[str, Ints] = {}
    for name, size in zip(names, sizes, strict=False):
        if size:
            out[name] = np.arange(start, start + size)
        start += size
    return out


def _expand(G: Float, shared: Float, own: Float, middle: int, moved: Float) -> Float:
    """Replace the camera's six columns by those of the links, and the residual by residual - jacobian @ moved."""

    def linked(rows: Float) -> Float:
        camera = rows[:6]
        out = np.concatenate([shared.T @ camera, rows[6 : 6 + middle], own.T @ camera, rows[6 + middle :]])
        out[-1] -= moved @ camera
        return out

    return linked(linked(G).T)
