# SPDX-License-Identifier: Apache-2.0
"""Lamp light that a cover glass or the housing reflects onto the sensor: one phase in every pixel; a formula of no named effect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_gap.solve.candidate import Candidate
from tof_gap.solve.free import AMPLITUDE, STRAY_LIGHT, UNKNOWN, knots_of
from tof_sensor.frame import LIGHT_M_PER_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints
    from tof_gap.seen.residual import ViewEvidence

USUAL_MHZ = (15.0, 30.0, 45.0, 60.0, 75.0, 90.0, 105.0, 120.0)
"""Modulation frequencies that are tried where none is stated: neighbours differ by a radian over two metres of range."""


@dataclass(frozen=True, slots=True)
class Crosstalk:
    """An error along the ray by light of constant phase and amount beside the pixel's own light.

    The sum of the pixel's phasor A exp(i phi), with phi = 4 pi f r / c, and one of amount S and phase psi turns by (S / A) sin(psi - phi)
    to first order, which are two columns: sin(phi) / A and cos(phi) / A. Like a free function it has no name, so that a wave over range
    does not stand in for it; unlike one it pays for no freedom. unit: amplitude by which A is divided; means: of both columns over the
    session's pixels; they are subtracted, since a constant is an offset.
    """

    modulation_mhz: float
    unit: float
    means: tuple[float, float] = (0.0, 0.0)
    quantity: ClassVar[str] = STRAY_LIGHT
    FORMULA: ClassVar[bool] = True

    def columns(self, view: ViewEvidence) -> Float:
        """(n, 2) at a view's drawn pixels: metres of z per metre along the ray."""
        return self._at(view, view.pixels)

    def share(self, values: Float, view: ViewEvidence) -> Float:
        """(H, W) metres of z for `values` (2,), metres along the ray."""
        every = np.arange(view.residual.size)
        return np.asarray((self._at(view, every) @ values).reshape(view.residual.shape))

    def along_ray(self, view: ViewEvidence, at: Ints) -> Float:
        """(n, 2) columns along the ray at pixels (flat indices), means included; NaN without light."""
        phase = 4e6 * np.pi * self.modulation_mhz / LIGHT_M_PER_S * view.frame.radial.ravel()[at].astype(np.float64)
        light = view.frame.amplitude.ravel()[at] / self.unit
        own = np.where(light > 0, 1.0 / np.maximum(light, 1e-12), np.nan)
        return np.stack([np.sin(phase) * own, np.cos(phase) * own], axis=1)

    def _at(self, view: ViewEvidence, at: Ints) -> Float:
        return np.asarray(np.nan_to_num(self.along_ray(view, at) - self.means) / view.frame.length.ravel()[at, None])


def crosstalk(views: Sequence[ViewEvidence], stated_mhz: Sequence[float]) -> list[Candidate]:
    """One candidate per frequency: the stated ones and, of several, their mean, else usual ones; none where all pixels are equally bright."""
    if knots_of(views, AMPLITUDE) is None:
        return []
    tried = (*stated_mhz, float(np.mean(stated_mhz))) if len(stated_mhz) > 1 else tuple(stated_mhz) or USUAL_MHZ
    light = np.concatenate([v.frame.amplitude.ravel()[v.pixels] for v in views])
    unit = float(np.median(light[light > 0]))
    out = []
    for mhz in tried:
        bare = Crosstalk(mhz, unit)
        every = np.concatenate([bare.along_ray(v, v.pixels) for v in views])
        sine, cosine = np.nanmean(every, axis=0)
        out.append(Candidate(UNKNOWN, None, STRAY_LIGHT, Crosstalk(mhz, unit, (float(sine), float(cosine)))))
    return out
