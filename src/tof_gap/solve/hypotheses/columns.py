# SPDX-License-Identifier: Apache-2.0
"""Columns of all hypotheses on the drawn pixels, reduced to one linear system."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from tof_align.columns import ColumnSystem, Priors
from tof_align.folds import deal
from tof_core.cores import in_blocks, in_threads
from tof_gap.seen.evidence.areas import area_maps_of_others
from tof_gap.seen.evidence.motion import moving
from tof_gap.seen.evidence.pattern import line_means_of_others, pattern_columns
from tof_gap.solve.hypotheses.candidate import Candidate
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.effects.intrinsics import CONVERSIONS, STATED_LENS, Intrinsics
from tof_sensor.geometry import pose_columns

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from tof_align.chain import Chain
    from tof_core.arrays import Float, Image, Ints
    from tof_gap.seen.evidence.pattern import LineMeans
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.solve.hypotheses.nameless import Nameless
    from tof_sensor.effect import Effect

FREE_SD_M = 0.05
"""Weak prior of a free function's coefficient: a column of unit RMS may reach 50 mm. An effect states its own (`Effect.prior_sd`)."""


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """All hypotheses of a session in one linear system.

    groups[i]: columns of candidate i, scaled to unit RMS over the session, so that a coefficient in its own unit is
    theta / scale[column]; always: columns that every hypothesis contains, those of the lens within its stated calibration; by_true_lens: the same of a
    camera that converts with its true lens, which hypotheses with such a lens contain instead. Both parts of a lens have one form then.
    """

    candidates: tuple[Candidate, ...]
    groups: tuple[Ints, ...]
    scale: Float
    system: ColumnSystem
    always: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    by_true_lens: Ints = field(default_factory=lambda: np.zeros(0, np.int64))

    def form(self, members: Iterable[int]) -> Intrinsics:
        """The form of the calibrated lens in a hypothesis of these members: that of its wrong lens, if it has one."""
        lenses = (self.candidates[m].effect for m in members)
        return Intrinsics(z_from=next((lens.z_from for lens in lenses if isinstance(lens, Intrinsics)), STATED_LENS))

    def lens(self, members: Iterable[int]) -> Ints:
        """The columns of the calibrated lens in a hypothesis of these members: `always`, or `by_true_lens`."""
        return self.always if self.form(members).z_from == STATED_LENS else self.by_true_lens

    def active(self, members: Iterable[int]) -> Ints:
        """Columns of a hypothesis: those of `lens`, then those of its members."""
        own = tuple(members)
        return np.concatenate([self.lens(own), *(self.groups[m] for m in own)]).astype(np.int64)

    def own(self, members: Iterable[int]) -> Ints:
        """Columns of these candidates alone."""
        return np.concatenate([np.zeros(0, np.int64), *(self.groups[m] for m in members)]).astype(np.int64)

    def without(self, members: Iterable[int], name: str) -> list[int]:
        """The members with another name than `name`."""
        return [m for m in members if self.candidates[m].name != name]

    def placed(self, members: Sequence[int]) -> Iterator[tuple[Candidate, Ints, slice]]:
        """For each member, its candidate, its columns, and the place of its coefficients in a solution of all members."""
        start = len(self.always)
        for member in members:
            group = self.groups[member]
            yield self.candidates[member], group, slice(start, start + len(group))
            start += len(group)


class ColumnStore:
    """Columns by view and effect, kept while the reference poses stay; what a copy computes is freed with the copy."""

    def __init__(self, views: Sequence[ViewEvidence], folds: Ints) -> None:
        """An empty store; folds (V,): fold of each view in the selection."""
        self.views = views
        self.folds = folds
        self._thinned = [v.frame.take(v.pixels) for v in views]
        self._lines: list[LineMeans] = []
        self._areas: list[Float] = []
        self._kept: dict[Effect | Nameless | None, list[Image]] = {}
        self._squares: dict[Effect | Nameless | None, Float] = {}

    def of(self, tested: Sequence[Candidate]) -> list[list[Image]]:
        """(n, k) per candidate and view; none for hand-eye, whose columns are those of the pose.

        In single precision: hundreds of columns of all views are most of a long session's memory, and forms are known to 1 %.
        """
        missing = {c.source: c for c in tested if c.source not in self._kept}
        if not self._lines and any(isinstance(c.effect, FixedPattern) for c in missing.values()):
            self._lines = line_means_of_others(self.views, self.folds)
            self._areas = area_maps_of_others(self.views, self.folds)
        by_view = in_threads(lambda v: [self._columns(c, v).astype(np.float32) for c in missing.values()], range(len(self.views)))
        self._kept = self._kept | dict(zip(missing, map(list, zip(*by_view, strict=True)), strict=True))
        self._squares = self._squares | {source: _squares(self._kept[source]) for source in missing}
        return [self._kept[c.source] for c in tested]

    def squares(self, tested: Sequence[Candidate]) -> list[Float]:
        """(k,) sums of squares per candidate over the pixels of all views, of columns that the store holds."""
        return [self._squares[c.source] for c in tested]

    def _columns(self, candidate: Candidate, v: int) -> Float:
        view, effect = self.views[v], candidate.effect
        if candidate.free is not None:
            return candidate.free.columns(view)
        if effect is None:
            return np.zeros((len(view.pixels), 0))
        if isinstance(effect, FixedPattern):  # Lines have no formula: they are estimated from the other views.
            return pattern_columns(view, self._lines[v], self._areas[v], effect)
        if effect.LOCAL:
            return np.asarray(effect.columns(self._thinned[v])[0])
        return effect.columns_at(view.frame, view.pixels)


LENS_COLUMNS = 4
"""Columns of `intrinsics` that a calibration states: fx, fy, cx, cy."""
PINNED_SD = np.repeat([3e-3, np.radians(0.2)], 3)
"""Standard deviation (metres, radians) of a moving session's base about its pose by edges, which motion blur shifts by millimetres."""


def stored(views: Sequence[ViewEvidence], chain: Chain, folds: int) -> ColumnStore:
    """The columns of views whose stations are the chain's, dealt into `folds`."""
    return ColumnStore(views, deal(chain.station.tolist(), folds))


LENSES = tuple(Candidate(Intrinsics.NAME, Intrinsics(z_from=lens)) for lens in CONVERSIONS)
"""The lens within its calibration, of both forms: the first columns of `intrinsics`, focal lengths and principal point."""


EXACT = np.zeros(LENS_COLUMNS)
"""Deviations of a lens that is what CameraInfo says."""


def build(store: ColumnStore, tested: Sequence[Candidate], chain: Chain, hand_sd: Float, lens_sd: Float = EXACT) -> Design:
    """One system of all hypotheses, linearised at `chain`.

    hand_sd (6,): prior deviations of X where it is not freed; lens_sd (4,): of focal lengths (relative) and principal point (pixels),
    `EXACT` adds no column. In a moving session, the prior of the bases is centred on the chain's bases and not on the robot's.
    """
    calibrated = bool(lens_sd.any())
    by_candidate, squares = store.of(tested), store.squares(tested)
    if calibrated:
        by_candidate += [[c[:, :LENS_COLUMNS] for c in columns] for columns in store.of(LENSES)]
        squares += [square[:LENS_COLUMNS] for square in store.squares(LENSES)]
    ends = np.cumsum([0, *(columns[0].shape[1] for columns in by_candidate)])
    groups = tuple(np.arange(a, b) for a, b in itertools.pairwise(ends))
    every = range(len(store.views))
    total = sum(len(view.pixels) for view in store.views)
    scale = np.sqrt(np.concatenate([np.zeros(0), *squares]) / total)
    live = scale > 1e-12
    safe = np.where(live, scale, 1.0)
    in_motion = moving(store.views)
    sd = _column_sd(tested, groups[: len(tested)], safe)
    if calibrated:
        sd = np.concatenate([sd, *(lens_sd * safe[group] for group in groups[-2:])])
    base_sd = np.minimum(chain.priors.base, PINNED_SD) if in_motion else chain.priors.base
    system = ColumnSystem.of(
        in_blocks(lambda v: _gram(store.views[v], [columns[v] for columns in by_candidate], safe), every),
        chain,
        # The coefficient of a column that is zero everywhere is pinned to 0.
        np.where(live, sd, 1e-9),
        Priors(base_sd, hand_sd, at_chain=in_motion),
        pixels=np.array([v.independent for v in store.views]),
        weight=np.array([float((v.fit_sigma.ravel()[v.pixels] ** -2).sum()) for v in store.views]),
        drawn=np.array([float(len(v.pixels)) for v in store.views]),
    )
    return Design(tuple(tested), groups[: len(tested)], safe, system, *groups[len(tested) :])


def _squares(by_view: Sequence[Image]) -> Float:
    """(k,) sums of the squares of columns over the pixels of all views."""
    return np.asarray(sum(np.square(columns).sum(axis=0, dtype=np.float64) for columns in by_view))


def _column_sd(tested: Sequence[Candidate], groups: Sequence[Ints], scale: Float) -> Float:
    sd = [np.full(len(g), FREE_SD_M) if c.effect is None else c.effect.prior_sd(scale[g]) for c, g in zip(tested, groups, strict=True)]
    return np.concatenate([np.zeros(0), *sd])


def _gram(view: ViewEvidence, columns: Sequence[Image], scale: Float) -> Float:
    """Weighted products of [camera 6 | columns over their scale | residual], each row weighted by 1 / `fit_sigma`."""
    ends = np.cumsum([6, *(c.shape[1] for c in columns)])
    X = np.empty((ends[-1] + 1, len(view.pixels)))  # a column is a row: hundreds of short pieces beside each other are slow to write
    X[:6], X[-1] = pose_columns(view.frame.take(view.pixels))[0].T, view.residual.ravel()[view.pixels]
    for column, a, b in zip(columns, ends, ends[1:], strict=False):
        X[a:b] = column.T
    X /= view.fit_sigma.ravel()[view.pixels]
    over = np.concatenate([np.ones(6), 1.0 / scale, np.ones(1)])
    products = X @ X.T
    products *= over[:, None]
    products *= over
    return np.asarray(products)
