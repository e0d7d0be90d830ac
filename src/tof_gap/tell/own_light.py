# SPDX-License-Identifier: Apache-2.0
"""Noise beyond the photon law that the camera's own light makes, as a named effect changes it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import joined
from tof_gap.seen.photons import variance_of_mean
from tof_sensor.effects.ambient import Ambient
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.lens_scatter import LensScatter
from tof_sensor.effects.multipath import Multipath
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.wiggling import Wiggling

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.seen.finding import Finding
    from tof_gap.seen.residual import ViewEvidence
    from tof_gap.solved import Solved

LESS_MODULATED = 1.0
"""Variance beyond the photon law, over the law's, that a lamp makes which is on for longer than at the factory. The contrast of a pulse of
duty d is sin(pi d) / (pi d): from 0.5 to 0.7 the variance grows by a factor of 1.7, and more where a second frequency has a third of the period."""


def of_own_light(found: Finding, solved: Solved, uneven: Sequence[Finding] = ()) -> bool:
    """Whether noise beyond the photon law is the camera's own: of its light, or of its read-out where `uneven` findings name that.

    Traps (`amplitude_bias`) take a constant charge from the signal, not from its photons: of the same amplitude, dark pixels then have more
    photon noise, in excess by 1 / A^2, as read-out noise has. So it is with own light that reaches all pixels by other surfaces or by the
    lens. Foreign light off the surfaces has another excess.

    A lamp that is on for longer (`wiggling`) modulates less of its light: of the same amplitude, all pixels have more photons. Its excess
    is less than the law's own variance.

    Charge that rows or single pixels get from the read-out (`noise`) grows as 1 / A, too: what their map leaves looks like uniform light.
    """
    if not isinstance(found.effect, Ambient):
        return False
    changes = (AmplitudeBias.NAME, LensScatter.NAME, Multipath.NAME)
    if found.effect.like_read_out and (any(map(solved.names, changes)) or any(f.name == Noise.NAME for f in uneven)):
        return True
    return solved.names(Wiggling.NAME) and not found.structure and times_law(found, solved.bare) < LESS_MODULATED


def times_law(found: Finding, views: Sequence[ViewEvidence]) -> float:
    """Median variance of a finding's noise over that of the photon law beside which it stands; infinite where none does."""
    if found.share is None or found.beside is None:
        return float("inf")
    ratio = ((of * v.frame.length) ** 2 / variance_of_mean(found.beside, v) for of, v in zip(found.share, views, strict=True))
    known = joined((r[np.isfinite(r)] for r in ratio), found.share.size)
    return float(np.median(known, overwrite_input=True))
