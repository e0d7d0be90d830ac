# SPDX-License-Identifier: Apache-2.0
"""Maps of a camera's and a simulator's effects on the same views, and in which effects they differ."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.compare.difference import LACKS, OTHER, STRONG, SUPERFLUOUS, WEAK, AgainstLimits, Difference
from tof_gap.compare.poses_free import shown
from tof_gap.seen.rendered import rendered_bias
from tof_gap.tell.figures.shrink import blocks, measure, surely_removed
from tof_sensor.effect import Evidence
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.effects.flying_pixels import FlyingPixels
from tof_sensor.effects.phase_wrap import PhaseWrap

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_core.arrays import Float
    from tof_gap.compare.difference import Apart
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_gap.tell.figures.shrink import HeldOut, Shrink
    from tof_sensor.effect import Effect
    from tof_sensor.frame import Frame
    from tof_sensor.model import SensorModel

OF_SINGLE_PIXELS = frozenset({FlyingPixels.NAME, PhaseWrap.NAME})
"""Effects of single pixels, at edges or by chance: shares of pixels are compared, not maps."""


class Pair:
    """The maps of both sessions' effects on the real session's held-out views."""

    def __init__(
        self,
        real: Diagnosis,
        camera: SensorModel,
        simulator: SensorModel,
        parts: tuple[str, ...],
        limits: AgainstLimits,
        unsure2: Float,
        known: Sequence[Effect] = (),
    ) -> None:
        """Evaluate the effects of both.

        Args:
            real: the camera's session.
            camera: what was found in the real session.
            simulator: what was found in the simulator's.
            parts: names of the scene's parts.
            limits: when they differ.
            unsure2: (H, W) m^2 along the ray, variance of the error of the simulator's fixed pattern.
            known: effects whose bias was removed from both sessions before they were diagnosed.
        """
        self.real, self.camera, self.simulator, self.parts, self.limits = real, camera, simulator, parts, limits
        figures = real.account.figures
        self.held, self.figures, self.unsure2 = figures.held, figures, figures.unsure2 + unsure2
        self.frames = [self._in_simulators_unit(real.evidence[v].frame) for v in self.held]
        # Mixed and wrapped pixels have no map that another session shares: `levels_apart` compares them.
        self.residual = [np.where(real.evidence[v].smooth, figures.residual[v], np.nan) for v in self.held]
        self.seen = [np.isfinite(r) for r in self.residual]
        self.simulated_maps = self._maps(simulator.effects, self.frames)
        suspected = set(real.account.solved.maps) if real.doubted else set[str]()  # Not in sensor.yaml either.
        asserted = {name: share for name, share in figures.maps.items() if name not in suspected | OF_SINGLE_PIXELS}
        self.real_maps = {name: [np.nan_to_num(share[v]) for v in self.held] for name, share in asserted.items()}
        removed = self._maps(known, [real.evidence[v].frame for v in self.held])
        self.known = [np.sum([z, *(m[i] for m in removed.values())], axis=0) for i, z in enumerate(self._zero())]
        for name, maps in removed.items():
            for side in (self.real_maps, self.simulated_maps):
                side[name] = [a + b for a, b in zip(side.get(name, self._zero()), maps, strict=True)]

    @property
    def names(self) -> list[str]:
        """Effects of either side, sorted."""
        return sorted({*self.real_maps, *self.simulated_maps})

    def _maps(self, effects: Sequence[Effect], frames: Sequence[Frame]) -> dict[str, list[Float]]:
        """(H, W) metres on each held-out view by effects in whose unit of amplitude the frames are; those of one name are summed."""
        out: dict[str, list[Float]] = {}
        for effect in effects:
            if effect.EVIDENCE is Evidence.BIAS and effect.NAME not in OF_SINGLE_PIXELS:
                maps = [np.nan_to_num(self._map(effect, i, frame)) for i, frame in enumerate(frames)]
                before = out.get(effect.NAME)
                out[effect.NAME] = maps if before is None else [a + b for a, b in zip(before, maps, strict=True)]
        return out

    def _map(self, effect: Effect, place: int, frame: Frame) -> Float:
        """(H, W) metres that an effect adds to a held-out view, computed as for the camera's own effects."""
        v, real = self.held[place], self.real
        view = replace(real.evidence[v], frame=frame)
        if effect.mount is None and effect.camera(frame.camera) == frame.camera:
            return effect.bias(frame)
        caster, other_m = frame.context.caster, 1e-3 * real.config.solve.joint.other_surface_mm
        assert caster is not None, "evidence is seen in a scene"
        return rendered_bias(effect, view, v, real.account.solved.chain, caster, other_m)

    @property
    def light(self) -> float:
        """Amplitude of one albedo in the simulator's session, over that in the camera's."""
        return self.simulator.gain / self.camera.gain if self.simulator.gain and self.camera.gain else 1.0

    @property
    def unit(self) -> float:
        """The simulator's unit of amplitude over the camera's: 1 where stated albedos are too uncertain to tell them apart."""
        return 1.0 if 1 / self.limits.unit < self.light < self.limits.unit else self.light

    def _in_simulators_unit(self, frame: Frame) -> Frame:
        """A real frame with the amplitude that the simulator's camera would have."""
        return replace(frame, amplitude=self.unit * frame.amplitude)

    def renamed(self, taken: Mapping[str, str]) -> None:
        """Both sessions' effects under the names by which they are compared."""
        self.real_maps, self.simulated_maps = (
            {taken.get(name, name): maps for name, maps in side.items()} for side in (self.real_maps, self.simulated_maps)
        )

    def shown(self, names: Sequence[str]) -> dict[str, float]:
        """Share of each difference that the session's views show whatever their poses are; NaN where poses could hide it."""
        if not names:
            return {}
        floors = [self.real.floor2[v] for v in self.held]
        found = shown(self._before(), [self.apart(n) for n in names], floors, [self.real.evidence[v].frame for v in self.held])
        return dict(zip(names, found, strict=True))

    @property
    def frames_seen(self) -> list[Frame]:
        """The held-out views, in the real camera's unit of amplitude."""
        return [self.real.evidence[v].frame for v in self.held]

    def _zero(self) -> list[Float]:
        return [np.zeros(r.shape) for r in self.residual]

    def apart(self, name: str) -> list[Float]:
        """(H, W) metres by which the camera has more of an effect than the simulator, per view."""
        return [a - b for a, b in zip(self.real_maps.get(name, self._zero()), self.simulated_maps.get(name, self._zero()), strict=True)]

    def distance(self, names: Sequence[str]) -> Shrink:
        """Camera minus simulator on the held-out views, before and after these effects are corrected."""
        return measure(self._corrected(names), np.random.default_rng(0), self.figures.limits.shrink)

    def _corrected(self, names: Sequence[str]) -> HeldOut:
        """Camera minus simulator by block, before and after these effects are corrected."""
        before = self._before()
        change = [np.sum([z, *(self.apart(n)[i] for n in names)], axis=0) for i, z in enumerate(self._zero())]
        after = [b - c for b, c in zip(before, change, strict=True)]
        floors = [self.real.floor2[v] for v in self.held]
        return blocks(before, after, floors, self.figures.limits.block_px)

    def _before(self) -> list[Float]:
        """(H, W) metres per held-out view: camera minus simulator, NaN where a pixel does not count."""
        simulated = [np.sum([z, *(m[i] for m in self.simulated_maps.values())], axis=0) for i, z in enumerate(self._zero())]
        return [r + k - s for r, k, s in zip(self.residual, self.known, simulated, strict=True)]

    def fill(self, name: str, real: float, simulated: float) -> None:
        """Give the session whose diagnosis did not name an effect the other's map, in the ratio of both sizes, whose squares are stated."""
        if name not in self.simulated_maps:
            self.simulated_maps[name] = [np.sqrt(simulated / real) * m for m in self.real_maps[name]]
        elif name not in self.real_maps:
            self.real_maps[name] = [np.sqrt(real / simulated) * m for m in self.simulated_maps[name]]

    def add(self, name: str, own: list[Float] | None, other: list[Float] | None) -> None:
        """Give the real and the simulated session an effect that no diagnosis named: its map in each held-out view, None without it."""
        for side, maps in ((self.real_maps, own), (self.simulated_maps, other)):
            if maps is not None:
                side[name] = maps

    def by_coefficients(self, name: str, found: Apart) -> Difference | None:
        """One effect by its coefficients in both sessions; None where they agree, or differ by little."""
        if not found.differs or found.within_maps or found.share < self.limits.shrink or found.ratio < self.limits.apart:
            return None
        has = name in self.real_maps, name in self.simulated_maps
        real, simulated = self.sizes_mm(name)
        manner = {(True, False): LACKS, (False, True): SUPERFLUOUS}.get(has) or self._manner(found.real, found.simulated, found.both)
        shrink = self.distance([name])
        known = shrink.shrink is not None and shrink.ci95 is not None and shrink.shrink > 0.0
        share = (max(shrink.ci95[0], 0.0), shrink.ci95[1]) if known and shrink.ci95 is not None else None
        return Difference(name, manner, real, simulated, self._by_part(name), shrink.shrink if known else None, share)

    def difference(self, name: str, *, of_size: bool = True) -> Difference | None:
        """One effect by its maps in both; None where its correction changes little.

        of_size: whether the difference is also compared with the effect's size; not where the effect is known to differ in a unit of its own.
        """
        corrected, limits = self._corrected([name]), self.figures.limits.shrink
        found = measure(corrected, np.random.default_rng(0), limits)
        if found.shrink is None or found.ci95 is None or found.shrink < self.limits.shrink:
            return None
        if not surely_removed(corrected, np.random.default_rng(0), limits):
            return None
        if name == FixedPattern.NAME and not self._patterns_differ():
            return None
        real, simulated = (self._pixels(m.get(name, self._zero())) for m in (self.real_maps, self.simulated_maps))
        if of_size and np.sum((real - simulated) ** 2) < self.limits.apart**2 * max(real @ real, simulated @ simulated):
            return None
        size = [1e3 * float(np.sqrt(np.mean(x * x))) for x in (real, simulated)]
        share = (max(found.ci95[0], 0.0), found.ci95[1])
        manner = self._manner(float(real @ real), float(simulated @ simulated), float(real @ simulated))
        return Difference(name, manner, size[0], size[1], self._by_part(name), found.shrink, share)

    def sizes_mm(self, name: str) -> tuple[float, float]:
        """RMS in mm of an effect of the real and of the simulated session."""
        return self._rms_mm(self.real_maps.get(name, self._zero())), self._rms_mm(self.simulated_maps.get(name, self._zero()))

    def _rms_mm(self, maps: Sequence[Float]) -> float:
        return 1e3 * float(np.sqrt(np.mean(self._pixels(maps) ** 2)))

    def _patterns_differ(self) -> bool:
        """Whether two patterns differ by more than the errors of their fits: an offset has the noise of the mean over its views."""
        length = self.frames[0].length
        chance = self._pixels([self.unsure2 / length**2 for _ in self.held])
        return float(np.mean(self._pixels(self.apart(FixedPattern.NAME)) ** 2)) > self.limits.pattern * float(np.mean(chance))

    def _pixels(self, maps: Sequence[Float]) -> Float:
        return np.concatenate([m[s] for m, s in zip(maps, self.seen, strict=True)])

    def _manner(self, own: float, energy: float, both: float) -> str:
        """What the simulator does with an effect of squared size `own` in the real session and `energy` in the simulated, and of product `both`.

        In another form if form makes more of the difference than size.
        """
        if energy < self.limits.absent**2 * own:
            return LACKS
        if own < self.limits.absent**2 * energy:
            return SUPERFLUOUS
        # |a - b|^2 = (|a| - |b|)^2 + 2 (|a| |b| - a.b): what the sizes make, and what is left once both have one size.
        by_size, by_form = (np.sqrt(own) - np.sqrt(energy)) ** 2, 2.0 * (np.sqrt(own * energy) - both)
        if by_form > by_size:
            return OTHER
        return WEAK if own > energy else STRONG

    def _by_part(self, name: str) -> dict[str, float]:
        apart = self._pixels(self.apart(name))
        part = np.concatenate([self.real.evidence[v].rendering.part[s] for v, s in zip(self.held, self.seen, strict=True)])
        rows = {self.parts[i]: apart[part == i] for i in np.unique(part) if i >= 0}
        return {k: 1e3 * float(np.sqrt(np.mean(x * x))) for k, x in rows.items()}
