# SPDX-License-Identifier: Apache-2.0
"""Held-out scores of many groups of columns, each with the same other columns, which are eliminated once for all groups.

Notation: R are the poses and the columns that all choices share, C the columns of all groups, f a fold, v a view.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_align.mixed import own_eliminated

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tof_align.columns import ColumnSystem
    from tof_core.arrays import Float, Ints


@dataclass(frozen=True, slots=True, eq=False)
class _Equations:
    """Each view's normal equations in R and C, with the view's own unknowns eliminated.

    where (V, r): places of a view's unknowns of R among all m of them; RR (V, r, r), RC (V, r, c), b_R (V, r), b_C (V, c), energy (V,).
    """

    where: Ints
    RR: Float
    RC: Float
    b_R: Float
    b_C: Float
    energy: Float


def held_out_beside(
    system: ColumnSystem, fold: Ints, inflate: float, rest: Ints, groups: Sequence[Ints], *, free_hand: bool = False
) -> Float:
    """(groups, V) chi-square of each view under the fit of poses, `rest` and one group of columns to all views of the other folds.

    fold (V,): 0, 1, ... of each view; rest (k,), groups: columns; no group is empty or has columns of `rest`. As `Folds.held_out` of `rest` with
    each group, to rounding.
    """
    c = np.concatenate(groups)
    views, products = _equations(system, inflate, rest, c, groups)
    info, error = system.prior(rest, free_hand=free_hand)
    RR, RC, b_R = _of_other_folds(views, fold, len(info))
    own_info, own_error = (a[system.poses + c] for a in (system.normal.info, system.normal.error))
    b_C = _others(views.b_C, fold) - own_info * own_error
    solved = np.linalg.solve(RR + np.diag(info), np.concatenate([RC, (b_R - info * error)[..., None]], axis=2))
    alone, moved = solved[:, :, -1], solved[:, :, :-1]  # of R: without C, and what one unit of C moves it by
    left = b_C - (RC * alone[:, :, None]).sum(axis=1)
    theta, square = np.empty_like(left), np.empty((len(fold), len(groups)))
    for which, at, of_view in products:
        reduced = _others(of_view, fold) + np.swapaxes(_blocks(RC, at), -1, -2) @ -_blocks(moved, at)
        diagonal = np.arange(at.shape[1])
        reduced[:, :, diagonal, diagonal] += own_info[at]
        theta[:, at] = np.linalg.solve(reduced, left[:, at][..., None])[..., 0]
        mine = theta[:, at][fold]
        square[:, which] = (mine * (of_view @ mine[..., None])[..., 0]).sum(axis=2)
    starts = np.cumsum([0, *(len(g) for g in groups[:-1])])
    x = (alone[:, :, None] - np.add.reduceat(moved * theta[:, None], starts, axis=2))[fold[:, None], views.where]
    mine = theta[fold]
    cross = np.add.reduceat(views.RC * mine[:, None], starts, axis=2)
    linear = np.add.reduceat(views.b_C * mine, starts, axis=1)
    of_rest = (x * (views.RR @ x + 2 * cross - 2 * views.b_R[..., None])).sum(axis=1)
    return np.asarray((views.energy[:, None] + of_rest + square - 2 * linear).T)


_Products = list[tuple["Ints", "Ints", "Float"]]
"""For each size of a group: the groups (g,), the places of their columns (g, k) in C, and their products (V, g, k, k) in each view."""


def _equations(system: ColumnSystem, inflate: float, rest: Ints, c: Ints, groups: Sequence[Ints]) -> tuple[_Equations, _Products]:
    own, gram, s = own_eliminated(system.normal, system.normal.own_info, inflate), system.normal.gram, system.normal.shared
    r, first = system.local(rest), s - system.columns
    rows = gram[:, r, :s] / inflate - np.swapaxes(own.gain[:, :, r], 1, 2) @ own.right
    products = []
    for which, at in _by_size(groups):
        mine = first + c[at]
        gain, right = (np.moveaxis(a[:, :, mine], 1, 2) for a in (own.gain, own.right))
        products.append((which, at, gram[:, mine[:, :, None], mine[:, None, :]] / inflate - np.swapaxes(gain, 2, 3) @ right))
    b = own.b
    return _Equations(system.placed(len(rest)), rows[:, :, r], rows[:, :, first + c], b[:, r], b[:, first + c], own.energy), products


def _by_size(groups: Sequence[Ints]) -> Iterator[tuple[Ints, Ints]]:
    """For each size: its groups (g,), and the places of their columns (g, k) among those of all."""
    sizes = np.array([len(g) for g in groups])
    starts = np.cumsum(sizes) - sizes
    for size in np.unique(sizes):
        which = np.flatnonzero(sizes == size)
        yield which, starts[which][:, None] + np.arange(size)


def _blocks(rows: Float, at: Ints) -> Float:
    """(f, g, m, k) the columns `at` (g, k) of rows (f, m, c)."""
    return np.ascontiguousarray(np.moveaxis(rows[:, :, at], 1, 2))


def _others(of_view: Float, fold: Ints) -> Float:
    """(f, ...) sums over the views of all folds but f."""
    other = (fold[None, :] != np.arange(fold.max() + 1)[:, None]).astype(float)
    return np.asarray((other @ of_view.reshape(len(fold), -1)).reshape(-1, *of_view.shape[1:]))


def _of_other_folds(views: _Equations, fold: Ints, m: int) -> tuple[Float, Float, Float]:
    """RR (f, m, m), RC (f, m, c), b (f, m): sums over the views of all folds but f, at their places among the m unknowns."""
    folds = int(fold.max()) + 1
    RR, RC, b = np.zeros((folds, m, m)), np.zeros((folds, m, views.RC.shape[2])), np.zeros((folds, m))
    for v, f in enumerate(fold):
        at = views.where[v]
        RR[f][at[:, None], at] += views.RR[v]
        RC[f][at] += views.RC[v]
        b[f][at] += views.b_R[v]
    RR, RC, b = (a.sum(axis=0) - a for a in (RR, RC, b))
    return RR, RC, b
