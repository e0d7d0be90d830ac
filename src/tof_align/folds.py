# SPDX-License-Identifier: Apache-2.0
"""Held-out scores: columns fitted to the views of all folds but one, judged on that one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_align.beside import held_out_beside
from tof_align.mixed import by_view

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.columns import ColumnSystem
    from tof_core.arrays import Float, Ints


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
        self._system, self._inflate = system, inflate
        names, self._fold = np.unique(folds, return_inverse=True)
        self._other = (self._fold[None, :] != np.arange(len(names))[:, None]).astype(float)

    def held_out(self, active: Ints, *, free_hand: bool = False) -> Float:
        """(V,) chi-square of each view under the fit to all views of the other folds, the view's own arm error minimised."""
        views = by_view(self._system.chosen(active, inflate=self._inflate), {})
        info, error = self._system.prior(active, free_hand=free_hand)
        H, b = views.placed(self._system.placed(len(active)), len(info))
        V, m = b.shape
        sums = (self._other @ H.reshape(V, m * m)).reshape(-1, m, m) + np.diag(info)
        right = self._other @ b - info * error
        x = np.linalg.solve(sums, right[..., None])[self._fold]
        return np.asarray(views.energy + (((H @ x)[..., 0] - 2 * b) * x[..., 0]).sum(axis=1))

    def held_out_beside(self, rest: Ints, groups: Sequence[Ints], *, free_hand: bool = False) -> Float:
        """(groups, V) as `held_out` of `rest` and each of these groups of columns, to rounding, in a small part of the time."""
        return held_out_beside(self._system, self._fold, self._inflate, rest, groups, free_hand=free_hand)
