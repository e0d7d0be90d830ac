# SPDX-License-Identifier: Apache-2.0
"""Noise beyond the photon law that the camera's own light makes, as a named effect changes it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_sensor.effects.ambient import Ambient
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.lens_scatter import LensScatter
from tof_sensor.effects.multipath import Multipath
from tof_sensor.effects.noise import Noise

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.seen.finding import Finding
    from tof_gap.solved import Solved


def of_own_light(found: Finding, solved: Solved, uneven: Sequence[Finding] = ()) -> bool:
    """Whether noise beyond the photon law is the camera's own: of its light, or of its read-out where `uneven` findings name that.

    Traps (`amplitude_bias`) take a constant charge from the signal, not from its photons: of the same amplitude, dark pixels then have more
    photon noise, in excess by 1 / A^2, as read-out noise has. So it is with own light that reaches all pixels by other surfaces or by the
    lens. Foreign light off the surfaces has another excess.

    A lamp that is on for longer (`wiggling`) modulates less of its light: the whole law is larger, which `Ambient` tells from light.

    Charge that rows or single pixels get from the read-out (`noise`) grows as 1 / A, too: what their map leaves looks like uniform light.
    """
    if not isinstance(found.effect, Ambient):
        return False
    changes = (AmplitudeBias.NAME, LensScatter.NAME, Multipath.NAME)
    return found.effect.like_read_out and (any(map(solved.names, changes)) or any(f.name == Noise.NAME for f in uneven))
