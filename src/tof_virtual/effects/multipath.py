# SPDX-License-Identifier: Apache-2.0
"""Multipath: light that reached the visible point via other surfaces, traced in the true scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from typing_extensions import override

from tof_virtual.effect import Effect, Moment
from tof_virtual.indirect import irradiance
from tof_virtual.optics import SIGNAL_RANGE
from tof_virtual.taps import metres_per_radian

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_virtual.optics import Light
    from tof_virtual.session import Session
    from tof_virtual.sight import Sight

KEPT = 32
"""Number of views whose indirect light is cached."""


class Multipath(Effect):
    """Interreflection with the bodies' own albedos; `size` is the share that the camera leaves uncorrected (1: all of it)."""

    name, unit, start, limit = "multipath", "share of the traced light", 0.5, 1.5
    local = True

    @override
    def prepare(self, session: Session) -> None:
        self._known: dict[bytes, NDArray[np.complex128]] = {}

    @override
    def params(self) -> dict[str, Any]:
        return {"share": self.size, "bounces": 4}

    def traced(self, sight: Sight, moment: Moment) -> NDArray[np.complex128]:
        """Indirect irradiance (P,) of a view over the emitter's intensity."""
        place = sight.T_cell_camera.tobytes()
        if place not in self._known:
            wavenumber = 1 / metres_per_radian(moment.config.camera.modulation_mhz)
            self._known[place] = irradiance(moment.world, sight, moment.camera.rays(), wavenumber)
            if len(self._known) > KEPT:
                self._known.pop(next(iter(self._known)))
        return self._known[place]

    @override
    def spread(self, light: Light, sight: Sight, moment: Moment) -> None:
        config = moment.config.camera
        hit = sight.main.face >= 0
        albedo = np.where(hit, moment.world.soup.albedo[sight.main.face], 0.0)
        scale = self.size * 1e3 * config.signal_ke * SIGNAL_RANGE**2 / 0.5 * albedo
        extra = scale * self.traced(sight, moment)
        phase = np.where(hit, sight.main.distance, 0.0) / metres_per_radian(config.modulation_mhz)
        light.first += extra * np.exp(1j * phase)
        light.total += np.abs(extra)
        if light.third.size:
            turn = np.angle(extra) + phase
            light.third += np.abs(extra) * np.exp(3j * turn)
            light.fifth += np.abs(extra) * np.exp(5j * turn)
