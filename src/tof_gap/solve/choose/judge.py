# SPDX-License-Identifier: Apache-2.0
"""Score of a hypothesis: held-out chi-square, the price of its forms, and whether its coefficients are possible."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tof_align.folds import Folds, deal
from tof_gap.seen.foreign.arm_steps import each_over_prior
from tof_gap.solve.hypotheses.candidate import HAND_EYE
from tof_sensor.effects.intrinsics import Intrinsics
from tof_sensor.effects.time_sync import TimeSync

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from tof_align.columns import ColumnFit, ColumnSystem
    from tof_core.arrays import Float, Ints
    from tof_gap.limits.solve import SelectLimits
    from tof_gap.solve.hypotheses.columns import Design


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """A set of candidates (members) with its held-out chi-square per view (V,) and the price of its members' forms."""

    members: tuple[int, ...]
    held_out: Float
    inflate: float
    price: float = 0.0

    @property
    def score(self) -> float:
        """Held-out chi-square of all views, price included; smaller explains more."""
        return float(self.held_out.sum()) + self.price


class Selector:
    """Held-out scores of hypotheses over one design."""

    def __init__(self, design: Design, config: SelectLimits) -> None:
        """Deal the views into folds, those of each station as evenly as possible."""
        self.design, self.config = design, config
        self.folds = deal(design.system.chain.station.tolist(), config.folds)
        self._empty: dict[float, float] = {}
        self._folded: dict[float, Folds] = {}
        self._beside: dict[tuple[int, ...], dict[int, Float]] = {}
        self._forms = Counter(c.name for c in design.candidates)

    def gain(self, member: int) -> float:
        """Held-out chi-square that a candidate must win; less if it reduces errors of arm or lens against known priors, not residuals."""
        return self.config.hand_gain if self.against_priors(member) else self.config.gain

    def share(self, member: int) -> float:
        """Share of the visible gap's energy that a candidate must explain.

        0 for effects that hardly show in residuals: hand-eye and late stamps, which errors of arm and base absorb; effects that smear,
        whose pixels are in no fit (`conclude` judges their share); a lens beside the one that the stated calibration leaves free.
        """
        one = self.design.candidates[member]
        if self.against_priors(member) or one.name == TimeSync.NAME or (one.effect is not None and one.effect.SMEARS):
            return 0.0
        return self.config.unknown_share if self.is_free(member) else self.config.share

    def against_priors(self, member: int) -> bool:
        """Whether the candidate reduces errors of arm or lens against their priors, and hardly residuals.

        That holds for hand-eye, and for a wrong lens if every hypothesis contains a lens within its stated calibration.
        """
        lens = len(self.design.always) > 0 and self.design.candidates[member].name == Intrinsics.NAME
        return lens or self.frees_hand([member])

    def needed_by_calibration(self, name: str, hypothesis: Hypothesis) -> bool:
        """Whether, without the effect `name`, the lens or the hand-eye of every hypothesis would contradict its calibration.

        Of the lens by `gain` of chi-square; by `lens_beside_rough` beside an effect whose map is inexact, since a lens absorbs smooth errors of maps.
        """
        if name == HAND_EYE:
            return self.contradicts_mount(self._without(name, hypothesis))
        always = self.design.always
        if name != Intrinsics.NAME or not len(always):
            return False
        without = self._without(name, hypothesis)
        system = self.design.system
        effects = (self.design.candidates[m].effect for m in hypothesis.members)
        rough = any(e is not None and e.ROUGH > 0.0 for e in effects)
        least = max(self.config.gain, self.config.lens_beside_rough * rough)
        return bool(self.fit(without).theta[: len(always)] ** 2 @ system.normal.info[system.poses + always] > least)

    def contradicts_mount(self, hypothesis: Hypothesis) -> bool:
        """Whether hand-eye, as every hypothesis has it within its stated calibration, is farther off than that states.

        The prior's deviations are a third of the largest stated error of position and of turn: both at their largest have a chi-square of 18.
        Thousands of pixels determine hand-eye against that prior, but freeing it explains little more of them.
        """
        if not len(self.design.always) or self.frees_hand(hypothesis.members):
            return False
        return self.design.system.mount_chi2(self.fit(hypothesis)) > self.config.mount_stated

    def needed_by_mount(self, name: str, hypothesis: Hypothesis) -> bool:
        """Whether, without the effect `name`, hand-eye would contradict its stated calibration, and does not with it (by `hand_gain`).

        Hand-eye absorbs what is alike in all pixels: of a drift of 7 mm, residuals show little.
        """
        if not len(self.design.always) or self.frees_hand(hypothesis.members):
            return False
        without = self._without(name, hypothesis)
        with_it, alone = (self.design.system.mount_chi2(self.fit(of)) for of in (hypothesis, without))
        return alone > self.config.hand_gain >= with_it

    def needed_by_robot(self, name: str, hypothesis: Hypothesis) -> bool:
        """Whether, without late stamps, arm errors would exceed the robot's prior in positions or in turns, and in neither with them.

        A hand that moves straight is off in position alone.
        """
        if name != TimeSync.NAME:
            return False
        without = self._without(name, hypothesis)
        with_them, alone = (max(each_over_prior(self.arms(of), self.arms_sd)) for of in (hypothesis, without))
        return alone > self.config.arm_rms >= with_them

    def _without(self, name: str, hypothesis: Hypothesis) -> Hypothesis:
        """The hypothesis without the effect `name`, not scored again."""
        return replace(hypothesis, members=tuple(self.design.without(hypothesis.members, name)))

    def columns(self, members: Iterable[int]) -> Ints:
        """Columns of a hypothesis."""
        return self.design.active(members)

    def frees_hand(self, members: Iterable[int]) -> bool:
        """Whether hand-eye is among them."""
        return any(self.design.candidates[m].name == HAND_EYE for m in members)

    def score(self, members: Sequence[int], inflate: float) -> Hypothesis:
        """The hypothesis of these members with its held-out chi-square: for each fold, fitted to all others and judged on it."""
        active, free = self.columns(members), self.frees_hand(members)
        held_out = self._folds(inflate).held_out(active, free_hand=free)
        return Hypothesis(tuple(members), held_out, inflate, self._price(members, held_out, inflate))

    def beside(self, rest: Sequence[int], place: int, inflate: float) -> Callable[[int], Hypothesis]:
        """`score` of the members `rest` and one candidate at `place` among them; what depends on `rest` alone is computed once."""
        folds, key = self._folds(inflate), tuple(sorted(rest))
        if key not in self._beside:
            groups = {i: group for i, group in enumerate(self.design.groups) if len(group) and not self.repeats(i, rest)}
            held_out = folds.held_out_beside(self.columns(rest), list(groups.values()), free_hand=self.frees_hand(rest)) if groups else ()
            self._beside[key] = dict(zip(groups, held_out, strict=True))
        of_all = self._beside[key]

        def scored(i: int) -> Hypothesis:
            members = (*rest[:place], i, *rest[place:])
            if i not in of_all:  # Hand-eye has no columns of its own.
                return self.score(members, inflate)
            return Hypothesis(members, of_all[i], inflate, self._price(members, of_all[i], inflate))

        return scored

    def _folds(self, inflate: float) -> Folds:
        """The folds at one inflation of the noise; those at another are dropped."""
        if inflate not in self._folded:
            self._folded, self._beside = {inflate: Folds(self.design.system, self.folds, inflate)}, {}
        return self._folded[inflate]

    def _price(self, members: Sequence[int], held_out: Float, inflate: float) -> float:
        """Chi-square that members pay for the number of their forms.

        The more forms are tried, the likelier one fits by chance. A free function, also as the form of an effect (`Effect.free_form`),
        fits any error exactly, a formula never does: therefore it pays a share of the chi-square besides.
        """
        forms = sum(self._of_forms[m] for m in members)
        free = sum(self._without_formula[m] for m in members)
        if not free:
            return forms
        if inflate not in self._empty:
            self._empty[inflate] = self.score((), inflate).score
        explained = self._empty[inflate] - float(held_out.sum())
        return forms + free * (self.config.unknown + self.config.unknown_share * max(explained, 0.0))

    @cached_property
    def _of_forms(self) -> list[float]:
        """For each candidate, what it pays for the number of its forms; nothing for a free function."""
        return [
            0.0 if c.free is not None and not c.free.FORMULA else 2.0 * float(np.log(self._forms[c.name])) for c in self.design.candidates
        ]

    @cached_property
    def _without_formula(self) -> list[bool]:
        """For each candidate, whether it is a free function, or such a form of an effect."""
        return [not c.free.FORMULA if c.free is not None else c.effect is not None and c.effect.free_form for c in self.design.candidates]

    def forms(self, member: int) -> int:
        """How many forms of the candidate's effect the session tries."""
        return self._forms[self.design.candidates[member].name]

    @cached_property
    def apart(self) -> ColumnSystem | None:
        """The system with every view's distance free, where poses are known apart from depth, as before a board; else None."""
        system = self.design.system
        return None if system.chain.root is None else system.with_free_distances()

    def is_free(self, member: int) -> bool:
        """Whether a candidate is an error without a name and no effect."""
        return self.design.candidates[member].free is not None

    def repeats(self, member: int, members: Iterable[int]) -> bool:
        """Whether a hypothesis of these members cannot take the candidate.

        It is one of them, or another form of an effect that a hypothesis may contain only once, or it and one of them do not occur together.
        """
        one, others = self.design.candidates[member], [self.design.candidates[m] for m in members]
        if member in members or any(one.excludes(o) for o in others):
            return True
        together = [one, *others]
        return not all(c.stands_beside(together) for c in together)

    def fit(self, hypothesis: Hypothesis) -> ColumnFit:
        """The hypothesis fitted to all views."""
        members = hypothesis.members
        return self.design.system.fit(self.columns(members), inflate=hypothesis.inflate, free_hand=self.frees_hand(members))

    def plausible(self, hypothesis: Hypothesis) -> bool:
        """Whether all coefficients are within their bounds to `margin` standard errors, and those that define an effect differ from 0."""
        solution = self.fit(hypothesis)
        sd = np.sqrt(np.diag(solution.theta_cov))
        for candidate, group, at in self.design.placed(hypothesis.members):
            effect = candidate.effect
            if effect is None or effect.free_form or len(effect.LINEAR) != len(group):
                continue
            own = at.start + np.array([effect.LINEAR.index(name) for name in effect.OWN], np.int64)
            if (
                len(own)
                and solution.theta[own] @ np.linalg.solve(solution.theta_cov[np.ix_(own, own)], solution.theta[own]) < self.config.gain
            ):
                return False
            low, high = effect.bounds
            value, error = solution.theta[at] / self.design.scale[group], self.config.margin * sd[at] / self.design.scale[group]
            if ((value + error < low) | (value - error > high)).any():
                return False
        return True

    def arms(self, hypothesis: Hypothesis) -> Float:
        """(V, 6) arm errors in the camera's frame, metres and radians."""
        return self.design.system.normal.own_error + self.fit(hypothesis).arm

    @property
    def arms_sd(self) -> Float:
        """(V, 6) standard deviations of arm errors by the robot's prior."""
        normal = self.design.system.normal
        return np.broadcast_to(1.0 / np.sqrt(normal.own_info), normal.own_error.shape)

    def arms_alike(self, hypothesis: Hypothesis) -> float:
        """Chi-square (6 degrees of freedom) of the mean arm error under the robot's prior: large where the camera's mount is off."""
        errors = self.arms(hypothesis)
        return float(len(errors) * (((errors / self.arms_sd).mean(axis=0)) ** 2).sum())

    def inflation(self, members: Sequence[int]) -> float:
        """Factor by which the weight of the data is divided, since errors that neighbours share count once; from the members' residual."""
        return self.design.system.inflation(self.columns(members), self.config.neighbours, free_hand=self.frees_hand(members))
