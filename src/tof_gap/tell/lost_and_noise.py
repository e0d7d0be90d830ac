# SPDX-License-Identifier: Apache-2.0
"""Noise and loss of two sensor models at the same amplitude."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_sensor.effect import Evidence

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Mask
    from tof_sensor.frame import Frame
    from tof_sensor.model import SensorModel


@dataclass(frozen=True, slots=True)
class Level:
    """Noise (mm) or share of lost pixels of the real and the simulated camera, and their difference by part."""

    real: float
    simulated: float
    parts: dict[str, float]

    @property
    def ratio(self) -> float:
        """Simulated over real."""
        return self.simulated / max(self.real, 1e-9)


def noise_apart(
    real: SensorModel, simulated: SensorModel, own: Sequence[Frame], other: Sequence[Frame], seen: Sequence[Mask], parts: Sequence[str]
) -> Level | None:
    """Median in mm of the noise of one capture along the ray, over the pixels `seen`; None where one of them has no photon law.

    The median, since a law fitted to bright pixels is uncertain for the darkest ones, which dominate a mean.

    own, other: the same views, with the amplitude of the real and of the simulated camera.
    """
    if real.law is None or simulated.law is None:
        return None
    sigma2 = []
    for law, frames in ((real.law, own), (simulated.law, other)):
        sigma2.append(np.concatenate([law.variance(f.amplitude[s], f.surroundings_m2[s]) for f, s in zip(frames, seen, strict=True)]))
    part = np.concatenate([f.rendering.part[s] for f, s in zip(own, seen, strict=True)])
    level = [1e3 * float(np.sqrt(np.median(v))) for v in sigma2]
    apart = _by_part(np.sqrt(sigma2[0]) - np.sqrt(sigma2[1]), part, parts)
    return Level(level[0], level[1], {name: 1e3 * abs(v) for name, v in apart.items()})


def loss_apart(
    real: SensorModel, simulated: SensorModel, own: Sequence[Frame], other: Sequence[Frame], parts: Sequence[str]
) -> Level | None:
    """Share of the CAD's pixels that each camera loses; None where neither loses any."""
    if not any(e.EVIDENCE is Evidence.MISSING for m in (real, simulated) for e in m.effects):
        return None
    lost = [np.concatenate([_lost(m, f)[f.valid] for f in frames]) for m, frames in ((real, own), (simulated, other))]
    part = np.concatenate([f.rendering.part[f.valid] for f in own])
    apart = _by_part(lost[0] - lost[1], part, parts)
    return Level(float(lost[0].mean()), float(lost[1].mean()), {name: abs(v) for name, v in apart.items()})


def _lost(model: SensorModel, frame: Frame) -> Float:
    """(H, W) probability that a pixel has no return."""
    rng = np.random.default_rng(0)
    for effect in model.effects:
        if effect.EVIDENCE is Evidence.MISSING:
            frame = effect.apply(frame, rng)
    return frame.missing


def _by_part(values: Float, part: np.ndarray[tuple[int, ...], np.dtype[np.int16]], parts: Sequence[str]) -> dict[str, float]:
    return {parts[i]: float(values[part == i].mean()) for i in np.unique(part) if i >= 0}
