# SPDX-License-Identifier: Apache-2.0
"""Effects on the output: offsets, wrapped phase, noise, losses, units and rounding."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from typing_extensions import override

from tof_virtual.effect import UNIT_M, Effect, Frame, Moment
from tof_virtual.pipeline import expose
from tof_virtual.taps import metres_per_radian

if TYPE_CHECKING:
    from tof_core.arrays import Float, Mask
    from tof_virtual.session import Session


class RangeOffset(Effect):
    """All distances are too long, or too short, by one constant."""

    name, unit, start = "range_offset", "m", UNIT_M

    @override
    def draw(self, rng: np.random.Generator) -> None:
        self._sign = float(rng.choice([-1, 1]))

    @override
    def params(self) -> dict[str, Any]:
        return {"offset_m": self._sign * self.size}

    @override
    def disturb(self, distance: Float, amplitude: Float, moment: Moment) -> Float:
        return np.asarray(distance + self._sign * self.size)


@dataclass(frozen=True, slots=True)
class Threshold:
    """A soft bound: half of the pixels at `at` are selected, nearly all of those `width` beyond."""

    at: float
    width: float

    def probability(self, values: Float) -> Float:
        """Selected share (P,) where `values` lie below the bound."""
        return np.asarray(1 / (1 + np.exp(np.clip((values - self.at) / self.width, -50, 50))))


def low_amplitude(session: Session, share: float) -> Threshold:
    """Amplitude (its logarithm) below which `share` of the session's valid pixels lie."""
    indices = np.unique(np.linspace(0, len(session.shutters) - 1, 5).astype(int))
    frames = [expose(session.moment(int(i), ()), ()) for i in indices]
    logs = np.concatenate([np.log(f.amplitude[np.isfinite(f.depth)]) for f in frames])
    return Threshold(float(np.quantile(logs, min(share, 0.9))), 0.06)


def blobs(rng: np.random.Generator, shape: tuple[int, int], share: float) -> Mask:
    """Random patches (P,) that cover about `share` of the image."""
    height, width = shape
    v, u = np.mgrid[:height, :width]
    out = np.zeros(shape, bool)
    while out.mean() < share:
        a, b, angle = *(width * rng.uniform(0.02, 0.08, 2)), rng.uniform(0, np.pi)
        x, y = u - rng.uniform(0, width), v - rng.uniform(0, height)
        p, q = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
        out |= (p / a) ** 2 + (q / b) ** 2 < 1
    return np.asarray(out.ravel())


class PhaseWrap(Effect):
    """The coarse frequency picks a wrong lobe: whole unambiguous ranges are added, at weak pixels or in patches."""

    name, unit, start = "phase_wrap", "share of the pixels", 0.05
    local = natural = True

    @override
    def draw(self, rng: np.random.Generator) -> None:
        self._weak = bool(rng.uniform() < 0.5)
        self.size = min(self.size, 0.4)

    @override
    def prepare(self, session: Session) -> None:
        self._threshold = low_amplitude(session, self.size)

    @override
    def params(self) -> dict[str, Any]:
        return {"share": self.size, "where": "weak" if self._weak else "patches"}

    @override
    def disturb(self, distance: Float, amplitude: Float, moment: Moment) -> Float:
        rng = self.rng(10 + moment.index)
        if self._weak:
            wrong = rng.uniform(size=distance.size) < self._threshold.probability(np.log(np.maximum(amplitude, 1)))
        else:
            wrong = blobs(rng, moment.sight.shape, self.size)
        lobe = 2 * np.pi * metres_per_radian(moment.config.camera.modulation_mhz)
        down = wrong & (distance > lobe + 0.1)
        return np.where(down, distance - lobe, np.where(wrong, distance + lobe, distance))


class Noise(Effect):
    """Noise that no photon law predicts: the same at all amplitudes, in bursts, by rows, or of a few unstable pixels."""

    name, unit, start = "noise", "m", UNIT_M
    natural = True
    kind = "scatter"

    @override
    def draw(self, rng: np.random.Generator) -> None:
        self._manner = str(rng.choice(["floor", "bursts", "rows", "telegraph"]))
        shape = (self.config.camera.height, self.config.camera.width)
        self._unstable = rng.uniform(size=shape).ravel() < 0.05

    @override
    def params(self) -> dict[str, Any]:
        return {"manner": self._manner, "sigma_m": self.size}

    def _burst(self, rng: np.random.Generator) -> float:
        """Relative noise of a capture (mean square about 1)."""
        return 1.6 if rng.uniform() < 0.39 else 0.05

    @override
    def level(self, moment: Moment) -> Float:
        sigma = np.full(moment.sight.z.size, self.size)
        if self._manner == "bursts":
            sigma *= self._burst(self.rng(10 + moment.index))
        elif self._manner == "telegraph":
            sigma *= np.where(self._unstable, np.sqrt(20), 0.0)
        return np.where(np.isfinite(moment.sight.z), sigma, np.nan)

    @override
    def add_noise(self, distance: Float, amplitude: Float, moment: Moment) -> Float:
        rng = self.rng(10 + moment.index)
        factor = self._burst(rng) if self._manner == "bursts" else 1.0
        pixel = rng.standard_normal(distance.size)
        if self._manner == "rows":
            height, width = moment.sight.shape
            pixel = 0.5 * pixel + np.sqrt(0.75) * np.repeat(rng.standard_normal(height), width)
        elif self._manner == "telegraph":
            pixel = np.where(self._unstable, np.sqrt(20) * np.sign(pixel), 0.0)
        return np.asarray(distance + self.size * factor * pixel)


class Dropout(Effect):
    """Pixels are missing: weak ones, patches, or any; a strength of 1 loses a tenth."""

    name, unit, start = "dropout", "share of the pixels", 0.1
    local = natural = True
    kind = "loss"

    @override
    def draw(self, rng: np.random.Generator) -> None:
        self._where = str(rng.choice(["weak", "patches", "any"], p=[0.5, 0.3, 0.2]))
        self.size = min(self.size, 0.6)

    @override
    def prepare(self, session: Session) -> None:
        self._threshold = low_amplitude(session, self.size)

    @override
    def params(self) -> dict[str, Any]:
        return {"share": self.size, "where": self._where}

    def _probability(self, frame: Frame, moment: Moment) -> Float:
        if self._where == "weak":
            return self._threshold.probability(np.log(np.maximum(frame.amplitude, 1)))
        if self._where == "patches":
            return blobs(self.rng(10 + moment.view), moment.sight.shape, self.size).astype(float)
        return np.full(frame.depth.size, self.size)

    @override
    def lose(self, frame: Frame, moment: Moment) -> Mask:
        chance = self.rng(1000 + moment.index).uniform(size=frame.depth.size)
        return np.asarray(chance < self._probability(frame, moment))

    @override
    def level(self, moment: Moment) -> Float:
        frame = expose(moment, ())
        return np.where(np.isfinite(frame.depth), self._probability(frame, moment), np.nan)


class RadialDepth(Effect):
    """The distance along the ray is stored where depth along the axis is declared."""

    name, unit = "radial_depth", "on"
    natural = True

    @override
    def draw(self, rng: np.random.Generator) -> None:
        self.size = 1.0

    @override
    def finish(self, depth: Float, moment: Moment) -> Float:
        return np.asarray(depth * moment.sight.length)


class DepthScale(Effect):
    """Depth is stored in a unit slightly different from the millimetre."""

    name, unit, start, limit = "depth_scale", "share", 0.004, 0.2

    @override
    def draw(self, rng: np.random.Generator) -> None:
        self._sign = float(rng.choice([-1, 1]))

    @override
    def params(self) -> dict[str, Any]:
        return {"scale": 1 + self._sign * self.size}

    @override
    def finish(self, depth: Float, moment: Moment) -> Float:
        return np.asarray(depth * (1 + self._sign * self.size))


class Quantization(Effect):
    """Depth is rounded to a coarse step; a strength of 1 rounds with 3 mm RMS."""

    name, unit, start = "quantization", "m", float(np.sqrt(12) * UNIT_M)
    natural = True

    @override
    def params(self) -> dict[str, Any]:
        return {"step_m": self.size}

    @override
    def finish(self, depth: Float, moment: Moment) -> Float:
        return np.asarray(np.round(depth / self.size) * self.size)
