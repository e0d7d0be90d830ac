# SPDX-License-Identifier: Apache-2.0
"""A simulator's session against a real one: which effects the simulator lacks, exaggerates or adds, and how far the distance shrinks.

Each session is diagnosed at its own poses. The effects fitted to the simulator are evaluated on the real session's views and compared
with the real camera's effects there, so the poses of both sessions need not agree.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.config import param
from tof_core.shares import in_percent
from tof_gap.seen.rendered import rendered_bias
from tof_gap.tell.lost_and_noise import loss_apart, noise_apart
from tof_gap.tell.report import sensor_model
from tof_gap.tell.shrink import blocks, measure
from tof_sensor.effect import Evidence
from tof_sensor.effects.fixed_pattern import FixedPattern

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_core.arrays import Float
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_gap.tell.shrink import Shrink
    from tof_sensor.effect import Effect
    from tof_sensor.frame import Frame
    from tof_sensor.model import SensorModel

LACKS, SUPERFLUOUS, WEAK, STRONG, OTHER = "lacks", "reality has not", "understates", "exaggerates", "has it in another form"
"""What a simulator does with an effect."""


@dataclass(frozen=True, slots=True)
class AgainstLimits:
    """From which size a difference of simulator and camera is stated."""

    shrink: float = param(
        0.05,
        "share of the squared distance that a corrected effect must remove",
        low=0.0,
        high=1.0,
        why="two fits of one camera differ by less",
    )
    alike: float = param(
        0.9, "correlation of two maps of one effect from which only their sizes differ", low=0.0, high=1.0, why="forms are never exact"
    )
    pattern: float = param(
        2.0,
        "squared difference of two fixed patterns, over the variance of both fits",
        low=1.0,
        why="two fits of one camera differ by just that variance",
    )
    noise: float = param(1.25, "ratio of the two noises from which they differ", low=1.0, why="noise is known to 10 % in each session")
    loss: float = param(
        0.01,
        "difference of the two shares of lost pixels from which they differ",
        low=0.0,
        high=1.0,
        why="edges lose some tenths of a per cent",
    )


@dataclass(frozen=True, slots=True)
class Difference:
    """One effect in which simulator and camera differ.

    real_mm, simulated_mm: RMS of the effect over the real session's pixels (noise: median of one capture; loss: NaN); parts: RMS in mm of their
    difference by part; shrink: share of the squared distance that disappears once this effect is corrected, None where it changes no mean depth;
    note: the size in words, where it is no bias.
    """

    effect: str
    simulator: str
    real_mm: float
    simulated_mm: float
    parts: dict[str, float]
    shrink: float | None
    ci95: tuple[float, float] | None
    note: str = ""

    def line(self) -> str:
        """The difference in words."""
        if self.note:
            return f"simulator {self.simulator}: {self.effect} ({self.note})"
        gone = "" if self.shrink is None else f"; once corrected, {in_percent(self.shrink)} of the squared distance disappears"
        most = sorted(self.parts, key=self.parts.__getitem__, reverse=True)[:3]
        where = ", ".join(f"{part} {self.parts[part]:.1f} mm" for part in most)
        return (
            f"simulator {self.simulator}: {self.effect} ({self.real_mm:.2f} mm real, {self.simulated_mm:.2f} mm simulated; {where}){gone}"
        )


@dataclass(frozen=True, slots=True)
class Against:
    """Real against simulated: the distance before and after every effect is corrected, and the effects in which they differ."""

    distance: Shrink
    differences: tuple[Difference, ...]

    @property
    def verdict(self) -> tuple[str, ...]:
        """Names of the effects in which they differ; `none` without any."""
        return tuple(sorted({d.effect for d in self.differences})) or ("none",)

    def lines(self) -> list[str]:
        """The comparison in words."""
        d = self.distance
        head = (
            f"distance of simulator and camera on held-out views: {d.above_mm(d.before):.2f} mm RMS above the noise of {d.floor_mm:.2f} mm"
        )
        after = f"with every effect corrected: {d.above_mm(d.after):.2f} mm"
        return (
            [head, after, *(x.line() for x in self.differences)] if self.differences else [head, "the simulator has the camera's effects"]
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; NaN becomes null."""
        d = self.distance
        rows = [
            {
                "effect": x.effect,
                "simulator": x.simulator,
                "real_mm": _number(x.real_mm),
                "simulated_mm": _number(x.simulated_mm),
                "parts_mm": x.parts,
                "shrink": x.shrink,
                "shrink_ci95": None if x.ci95 is None else list(x.ci95),
                "note": x.note,
            }
            for x in self.differences
        ]
        distance = {"before_mm": d.above_mm(d.before), "after_mm": d.above_mm(d.after), "floor_mm": d.floor_mm, "shrink": d.shrink}
        return {"verdict": list(self.verdict), "distance": distance, "differences": rows}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def against(real: Diagnosis, simulated: Diagnosis, parts: Sequence[str], limits: AgainstLimits | None = None) -> Against:
    """Compare two diagnosed sessions of one scene.

    Args:
        real: the camera's session.
        simulated: the simulator's.
        parts: names of the scene's parts, in the scene's order.
        limits: when they differ.
    """
    limits = limits or AgainstLimits()
    pair = _Pair(real, sensor_model(real), sensor_model(simulated), tuple(parts), limits, simulated.account.figures.unsure2)
    names = sorted({*pair.real_maps, *pair.simulated_maps})
    biases = [d for name in names if (d := pair.difference(name)) is not None]
    return Against(pair.distance(names), (*sorted(biases, key=lambda d: -(d.shrink or 0.0)), *pair.noise_and_loss()))


class _Pair:
    """The maps of both sessions' effects on the real session's held-out views."""

    def __init__(
        self,
        real: Diagnosis,
        camera: SensorModel,
        simulator: SensorModel,
        parts: tuple[str, ...],
        limits: AgainstLimits,
        unsure2: Float,
    ) -> None:
        self.real, self.camera, self.simulator, self.parts, self.limits = real, camera, simulator, parts, limits
        figures = real.account.figures
        self.held, self.figures, self.unsure2 = figures.held, figures, figures.unsure2 + unsure2
        self.frames = [self._in_simulators_unit(real.evidence[v].frame) for v in self.held]
        self.residual = [figures.residual[v] for v in self.held]
        self.seen = [np.isfinite(r) for r in self.residual]
        self.simulated_maps: dict[str, list[Float]] = {}
        for effect in simulator.effects:
            if effect.EVIDENCE is Evidence.BIAS:
                maps = [np.nan_to_num(self._map(effect, i)) for i in range(len(self.held))]
                before = self.simulated_maps.get(effect.NAME)
                self.simulated_maps[effect.NAME] = maps if before is None else [a + b for a, b in zip(before, maps, strict=True)]
        suspected = set(real.account.solved.maps) if real.doubted else set[str]()  # Not in sensor.yaml either.
        asserted = {name: share for name, share in figures.maps.items() if name not in suspected}
        self.real_maps = {name: [np.nan_to_num(share[v]) for v in self.held] for name, share in asserted.items()}
        self._same_names()

    def _map(self, effect: Effect, place: int) -> Float:
        """(H, W) metres that an effect of the simulator adds to a held-out view, computed as for the camera's own effects."""
        v, frame, real = self.held[place], self.frames[place], self.real
        view = replace(real.evidence[v], frame=frame)
        if effect.mount is None and effect.camera(frame.camera) == frame.camera:
            return effect.bias(frame)
        caster, other_m = frame.context.caster, 1e-3 * real.config.solve.joint.other_surface_mm
        assert caster is not None, "evidence is seen in a scene"
        return rendered_bias(effect, view, v, real.account.solved.chain, caster, other_m)

    def _in_simulators_unit(self, frame: Frame) -> Frame:
        """A real frame with the amplitude that the simulator's camera would have."""
        ratio = self.simulator.gain / self.camera.gain if self.simulator.gain and self.camera.gain else 1.0
        return replace(frame, amplitude=ratio * frame.amplitude)

    def _same_names(self) -> None:
        """Where one session ties an effect with one that the other session names, both take the same name."""
        for cause in self.real.causes:
            name = cause.named.name
            for tie in cause.named.ties:
                if name in self.real_maps and name not in self.simulated_maps and tie in self.simulated_maps and tie not in self.real_maps:
                    self.simulated_maps[name] = self.simulated_maps.pop(tie)

    def _zero(self) -> list[Float]:
        return [np.zeros(r.shape) for r in self.residual]

    def apart(self, name: str) -> list[Float]:
        """(H, W) metres by which the camera has more of an effect than the simulator, per view."""
        return [a - b for a, b in zip(self.real_maps.get(name, self._zero()), self.simulated_maps.get(name, self._zero()), strict=True)]

    def distance(self, names: Sequence[str]) -> Shrink:
        """Camera minus simulator on the held-out views, before and after these effects are corrected."""
        simulated = [np.sum([z, *(m[i] for m in self.simulated_maps.values())], axis=0) for i, z in enumerate(self._zero())]
        before = [r - s for r, s in zip(self.residual, simulated, strict=True)]
        change = [np.sum([z, *(self.apart(n)[i] for n in names)], axis=0) for i, z in enumerate(self._zero())]
        after = [b - c for b, c in zip(before, change, strict=True)]
        floors = [self.real.floor2[v] for v in self.held]
        limits = self.figures.limits
        return measure(blocks(before, after, floors, limits.block_px), np.random.default_rng(0), limits.shrink)

    def difference(self, name: str) -> Difference | None:
        """One effect; None where its correction changes little."""
        found = self.distance([name])
        if found.shrink is None or found.ci95 is None or found.shrink < self.limits.shrink or found.ci95[0] <= 0:
            return None
        if name == FixedPattern.NAME and not self._patterns_differ():
            return None
        real, simulated = (self._pixels(m.get(name, self._zero())) for m in (self.real_maps, self.simulated_maps))
        size = [1e3 * float(np.sqrt(np.mean(x * x))) for x in (real, simulated)]
        return Difference(name, self._manner(name, real, simulated), size[0], size[1], self._by_part(name), found.shrink, found.ci95)

    def _patterns_differ(self) -> bool:
        """Whether two patterns differ by more than the errors of their fits: an offset has the noise of the mean over its views."""
        length = self.frames[0].length
        chance = self._pixels([self.unsure2 / length**2 for _ in self.held])
        return float(np.mean(self._pixels(self.apart(FixedPattern.NAME)) ** 2)) > self.limits.pattern * float(np.mean(chance))

    def _pixels(self, maps: Sequence[Float]) -> Float:
        return np.concatenate([m[s] for m, s in zip(maps, self.seen, strict=True)])

    def _manner(self, name: str, real: Float, simulated: Float) -> str:
        if name not in self.simulated_maps:
            return LACKS
        if name not in self.real_maps:
            return SUPERFLUOUS
        energy, both = float(simulated @ simulated), float(real @ simulated)
        if both < self.limits.alike * np.sqrt(energy * float(real @ real)):
            return OTHER
        return WEAK if both > energy else STRONG

    def _by_part(self, name: str) -> dict[str, float]:
        apart = self._pixels(self.apart(name))
        part = np.concatenate([self.real.evidence[v].rendering.part[s] for v, s in zip(self.held, self.seen, strict=True)])
        rows = {self.parts[i]: apart[part == i] for i in np.unique(part) if i >= 0}
        return {k: 1e3 * float(np.sqrt(np.mean(x * x))) for k, x in rows.items()}

    def noise_and_loss(self) -> tuple[Difference, ...]:
        """Noise and loss of camera and simulator at the amplitudes of the real session."""
        views, parts = [self.real.evidence[v] for v in self.held], self.parts
        frames: Mapping[str, Any] = {"real": [v.frame for v in views], "simulated": self.frames}
        found = (
            noise_apart(self.camera, self.simulator, frames["real"], frames["simulated"], self.seen, parts),
            loss_apart(self.camera, self.simulator, frames["real"], frames["simulated"], parts),
        )
        out = []
        if (noise := found[0]) is not None and not 1 / self.limits.noise < noise.ratio < self.limits.noise:
            manner = STRONG if noise.ratio > 1 else WEAK
            note = f"{noise.real:.2f} mm real, {noise.simulated:.2f} mm simulated in one capture"
            out.append(Difference("noise", manner, noise.real, noise.simulated, noise.parts, None, None, note))
        if (loss := found[1]) is not None and abs(loss.real - loss.simulated) > self.limits.loss:
            note = f"{in_percent(loss.real)} of the pixels real, {in_percent(loss.simulated)} simulated"
            none = {(True, False): LACKS, (False, True): SUPERFLUOUS}
            manner = none.get((loss.real > 0, loss.simulated > 0), STRONG if loss.simulated > loss.real else WEAK)
            out.append(Difference("dropout", manner, np.nan, np.nan, loss.parts, None, None, note))
        return tuple(out)
