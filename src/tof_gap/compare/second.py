# SPDX-License-Identifier: Apache-2.0
"""Second selection, at the final poses of both sessions: effects that neither diagnosis named, from the union of those that were named.

A diagnosis may miss an effect that another one hides: a drift and an offset of opposite signs cancel in the mean. It starts without
effects and far from the final poses. The second selection starts where both sessions are fitted with all that either diagnosis named.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.compare.union import Member, designed, fitted
from tof_gap.solve.choose.together import added
from tof_gap.solve.conclude import moves_camera
from tof_gap.solve.confirmed import mean_square
from tof_gap.solve.hypotheses.candidates import candidates
from tof_sensor.effects.interference import Interference

if TYPE_CHECKING:
    from collections.abc import Sequence
    from collections.abc import Set as AbstractSet

    from tof_core.arrays import Float
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_sensor.effect import Effect
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class AsFitted:
    """An effect of the union with one session's coefficients.

    units: factor to the effect's unit of amplitude of the real and of the simulated session; temperature_c: lowest and highest of the
    session's views, beyond which the coefficients say nothing: a drift of 0.1 K may be fitted by 30 mm/K beside a warm-up.
    """

    effect: Effect
    units: tuple[float, float]
    temperature_c: tuple[float, float]

    def bias(self, frame: Frame, side: int) -> Float:
        """(H, W) metres of z in a view of the real (0) or simulated (1) session."""
        unit, context = self.units[side], frame.context
        within = float(np.clip(context.temperature, *self.temperature_c))
        return np.nan_to_num(
            self.effect.bias(replace(frame, amplitude=unit * frame.amplitude, context=replace(context, temperature=within)))
        )


def enlarged(sides: Sequence[Diagnosis], union: Sequence[Member], unit: float, left_out: AbstractSet[str]) -> list[Member]:
    """The union, and the effects that a session shows beside it, each at least as large as a diagnosis asks for.

    Nothing is added where a session has errors without a name, or light of another camera, whose errors differ from view to view: any
    effect may fit them.

    Args:
        sides: the real and the simulated session.
        union: effects that either diagnosis named.
        unit: the simulator's unit of amplitude over the camera's.
        left_out: names of effects that are not added.
    """
    union = list(union)
    if any(_without_name(side) for side in sides):
        return union
    more = _further(sides, unit, left_out)
    every, begun = [*union, *more], range(len(union))
    names = {m.group for m in union}
    chosen = added([designed(session, every, side, names)[0] for side, session in enumerate(sides)], begun) if more else ()
    while chosen:
        found = [*union, *(every[i] for i in chosen)]
        effects = [as_fitted(session, found, side) for side, session in enumerate(sides)]
        size_m = {i: max(_size_m(s, effects[side][every[i].group], side) for side, s in enumerate(sides)) for i in chosen}
        # Errors as small as a healthy camera's are not named by a diagnosis either.
        small = {i for i in chosen if size_m[i] < sides[0].config.select.least_mm * 1e-3}
        if not small:
            return found
        chosen = tuple(i for i in chosen if i not in small)
    return union


def as_fitted(session: Diagnosis, union: Sequence[Member], side: int) -> dict[str, list[AsFitted]]:
    """The union's effects by name, with the coefficients of the real (0) or simulated (1) session."""
    found, scale = fitted(session, union, side)
    ends = np.cumsum([len(m.effect.coefficients) for m in union])[:-1]
    warm = [v.frame.context.temperature for v in session.evidence]
    out: dict[str, list[AsFitted]] = {}
    for member, values in zip(union, np.split(found.theta / scale, ends), strict=True):
        one = AsFitted(member.effect.with_coefficients(values), member.units, (min(warm), max(warm)))
        out.setdefault(member.group, []).append(one)
    return out


def _without_name(session: Diagnosis) -> bool:
    """Whether a session has errors that no effect of the vocabulary owns, or errors that differ from view to view."""
    foreign = any(f.name == Interference.NAME for f in session.findings)
    return session.doubted or session.unexplained.structured or bool(session.solved.depends_on) or foreign


def _further(sides: Sequence[Diagnosis], unit: float, left_out: AbstractSet[str]) -> list[Member]:
    """Every effect in mean depth that the sessions can test, in every form that either asks to try, without those that move the camera."""
    units = ((1.0, 1.0 / unit), (unit, 1.0))
    out: dict[Effect, Member] = {}
    for own, session in zip(units, sides, strict=True):
        caster = session.evidence[0].frame.context.caster
        untested = left_out | session.not_testable.keys()
        known = session.config
        tested = [] if caster is None else candidates(session.evidence, caster.scene, known.noise, untested, stated_mhz=known.stated_mhz)
        for effect in (c.effect for c in tested):
            if effect is not None and not moves_camera(effect.with_coefficients(np.ones(len(effect.coefficients))), session.camera):
                out.setdefault(effect, Member(effect.NAME, effect, own))
    return list(out.values())


def _size_m(session: Diagnosis, effects: Sequence[AsFitted], side: int) -> float:
    """Metres: RMS of effects together over those pixels of the session that they affect."""
    maps = [(np.sum([e.bias(v.frame, side) for e in effects], axis=0), v.smooth) for v in session.evidence]
    return float(np.sqrt(mean_square(np.concatenate([bias[smooth] for bias, smooth in maps]))))
