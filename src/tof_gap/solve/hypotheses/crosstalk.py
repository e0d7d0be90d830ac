# SPDX-License-Identifier: Apache-2.0
"""Lamp light that a cover glass or the housing reflects onto the sensor: one phase in every pixel; a formula of no named effect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_gap.solve.hypotheses.candidate import Candidate
from tof_gap.solve.hypotheses.free import AMPLITUDE, STRAY_LIGHT, UNKNOWN, knots_of
from tof_gap.solve.hypotheses.nameless import Nameless, inverse_light
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.frame import LIGHT_M_PER_S
from tof_sensor.session import merged

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints
    from tof_gap.seen.evidence.view import ViewEvidence

USUAL_MHZ = (15.0, 30.0, 45.0, 60.0, 75.0, 90.0, 105.0, 120.0)
"""Modulation frequencies that are tried where none is stated: neighbours differ by a radian over two metres of range."""


@dataclass(frozen=True, slots=True)
class Crosstalk(Nameless):
    """An error along the ray by light of constant phase and amount beside the pixel's own light.

    The sum of the pixel's phasor A exp(i phi), with phi = 4 pi f r / c, and one of amount S and phase psi turns by (S / A) sin(psi - phi)
    to first order, which are two columns: sin(phi) / A and cos(phi) / A. Like a free function it has no name, so that a wave over range
    does not stand in for it; unlike one it pays for no freedom. Formulas of `amplitude_bias` go as 1 / A too, and it would explain what
    these leave.
    """

    modulation_mhz: float
    means: tuple[float, ...] = (0.0, 0.0)
    quantity: str = STRAY_LIGHT
    FORMULA: ClassVar[bool] = True
    RIVALS: ClassVar[frozenset[str]] = frozenset({AmplitudeBias.NAME})

    def along_ray(self, view: ViewEvidence, at: Ints) -> Float:
        """(n, 2) sine and cosine of the phase over the pixel's own light."""
        phase = 4e6 * np.pi * self.modulation_mhz / LIGHT_M_PER_S * view.frame.radial.ravel()[at].astype(np.float64)
        return np.stack([np.sin(phase), np.cos(phase)], axis=1) * inverse_light(view, at)


def tried_mhz(views: Sequence[ViewEvidence], stated_mhz: tuple[float, ...]) -> tuple[float, ...]:
    """Modulation frequencies of light beside the pixel's own: the stated ones (`merged`) or usual ones; none where all pixels are equally bright."""
    return () if knots_of(views, AMPLITUDE) is None else merged(stated_mhz) or USUAL_MHZ


def crosstalk(views: Sequence[ViewEvidence], stated_mhz: tuple[float, ...]) -> list[Candidate]:
    """One candidate per frequency of `tried_mhz`."""
    out = []
    for mhz in tried_mhz(views, stated_mhz):
        bare = Crosstalk(mhz)
        means = np.nanmean(np.concatenate([bare.along_ray(v, v.pixels) for v in views]), axis=0)
        out.append(Candidate(UNKNOWN, None, STRAY_LIGHT, Crosstalk(mhz, tuple(means.tolist()))))
    return out
