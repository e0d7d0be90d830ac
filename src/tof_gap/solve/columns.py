# SPDX-License-Identifier: Apache-2.0
"""Columns of all hypotheses on the drawn pixels, reduced to one linear system."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_align.columns import ColumnSystem, Priors
from tof_core.cores import in_threads
from tof_gap.seen.pattern import pattern_columns
from tof_gap.solve.candidates import moving
from tof_gap.solve.free import Unknown, unknown_columns
from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.geometry import pose_columns

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tof_align.chain import Chain
    from tof_core.arrays import Float, Ints
    from tof_gap.seen.residual import ViewEvidence
    from tof_gap.solve.candidates import Candidate
    from tof_sensor.effect import Effect

COLUMN_SD_M = 0.05
"""Weak prior of a coefficient: a column of unit RMS may reach 50 mm."""
DEVIATION_SD_M = 0.008
"""The same for each of a part's nine ways to deviate: together they may not bend what one view saw."""
DEVIATION_SD = np.repeat([0.02, 0.1, 0.02], 3)
"""What each of the nine may reach by itself (m, rad, m of bow): a slide along its own plane moves no pixel, and would reach anything."""


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """All hypotheses of a session over one linear system.

    `groups[i]` are the columns of candidate i, scaled to unit RMS over the session; a coefficient
    in its own unit is theta / scale[column].
    """

    candidates: tuple[Candidate, ...]
    groups: tuple[Ints, ...]
    scale: Float
    system: ColumnSystem

    def placed(self, members: Sequence[int]) -> Iterator[tuple[Effect | None, Ints, slice]]:
        """Of each member its effect, its columns, and where its coefficients stand in a solution of all members."""
        start = 0
        for member in members:
            group = self.groups[member]
            yield self.candidates[member].effect, group, slice(start, start + len(group))
            start += len(group)


class ColumnStore:
    """Columns by view and effect, kept while the reference poses stay."""

    def __init__(self, views: Sequence[ViewEvidence], folds: Ints) -> None:
        """Nothing computed yet; `folds` (V,) as the selection deals the views."""
        self.views = views
        self._folds = folds
        self._thinned = [v.frame.take(v.pixels) for v in views]
        self._kept: dict[Effect | None, list[Float]] = {}

    def of(self, effects: Sequence[Effect | None]) -> list[list[Float]]:
        """(n, k) per effect and view; no column for hand-eye (None), whose columns the pose has."""
        missing = [e for e in dict.fromkeys(effects) if e not in self._kept]
        by_view = in_threads(lambda v: [self._columns(e, v) for e in missing], range(len(self.views)))
        self._kept |= dict(zip(missing, map(list, zip(*by_view, strict=True)), strict=True))
        return [self._kept[e] for e in effects]

    def _columns(self, effect: Effect | None, v: int) -> Float:
        view = self.views[v]
        if effect is None:
            return np.zeros((len(view.pixels), 0))
        if isinstance(effect, FixedPattern):
            return pattern_columns(self.views, v, self._folds, effect.order)
        if isinstance(effect, Unknown):
            return unknown_columns(effect, view)
        if effect.LOCAL:
            return np.asarray(effect.columns(self._thinned[v])[0])
        return effect.columns_at(view.frame, view.pixels)


PINNED_SD = np.repeat([3e-3, np.radians(0.2)], 3)
"""How far the base of a moving session may be from where edges put it: smear shifts them by millimetres, and is given up to ask for effects."""


def build(store: ColumnStore, tested: Sequence[Candidate], chain: Chain, hand_sd: Float) -> Design:
    """One system of all hypotheses, linearised at `chain`; `hand_sd` (6,) holds X where it is not freed.

    The bases of a moving session stay by the chain's, and not by the robot's word.
    """
    nothing, *by_candidate = store.of([None, *(c.effect for c in tested)])
    ends = np.cumsum([0, *(columns[0].shape[1] for columns in by_candidate)])
    groups = tuple(np.arange(a, b) for a, b in itertools.pairwise(ends))
    C = [np.concatenate([nothing[v], *(columns[v] for columns in by_candidate)], axis=1) for v in range(len(store.views))]
    total = sum(len(c) for c in C)
    scale = np.sqrt(sum((np.einsum("nk,nk->k", c, c) for c in C), np.zeros(C[0].shape[1])) / total)
    live = scale > 1e-12
    safe = np.where(live, scale, 1.0)
    in_motion = moving(store.views)
    base_sd = np.minimum(chain.priors.base, PINNED_SD) if in_motion else chain.priors.base
    system = ColumnSystem.of(
        in_threads(lambda view, c: _gram(view, c / safe), store.views, C),
        chain,
        # A column that vanishes everywhere is pinned: it explains nothing.
        np.where(live, _column_sd(tested, groups, safe), 1e-9),
        Priors(base_sd, hand_sd, at_chain=in_motion),
        pixels=np.array([float(len(v.pixels)) for v in store.views]),
        weight=np.array([float((v.sigma.ravel()[v.pixels] ** -2).sum()) for v in store.views]),
    )
    return Design(tuple(tested), groups, safe, system)


def _column_sd(tested: Sequence[Candidate], groups: Sequence[Ints], scale: Float) -> Float:
    sd = [
        np.minimum(DEVIATION_SD_M, DEVIATION_SD * scale[g]) if isinstance(c.effect, CadDeviation) else np.full(len(g), COLUMN_SD_M)
        for c, g in zip(tested, groups, strict=True)
    ]
    return np.concatenate([np.zeros(0), *sd])


def _gram(view: ViewEvidence, C: Float) -> Float:
    """Weighted products of [camera 6 | C | residual], each row weighted by 1 / sigma."""
    J = pose_columns(view.frame.take(view.pixels))[0]
    X = np.concatenate([J, C, view.residual.ravel()[view.pixels, None]], axis=1)
    X /= view.sigma.ravel()[view.pixels][:, None]
    return np.asarray(X.T @ X)
