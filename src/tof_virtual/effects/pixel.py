# SPDX-License-Identifier: Apache-2.0
"""Effects in the pixel: harmonics of the modulation, run times, late charge, light of another emitter."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from typing_extensions import override

from tof_virtual.effect import Effect, Moment
from tof_virtual.taps import SPEED_OF_LIGHT

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_virtual.config import VirtualConfig
    from tof_virtual.session import Session
    from tof_virtual.taps import Charge


class Wiggling(Effect):
    """The modulation is not a pure sine: its third and fifth harmonic alias in four taps into an error of four periods."""

    name, unit, start, limit = "wiggling", "harmonic content", 0.018, 0.5

    @override
    def draw(self, rng: np.random.Generator) -> None:
        share = rng.uniform(0.6, 1.0)
        self._third = share * np.exp(1j * rng.uniform(0, 2 * np.pi))
        self._fifth = (1 - share) * np.exp(1j * rng.uniform(0, 2 * np.pi))

    @override
    def params(self) -> dict[str, Any]:
        z = self.size * (self._fifth - self._third)  # phase error = |z| sin(4 phase + arg z)
        return {
            "amplitude_rad": float(np.abs(z)),
            "psi_rad": float(np.angle(z)),
            "period_m": SPEED_OF_LIGHT / (8e6 * self.config.camera.modulation_mhz),
        }

    @override
    def harmonics(self) -> tuple[complex, complex]:
        return complex(self.size * self._third), complex(self.size * self._fifth)


class FixedPattern(Effect):
    """Every pixel adds its own run time; columns (converters) and rows (clock tree) dominate."""

    name, unit, start, limit = "fixed_pattern", "rad", 0.013, 1.0

    @override
    def draw(self, rng: np.random.Generator) -> None:
        c = self.config.camera
        column, row, rest = rng.dirichlet([4, 3, 3])
        slope = rng.normal(0, 0.3, 2) @ np.stack(
            [g.ravel() for g in np.meshgrid(np.linspace(-1, 1, c.height), np.linspace(-1, 1, c.width), indexing="ij")]
        )
        pattern = (
            np.sqrt(column) * rng.normal(0, 1, (1, c.width))
            + np.sqrt(row) * rng.normal(0, 1, (c.height, 1))
            + np.sqrt(rest) * rng.normal(0, 1, (c.height, c.width))
        )
        self._lag = pattern.ravel() + slope
        self._parts = {"column": float(np.sqrt(column)), "row": float(np.sqrt(row)), "pixel": float(np.sqrt(rest))}

    @override
    def params(self) -> dict[str, Any]:
        return {k: self.size * v for k, v in self._parts.items()}

    @override
    def expose(self, charge: Charge, moment: Moment) -> None:
        charge.lag += self.size * self._lag


class TemperatureDrift(Effect):
    """The driver's delay follows the temperature; zero at the mean temperature of the session."""

    name, unit, start, limit = "temperature_drift", "rad/K", 0.003, 0.2

    @override
    @classmethod
    def adapt(cls, config: VirtualConfig) -> VirtualConfig:
        pause = max(config.plan.pause_s, 1.2 * config.warmup.tau_s / config.plan.views)
        return replace(config, plan=replace(config.plan, pause_s=pause))

    @override
    def draw(self, rng: np.random.Generator) -> None:
        self._sign = float(rng.choice([-1, 1]))

    @override
    def prepare(self, session: Session) -> None:
        self._reference = float(np.mean([session.temperature(s.time_s) for s in session.shutters]))

    @override
    def params(self) -> dict[str, Any]:
        return {"rad_per_K": self._sign * self.size, "reference_c": self._reference}

    @override
    def expose(self, charge: Charge, moment: Moment) -> None:
        charge.lag += self._sign * self.size * (moment.temperature - self._reference)


class AmplitudeBias(Effect):
    """Walk error: a low charge is read later (or sooner) than a high one; the phase depends on the logarithm of the amplitude."""

    name, unit, start, limit = "amplitude_bias", "rad per ln A", 0.015, 1.0

    @override
    def draw(self, rng: np.random.Generator) -> None:
        c = self.config.camera
        self._sign = float(rng.choice([-1, 1], p=[0.7, 0.3]))
        self._reference = 0.7 * c.contrast * c.signal_ke * 1e3

    @override
    def params(self) -> dict[str, Any]:
        return {"rad_per_ln": self._sign * self.size, "reference_e": self._reference}

    @override
    def expose(self, charge: Charge, moment: Moment) -> None:
        amplitude = np.abs(charge.phasor[1:3].mean(axis=0))
        charge.lag += self._sign * self.size * np.log(np.maximum(amplitude, 1.0) / self._reference)


class Interference(Effect):
    """A second emitter of nearly the same frequency beats with the shutter: stripes in some captures, none in others."""

    name, unit, start, limit = "interference", "e- from albedo 0.5", 2000.0, 3e5
    local = True

    @override
    def draw(self, rng: np.random.Generator) -> None:
        self._duty = float(rng.uniform(0.5, 0.8))
        self._turns = float(rng.uniform(3, 15))
        self._tilt = float(rng.uniform(-2, 2))

    @override
    def params(self) -> dict[str, Any]:
        return {"electrons": self.size, "duty": self._duty, "turns_per_frame": self._turns}

    @override
    def expose(self, charge: Charge, moment: Moment) -> None:
        rng = self.rng(10 + moment.index)
        if rng.uniform() > self._duty:
            return
        height, width = moment.sight.shape
        row, column = (g.ravel() for g in np.meshgrid(np.arange(height) / height, np.arange(width) / width, indexing="ij"))
        beat = 2 * np.pi * (self._turns * row + self._tilt * column)
        envelope = np.clip(np.sin(2 * np.pi * (rng.uniform(0.5, 1.5) * row + rng.uniform())) + 0.4, 0, None)
        albedo = np.where(moment.sight.main.face >= 0, moment.world.soup.albedo[moment.sight.main.face], 0.0)
        light = self.size * albedo / 0.5 * envelope
        taps: Float = np.stack([light * (1 + np.cos(beat + rng.uniform(0, 2 * np.pi))) for _ in range(4)])
        charge.extra = taps if charge.extra is None else charge.extra + taps
