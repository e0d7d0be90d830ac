# SPDX-License-Identifier: Apache-2.0
"""What one joint solution says of a session: its causes, what else shows beside them, and how far the gap shrinks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core.memory import give_back
from tof_gap.seen import detected, missing, noise
from tof_gap.seen.foreign_lamp import foreign_lamp
from tof_gap.seen.foreign_light import along_the_view, drifts_by_chance, foreign_light
from tof_gap.tell.figures import figures
from tof_sensor.effect import Evidence
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.effects.temperature_drift import TemperatureDrift

if TYPE_CHECKING:
    from collections.abc import Sequence
    from collections.abc import Set as AbstractSet

    from tof_gap.config import GapConfig
    from tof_gap.limits.seen import ForeignLightLimits
    from tof_gap.seen.finding import Finding
    from tof_gap.solved import Named, Solved
    from tof_gap.tell.figures import Figures
    from tof_gap.tell.shrink import Shrink
    from tof_sensor.effects.photon_law import PhotonLaw


@dataclass(frozen=True, slots=True, eq=False)
class Cause:
    """One effect of the verdict with what it does on held-out views; size_m: RMS over the pixels that it affects."""

    named: Named
    alone: Shrink
    left_out: float | None
    size_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Account:
    """Everything that is read off one solution.

    causes: effects of the solution with what each does on held-out views; findings: effects that noise, loss or edges show;
    figures: the arrays behind every figure; gap: before and after all effects that are asserted; pushed: whether arm errors along
    the view exceed what the robot's prior allows, with nothing that explains it.
    """

    solved: Solved
    causes: tuple[Cause, ...]
    findings: tuple[Finding, ...]
    figures: Figures
    gap: Shrink
    pushed: bool = False

    def names(self, *, causes: bool) -> set[str]:
        """Name of every finding, and verdict of every cause, where `causes` and what was read off structure may be asserted."""
        return {*(c.named.verdict for c in self.causes if causes), *(f.name for f in self.findings if causes or not f.structure)}

    @property
    def worsens(self) -> str | None:
        """The cause without which the held-out gap shrinks most and by `worsens` more: it was fitted to another effect's errors."""
        if self.gap.shrink is None:
            return None
        without = {c.named.name: c.left_out - self.gap.shrink for c in self.causes if c.left_out is not None}
        worst = max(without, key=without.__getitem__, default=None)
        return worst if worst is not None and without[worst] > self.figures.limits.shrink.worsens else None


def account(
    solved: Solved,
    config: GapConfig,
    rng: np.random.Generator,
    *,
    along_ray: Finding | None = None,
    given: Sequence[Finding] = (),
    alone: bool = False,
    left_out: AbstractSet[str] = frozenset(),
    law: PhotonLaw | None = None,
) -> Account:
    """Read a solution off its views.

    Args:
        solved: poses and effects.
        config: when noise and loss are effects.
        rng: for resampling.
        along_ray: distance along the ray taken for depth, where the first poses showed it.
        given: what was found before depth was fitted. The shares of both were taken off the views and belong to the residual.
        alone: `along_ray` and `given` are all that may be named (too few views).
        left_out: effects that may not be named.
        law: the camera's photon law, where it is known.
    """
    give_back()
    gated = tuple(given) if along_ray is None else (*given, along_ray)
    findings = gated if alone else (*gated, *_findings(solved, config, law, left_out))
    counted = figures(solved, findings, rng, config.report)
    for share in (f.share for f in gated if f.share is not None):
        counted = replace(counted, residual=[r + added for r, added in zip(counted.residual, share, strict=True)])
    gap = _gap(counted, findings, list(counted.maps))
    causes = tuple(
        Cause(n, counted.shrink([n.name]), counted.shrink([m for m in counted.maps if m != n.name]).shrink, solved.sizes[n.name])
        for n in solved.named
    )
    silent = alone or _arms_silent(solved, left_out) or any(isinstance(f.effect, Interference) for f in findings)
    pushed = not silent and along_the_view(solved.arms, solved.arms_sd, config.noise.foreign_light)
    return Account(solved, causes, findings, counted, gap, pushed)


def unfounded(found: Account, limits: ForeignLightLimits) -> str | None:
    """The cause to be taken out: a drift over time that foreign light would show by chance, else the one that worsens the gap."""
    drift = found.solved.maps.get(TemperatureDrift.NAME)
    chance = drift is not None and drifts_by_chance(drift, found.figures.posed_m, limits)
    return TemperatureDrift.NAME if chance else found.worsens


def without_causes(found: Account) -> Account:
    """The account whose gap shrinks by its findings alone: causes that are only suspected promise nothing.

    Findings read off structure are taken out: the structure is that of what has no name.
    """
    names = [name for name in found.figures.maps if name not in found.solved.maps]
    certain = tuple(f for f in found.findings if not f.structure)
    return replace(found, findings=certain, gap=_gap(found.figures, certain, names))


def _gap(counted: Figures, findings: Sequence[Finding], names: Sequence[str]) -> Shrink:
    """The gap before and after these effects; no shrink where noise and loss alone were found: no bias is there to be removed."""
    gap = counted.shrink(names)
    return replace(gap, shrink=None, ci95=None) if findings and not names else gap


def _findings(solved: Solved, config: GapConfig, law: PhotonLaw | None, left_out: AbstractSet[str]) -> tuple[Finding, ...]:
    """What noise, loss and edges show where the cameras really were, once smooth bias is removed; detectors of `left_out` do not run.

    What a filter in the camera removed is no `dropout`.
    """
    left = solved.bare
    light = detected.detected_effects(noise.without_noisy_pixels(left, config.noise), config.noise, law, left_out)
    beside = detected.explained(left, light)
    blurred = solved.names(Motion.NAME)
    silent = _arms_silent(solved, left_out) or Interference.NAME in left_out
    foreign = None if silent else foreign_light(left, solved.arms, solved.arms_sd, config.noise.foreign_light, _named_m(solved))
    if foreign is not None and foreign.posed_m < _rough_m(solved):
        foreign = None
    lamp = None if Interference.NAME in left_out else foreign_lamp(left, config.noise.foreign_lamp)
    if lamp is not None:
        foreign = replace(lamp.finding(left, config.noise.foreign_light), posed_m=0.0 if foreign is None else foreign.posed_m)
    taken = left_out if foreign is None else left_out | {Interference.NAME}
    gone = missing.missing_effects(left, config.missing, left_out, blurred=blurred)
    unmerged = any(map(_fails_to_merge, gone))
    uneven = [*([] if foreign is None else [foreign]), *noise.noise_effects(beside, config.noise, taken, law, unmerged=unmerged)]
    return (*light, *uneven, *(f for f in gone if not filtered(f, [*uneven, *gone])))


def _arms_silent(solved: Solved, left_out: AbstractSet[str]) -> bool:
    """Whether arm errors say nothing: while motion shifts edges, and where there is no arm, as then hand-eye is not considered either."""
    return solved.names(Motion.NAME) or HandEye.NAME in left_out


def _named_m(solved: Solved) -> float:
    """Metres: sizes of the named effects together."""
    return float(np.sqrt(sum(size**2 for size in solved.sizes.values())))


def _rough_m(solved: Solved) -> float:
    """Metres: what inexact maps of named effects leave (`Effect.ROUGH`), by view its own amount."""
    return float(np.sqrt(sum(n.effects[0].ROUGH * solved.sizes[n.name] ** 2 for n in solved.named if n.effects)))


def filtered(loss: Finding, beside: Sequence[Finding]) -> bool:
    """Whether loss may be that of a filter in the camera, which removes outliers of another kind.

    Outliers of noise are rare in bright light and never all there is in the dark: `dropout` neither at random nor below a threshold.
    Pixels that are unwrapped wrongly here and there are outliers wherever they are. Pixels with a noise of their own are outliers,
    the more the weaker the light, without a wrong turn.
    """
    if _removed_wraps(loss):
        return any(f.own_noise is not None for f in beside)
    if not isinstance(loss.effect, Dropout):
        return False
    makers = [f.effect for f in beside if f.effect.makes_outliers]
    return any(loss.rare or effect.EVIDENCE is not Evidence.NOISE for effect in makers)


def _removed_wraps(found: Finding) -> bool:
    """Whether it is wrapped pixels of which the camera's filter kept none: their jump is in no map."""
    return isinstance(found.effect, PhaseWrap) and not found.corrects


def _fails_to_merge(found: Finding) -> bool:
    """Whether frequencies fail to merge: jumps that one frequency alone does not make, or wrapped pixels that a filter removed."""
    return isinstance(found.effect, PhaseWrap) and (len(found.effect.others_m) > 0 or _removed_wraps(found))
