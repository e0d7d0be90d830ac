# SPDX-License-Identifier: Apache-2.0
"""Held-out scores: columns fitted to the views of all folds but one, judged on that one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_align.mixed import by_view, joined

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.columns import ColumnSystem
    from tof_align.mixed import ByView
    from tof_core.arrays import Float, Ints

BLOCK = 8
"""Views whose normal equations are eliminated together."""
OFTEN = 20
"""Choices of columns from which eliminating the arm's errors beside all columns at once costs less: each choice only takes its rows then."""


def deal(stations: Sequence[int], folds: int) -> Ints:
    """(V,) fold of each view: dealt in turn within each station; every fold leaves every station some views."""
    out = np.zeros(len(stations), np.int64)
    offset = 0
    for s in sorted(set(stations)):
        index = np.flatnonzero(np.asarray(stations) == s)
        out[index] = (np.arange(len(index)) + offset) % min(folds, len(stations))
        offset += len(index)
    return out


class Folds:
    """A system dealt into folds, for held-out scores of many choices of columns."""

    def __init__(self, system: ColumnSystem, folds: Ints, inflate: float = 1.0) -> None:
        """`folds` (V,) as `deal` gives them; `inflate` divides the data's weight, as in `ColumnSystem.chosen`."""
        self._system, self._inflate, self._asked = system, inflate, 0
        self._whole: list[ByView] = []
        names, self._fold = np.unique(folds, return_inverse=True)
        self._other = (self._fold[None, :] != np.arange(len(names))[:, None]).astype(float)

    def held_out(self, active: Ints, *, free_hand: bool = False) -> Float:
        """(V,) chi-square of each view under the fit to all views of the other folds, the view's own arm error minimised."""
        self._asked += 1
        few = self._asked < OFTEN
        views = by_view(self._system.chosen(active, inflate=self._inflate), {}) if few else self._rows(active)
        info, error = self._system.prior(active, free_hand=free_hand)
        H, b = views.placed(self._system.placed(len(active)), len(info))
        V, m = b.shape
        sums = (self._other @ H.reshape(V, m * m)).reshape(-1, m, m) + np.diag(info)
        right = self._other @ b - info * error
        x = np.linalg.solve(sums, right[..., None])[self._fold]
        return np.asarray(views.energy + (((H @ x)[..., 0] - 2 * b) * x[..., 0]).sum(axis=1))

    def _rows(self, active: Ints) -> ByView:
        """Of the elimination beside all columns, the rows of poses and of `active`."""
        if not self._whole:  # Some views at a time: the products of all columns are copied twice on the way.
            every, views = np.arange(self._system.columns), np.arange(len(self._fold))
            some = (self._system.subset(views[start : start + BLOCK].tolist()) for start in views[::BLOCK])
            self._whole = [by_view(system.chosen(every, inflate=self._inflate), {}) for system in some]
        at = self._system.local(active)
        return joined([views.of(at) for views in self._whole])
