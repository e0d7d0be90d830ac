# SPDX-License-Identifier: Apache-2.0
"""Both sessions solved under the union of the effects that either diagnosis named, and the effects whose coefficients differ.

Two diagnoses name what each session shows beyond its own thresholds. An effect that one session names and the other does not may be in
both. So every effect is fitted in both sessions, beside all others and the poses, and the differences of its coefficients are judged by
the covariance of both fits. What poses could make, in the precision of the robot's prior, is in that covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tof_align.folds import deal
from tof_gap.compare.difference import Apart
from tof_gap.seen.evidence.residual import less
from tof_gap.solve.choose.judge import Selector
from tof_gap.solve.choose.worth import rescored
from tof_gap.solve.conclude import is_of_calibration
from tof_gap.solve.hypotheses.candidate import Candidate
from tof_gap.solve.hypotheses.columns import ColumnStore, build
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.geometry import image_flow

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from collections.abc import Set as AbstractSet

    from tof_core.arrays import Float, Ints, Mask
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_sensor.effect import Effect

UNSEEN_SD_M = 1.0
"""Metres: deviation of a coefficient whose column is zero in a session, which then says nothing about it."""
LINEAR_PX = 0.5
"""Pixels by which a lateness may shift the image, in the median over the CAD, so that its column describes it: beyond, pixels see other points."""


@dataclass(frozen=True, slots=True, eq=False)
class Member:
    """One effect of the union.

    group: the name under which it is compared; units: factor by which the real and the simulated session's amplitudes are multiplied
    to be in the unit of the effect; known: whether its bias was removed from both sessions before they were diagnosed.
    """

    group: str
    effect: Effect
    units: tuple[float, float]
    known: bool = False

    @property
    def shape(self) -> tuple[str, Effect]:
        """What its columns depend on: its parameters without the coefficients."""
        return self.group, self.effect.with_coefficients(np.zeros(len(self.effect.coefficients)))


class Fitted(NamedTuple):
    """Coefficients of all members in one session: (k,) metres RMS over the real session, and their covariance (k, k)."""

    theta: Float
    cov: Float


def members(sides: Sequence[Diagnosis], taken: Mapping[str, str], unit: float, left_out: AbstractSet[str]) -> list[Member] | None:
    """The effects in mean depth that either session names, each shape once; None where columns do not describe one (`moves_far`).

    Args:
        sides: the real and the simulated session.
        taken: of tied effects, the name under which both are compared.
        unit: the simulator's unit of amplitude over the camera's.
        left_out: names of effects that are not compared by their coefficients.
    """
    units = ((1.0, 1.0 / unit), (unit, 1.0))
    out: dict[tuple[str, Effect], Member] = {}
    for own, side in zip(units, sides, strict=True):
        for cause in () if side.doubted else side.causes:
            for effect in cause.named.effects:
                if moves_far(effect, side):
                    return None
                if cause.named.name not in left_out:
                    member = Member(taken.get(cause.named.name, cause.named.name), effect, own)
                    out.setdefault(member.shape, member)
    return list(out.values())


def moves_far(effect: Effect, session: Diagnosis) -> bool:
    """Whether an effect moves the camera or changes its lens by more than columns describe.

    The time between taps changes the mean time of a frame by a little: this shift of the image is linear.
    """
    if is_of_calibration(effect, session.camera):
        return True
    frames = [v.frame for v in session.evidence if v.frame.context.twist.any()]
    shifts = [np.hypot(*image_flow(f))[f.valid] for f in frames]
    return bool(shifts) and abs(effect.late_s) * float(np.nanmedian(np.concatenate(shifts))) > LINEAR_PX


def with_known(union: Sequence[Member], removed: Sequence[Effect]) -> list[Member]:
    """The union, and of its effects the known parts, which both sessions have beside what was found."""
    groups = {m.group for m in union}
    known = [Member(e.NAME, e, (1.0, 1.0), known=True) for e in removed if e.NAME in groups]
    shapes = {m.shape for m in known}
    return [*known, *(m for m in union if m.shape not in shapes)]


def fitted(session: Diagnosis, union: Sequence[Member], side: int, scale: Float | None = None) -> tuple[Fitted, Float]:
    """The union's coefficients in one session at its poses, with the robot's priors, and the scale (k,) in metres per unit of each.

    Args:
        session: its evidence contains the biases.
        union: the effects.
        side: 0 for the real session, 1 for the simulated.
        scale: (k,) of the other session, so that both sessions' coefficients are in one unit; None for this session's own.
    """
    judge, store = designed(session, union, side, {m.group for m in union})
    design = judge.design
    solution = judge.fit(rescored(judge, range(len(union))))
    own = np.concatenate([design.scale[group] for group in design.groups])
    at = np.arange(len(design.always), len(design.always) + len(own))
    scale = own if scale is None else scale
    theta, cov = solution.theta[at] * scale / own, solution.theta_cov[np.ix_(at, at)] * np.outer(scale / own, scale / own)
    unseen = _unseen(store, design.candidates)
    theta[unseen], cov[unseen], cov[:, unseen] = 0.0, 0.0, 0.0
    cov[unseen, unseen] = UNSEEN_SD_M**2
    return Fitted(theta, cov), scale


def designed(session: Diagnosis, union: Sequence[Member], side: int, names: AbstractSet[str]) -> tuple[Selector, ColumnStore]:
    """Hypotheses of these effects in one session, linearised at its poses, and their columns.

    names: effects whose bias is left in the views where a diagnosis found it small.
    """
    solved = session.account.solved
    pattern = solved.maps.get(FixedPattern.NAME)
    views = less(_with_small(session, names), [] if pattern is None else [pattern])
    candidates = [Candidate(m.effect.NAME, m.effect) for m in union]
    store = _InUnits(views, deal(solved.chain.station.tolist(), session.config.select.folds), {m.effect: m.units[side] for m in union})
    return Selector(build(store, candidates, solved.chain, session.config.hand_sd, session.config.lens_sd), session.config.select), store


def _with_small(session: Diagnosis, names: AbstractSet[str]) -> tuple[ViewEvidence, ...]:
    """The session's views with the bias of those effects `names` that are within a healthy camera's tolerance, and were subtracted.

    The other session may have a little more of one: without it, the session would seem to have none.
    """
    views = session.account.solved.evidence
    small = [e for n in session.account.solved.within if n.name in names for e in n.effects if not moves_far(e, session)]
    return less(views, [[-e.bias(v.frame) for v in views] for e in small])


def _unseen(store: ColumnStore, candidates: Sequence[Candidate]) -> Ints:
    """Places of the coefficients whose columns are zero in all views."""
    zero = [np.all([~c.any(axis=0) for c in by_view], axis=0) for by_view in store.of(candidates)]
    return np.flatnonzero(np.concatenate(zero))


class _InUnits(ColumnStore):
    """Columns of effects, each computed at amplitudes in the effect's own unit."""

    def __init__(self, views: Sequence[ViewEvidence], folds: Ints, units: Mapping[Effect, float]) -> None:
        super().__init__(views, folds)
        self._units = units

    def _columns(self, candidate: Candidate, v: int) -> Float:
        assert candidate.effect is not None, "a union has effects alone"
        unit = self._units.get(candidate.effect, 1.0)
        view = self.views[v]
        frame = view.frame if unit == 1.0 else replace(view.frame, amplitude=unit * view.frame.amplitude)
        return candidate.effect.columns_at(frame, view.pixels)


def apart(sides: Sequence[Diagnosis], union: Sequence[Member], gain: float) -> dict[str, Apart]:
    """The union's effects, each with the chi-squares by which the two sessions' coefficients differ.

    Effects are equal until their difference explains `gain` of the chi-square of all differences: they are freed one by one, the one that
    explains most first. Effects that stay equal are judged beside those that were freed.
    """
    if not union:
        return {}
    real, scale = fitted(sides[0], union, 0)
    simulated, _ = fitted(sides[1], union, 1, scale)
    sizes = [m.effect.coefficients for m in union]
    added = scale * np.concatenate([c if m.known else np.zeros(len(c)) for m, c in zip(union, sizes, strict=True)])
    group = np.repeat([m.group for m in union], [len(c) for c in sizes])
    found = freed(Fitted(real.theta + added, real.cov), Fitted(simulated.theta + added, simulated.cov), group, gain)
    coarse = [(m.group, m.effect.rough * max(found[m.group].real, found[m.group].simulated)) for m in union]
    return {name: a._replace(of_maps=max((c for other, c in coarse if other != name), default=0.0)) for name, a in found.items()}


def freed(real: Fitted, simulated: Fitted, group: Sequence[str] | Mask, gain: float) -> dict[str, Apart]:
    """As `apart`, of (k,) coefficients of the effects `group` (k,)."""
    names = np.asarray(group)
    difference = real.theta - simulated.theta
    info: Float = np.linalg.inv(real.cov + simulated.cov).astype(np.float64)
    whole = float(difference @ info @ difference)
    free: list[str] = []
    explained = 0.0
    while True:
        trials = {n: _explained(difference, info, np.isin(names, [*free, n])) for n in dict.fromkeys(names.tolist()) if n not in free}
        best = max(trials, key=trials.__getitem__, default=None)
        if best is None or trials[best] - explained < gain:
            break
        free, explained = [*free, best], trials[best]
    out = {}
    for name in dict.fromkeys(names.tolist()):
        mine, others = names == name, np.isin(names, [n for n in free if n != name])
        weight = _weight(info, mine, others)
        delta = _estimate(difference, info, mine | others)[mine]
        a, b = real.theta[mine], simulated.theta[mine]
        alone = float(delta @ weight @ delta)
        share = alone / max(whole, 1e-12)
        out[name] = Apart(alone, float(a @ weight @ a), float(b @ weight @ b), float(a @ weight @ b), share, name in free)
    return out


def _estimate(difference: Float, info: Float, free: Mask) -> Float:
    """(k,) differences of the coefficients `free` if all others are equal, 0 for these."""
    out = np.zeros(len(difference))
    out[free] = np.linalg.solve(info[np.ix_(free, free)], (info @ difference)[free])
    return out


def _explained(difference: Float, info: Float, free: Mask) -> float:
    """Chi-square that differences of the coefficients `free` explain."""
    return float(_estimate(difference, info, free) @ info @ difference)


def _weight(info: Float, mine: Mask, others: Mask) -> Float:
    """Inverse covariance of the differences `mine`, with the differences `others` free and all further ones 0."""
    own = info[np.ix_(mine, mine)]
    if not others.any():
        return own
    cross = info[np.ix_(mine, others)]
    return np.asarray(own - cross @ np.linalg.solve(info[np.ix_(others, others)], cross.T))
