# SPDX-License-Identifier: Apache-2.0
"""What a sensor.yaml states: noise and lost pixels, with which those of a session are compared, and bias, which is removed first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tof_sensor.effect import Effect
    from tof_sensor.effects.photon_law import PhotonLaw

KNOWN_SIZE = 1.25
"""Size in a session over that of sensor.yaml, up to which both are the same: three disturbed views show it to 20 %."""


@dataclass(frozen=True, slots=True)
class StatedNoise:
    """law: the camera's photon law, None where none is stated; effects: all stated ones; removed_mm: RMS of the bias removed from depth."""

    law: PhotonLaw | None = None
    effects: tuple[Effect, ...] = ()
    removed_mm: float = 0.0

    def includes(self, found: Effect) -> bool:
        """Whether the camera is known to have an effect of this kind that is hardly smaller."""
        return any(e.includes(found) for e in self.effects)


NOTHING_STATED = StatedNoise()
"""Without a sensor.yaml."""
