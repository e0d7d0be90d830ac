# SPDX-License-Identifier: Apache-2.0
"""Lost pixels of two sessions: what both sensor models predict on the same views, and whether both sessions lose as much."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tof_gap.compare.levels import mean_level
from tof_gap.seen.missing.filtered import filtered
from tof_gap.seen.missing.lost import losses_of
from tof_sensor.effect import Evidence
from tof_sensor.effects.dropout import Dropout

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tof_core.arrays import Float
    from tof_gap.compare.levels import Level
    from tof_gap.limits.missing import MissingLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_sensor.frame import Frame
    from tof_sensor.model import SensorModel


@dataclass(frozen=True, slots=True)
class Lossy:
    """A session's views, its sensor, and the other session's unit of amplitude over the session's own."""

    views: Sequence[ViewEvidence]
    model: SensorModel
    unit: float


class Shares(NamedTuple):
    """(n,) shares of loss of a session's pixels that should return light: by its own model, by the other's, as measured; the parts (n,)."""

    own: Float
    other: Float
    measured: Float
    part: NDArray[np.int16]

    def shown(self, least: float) -> float:
        """Share of the models' difference that the session's pixels show; NaN where the models differ by less than `least` there."""
        apart = float(self.own.mean() - self.other.mean()) if len(self.own) else 0.0
        return float(self.measured.mean() - self.other.mean()) / apart if abs(apart) > least else float("nan")


class LossApart(NamedTuple):
    """Loss of both on the real session's views, and the share of the difference that each session shows."""

    level: Level
    shown: tuple[float, float]


def loss_apart(real: Lossy, simulated: Lossy, parts: Sequence[str], limits: MissingLimits, least: float) -> LossApart | None:
    """What camera and simulator lose on the real session's views; None where neither has the effect, or they differ by less than `least`.

    A session that loses a little less than a diagnosis names has no such effect in its model, and its own pixels show the loss.

    Args:
        real: the camera's session.
        simulated: the simulator's.
        parts: names of the scene's parts.
        limits: which pixels should return light.
        least: least difference of two shares.
    """
    has = Dropout.NAME in real.model.names, Dropout.NAME in simulated.model.names
    if not any(has):
        return None
    here, there = shares(real, simulated.model, limits), shares(simulated, real.model, limits)
    if not len(here.own) or abs(float(here.own.mean() - here.other.mean())) <= least:
        return None
    level = mean_level(Dropout.NAME, here.own, here.other, here.part, parts, has)
    return LossApart(level, (here.shown(least), there.shown(least)))


def shares(session: Lossy, other: SensorModel, limits: MissingLimits) -> Shares:
    """What a session loses, and what its own sensor and another would lose in its place."""
    losses = losses_of(session.views, limits, filtered(session.views, limits).gone)
    rows = [
        (
            lost(session.model, v.frame)[i],
            lost(other, replace(v.frame, amplitude=session.unit * v.frame.amplitude))[i],
            v.frame.rendering.part[i],
        )
        for v, i in zip(session.views, losses.inside, strict=True)
    ]
    by_own, by_other, part = (np.concatenate(column) for column in zip(*rows, strict=True))
    return Shares(by_own, by_other, losses.gone, part)


def lost(model: SensorModel, frame: Frame) -> Float:
    """(H, W) probability that a pixel has no return."""
    rng = np.random.default_rng(0)
    for effect in model.effects:
        if effect.EVIDENCE is Evidence.MISSING:
            frame = effect.apply(frame, rng)
    return frame.missing
