# SPDX-License-Identifier: Apache-2.0
"""What is read off one joint solution of a session: its causes, what noise, loss and edges show, and how far the gap shrinks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core.memory import give_back
from tof_gap.seen import detected
from tof_gap.seen.finding import not_expected
from tof_gap.seen.foreign.arm_steps import contents, following, over_prior, sagging
from tof_gap.seen.foreign.lamp import foreign_lamp
from tof_gap.seen.foreign.light import ALONG, along_the_view, drifts_by_chance, foreign_light
from tof_gap.seen.foreign.repeated import repeated
from tof_gap.seen.missing import effects as missing
from tof_gap.seen.missing.by_line import lost_by_lines
from tof_gap.seen.missing.by_pixel import lost_by_pixels
from tof_gap.seen.noise import effects as noise
from tof_gap.seen.noise.between_captures import as_captures_step
from tof_gap.seen.noise.own_law import own_law
from tof_gap.seen.session import session_of
from tof_gap.tell.figures.session import figures
from tof_gap.tell.outliers import fails_to_merge, hides_light, not_outliers
from tof_gap.tell.own_light import of_own_light
from tof_sensor.effects.ambient import Ambient
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.effects.temperature_drift import TemperatureDrift
from tof_sensor.effects.time_sync import TimeSync
from tof_sensor.geometry import pose_columns
from tof_sensor.stated import NOTHING_STATED

if TYPE_CHECKING:
    from collections.abc import Sequence
    from collections.abc import Set as AbstractSet

    from tof_core.arrays import Float
    from tof_gap.config import GapConfig
    from tof_gap.limits.foreign import ForeignLightLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.seen.finding import Finding
    from tof_gap.seen.noise.lines import LineNoise
    from tof_gap.solved import Named, Solved
    from tof_gap.tell.figures.session import Figures
    from tof_gap.tell.figures.shrink import Shrink
    from tof_sensor.stated import StatedNoise


@dataclass(frozen=True, slots=True, eq=False)
class Cause:
    """One effect of the solution.

    alone: the gap on held-out views before and after this effect alone; left_out: shrink by all other effects together;
    size_m: RMS in metres over the pixels that it affects.
    """

    named: Named
    alone: Shrink
    left_out: float | None
    size_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Account:
    """Everything that is read off one solution.

    causes: of the solution, that which changes depth most first, each with its figures on held-out views; findings: effects that noise, loss or edges show; figures: the
    arrays that every figure is computed from; gap: before and after all asserted effects; pushed: whether arm errors along the optical
    axis exceed the robot's prior and no named effect explains them; follows: whether they follow distance and amplitude of the views, as
    a depth error does that poses absorb; sags: whether turns of the camera follow the hand's attitude; astray: whether arm errors exceed
    the robot's prior in positions and turns, and no named effect explains them.
    """

    solved: Solved
    causes: tuple[Cause, ...]
    findings: tuple[Finding, ...]
    figures: Figures
    gap: Shrink
    pushed: bool = False
    follows: bool = False
    sags: bool = False
    astray: bool = False

    def names(self, *, causes: bool) -> tuple[str, ...]:
        """Names for the verdict: causes and findings, that which changes depth most first; without `causes`, only findings not read off structure."""
        added2 = self.figures.added2
        size2 = {c.named.verdict: added2[c.named.name] for c in self.causes if causes and not c.named.suspected}
        size2 |= {f.name: added2.get(f.name, 0.0) for f in not_expected(self.findings) if causes or not f.structure}
        return tuple(sorted(size2, key=lambda name: (-size2[name], name)))

    @property
    def worsens(self) -> str | None:
        """The cause without which the held-out gap shrinks most, if by more than `worsens`: it was fitted to another effect's errors."""
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
    stated: StatedNoise = NOTHING_STATED,
) -> Account:
    """Figures and findings of one solution.

    Args:
        solved: poses and effects.
        config: when noise and loss are effects.
        rng: for resampling.
        along_ray: the finding that the camera writes distance along the ray as depth, if the first poses showed it.
        given: what was found before depth was fitted. The views are corrected for this and for `along_ray`; the residual contains both.
        alone: only `along_ray` and `given` may be named (too few views).
        left_out: effects that may not be named.
        stated: the camera's photon law and loss of pixels, where they are known.
    """
    give_back()
    gated = tuple(given) if along_ray is None else (*given, along_ray)
    arms_tell = not alone and not _arms_silent(solved, left_out)
    # Late stamps move the cameras along their twist: what is left of that follows the drive.
    on_time = arms_tell and not solved.names(TimeSync.NAME)
    follows, sags = _arm_signs(solved, config.noise.foreign_light) if on_time else (False, False)
    findings = gated if alone else (*gated, *_findings(solved, config, stated, left_out, follows=follows))
    give_back()  # What the detectors have freed.
    counted = figures(solved, findings, rng, config.report)
    for share in (f.share for f in gated if f.share is not None):
        counted = replace(counted, residual=[r + added for r, added in zip(counted.residual, share, strict=True)])
    gap = _gap(counted, findings, list(counted.maps))
    causes = tuple(
        Cause(n, counted.shrink([n.name]), counted.shrink([m for m in counted.maps if m != n.name]).shrink, solved.sizes[n.name])
        for n in sorted(solved.named, key=lambda n: -counted.added2[n.name])
    )
    pushed, astray = arms_beyond_prior(solved, findings, config)
    return Account(solved, causes, findings, counted, gap, arms_tell and pushed, follows, sags, on_time and astray)


def arms_beyond_prior(solved: Solved, findings: Sequence[Finding], config: GapConfig) -> tuple[bool, bool]:
    """Whether arm errors exceed the robot's prior along the optical axis; the same in positions and turns.

    Neither beside another camera's light: that shifts and tilts the depth of single views, and poses absorb it.
    """
    if any(isinstance(f.effect, Interference) for f in findings):
        return False, False
    pushed = along_the_view(solved.arms, solved.arms_sd, config.noise.foreign_light)
    return pushed, over_prior(solved.arms, solved.arms_sd) > config.select.arm_rms


def unfounded(found: Account, limits: ForeignLightLimits) -> str | None:
    """The cause to take out: a drift over time that foreign light may imitate by chance, else the cause that worsens the gap."""
    drift = found.solved.maps.get(TemperatureDrift.NAME)
    chance = drift is not None and drifts_by_chance(drift, found.figures.posed_m, limits)
    return TemperatureDrift.NAME if chance else found.worsens


def without_causes(found: Account) -> Account:
    """The account whose gap shrinks by its findings alone: causes that are only suspected promise no shrink.

    Findings read off structure are taken out too: an effect without a name may make the same structure.
    """
    names = [name for name in found.figures.maps if name not in found.solved.maps]
    certain = tuple(f for f in found.findings if not f.structure)
    return replace(found, findings=certain, gap=_gap(found.figures, certain, names))


def _gap(counted: Figures, findings: Sequence[Finding], names: Sequence[str]) -> Shrink:
    """The gap before and after these effects. No shrink where only noise and loss were found: there is no bias to remove."""
    gap = counted.shrink(names)
    return replace(gap, shrink=None, ci95=None) if not_expected(findings) and not names else gap


def _findings(solved: Solved, config: GapConfig, stated: StatedNoise, left_out: AbstractSet[str], *, follows: bool) -> tuple[Finding, ...]:
    """What noise, loss and edges show at the estimated poses, once smooth bias is removed; detectors of `left_out` do not run.

    What `stated` includes is expected. Pixels that a filter in the camera removed are no `dropout`, nor are those of noisy lines. Arm
    errors that follow the views (`follows`) are no foreign light.
    """
    left = solved.bare
    gone = missing.missing_effects(
        left,
        config.missing,
        left_out | _without_wraps(left, config),
        blurred=solved.names(Motion.NAME),
        stated=stated,
        law=lambda: own_law(left, (), config.noise),
    )
    unmerged = any(map(fails_to_merge, gone))
    # The noise of wrongly merged frequencies grows in weak light, as that of foreign light does.
    lines = [] if Noise.NAME in left_out else noise.lines_found(left, config.noise)
    own = noise.beside_lines(noise.without_noisy_pixels(left, config.noise), lines)
    light = [] if any(map(hides_light, gone)) else detected.detected_effects(own, config.noise, stated.law, left_out)
    beside = detected.explained(left, light)
    arms_tell = not (_arms_silent(solved, left_out) or follows)
    foreign = None if Interference.NAME in left_out else _foreign(solved, lines, config, arms_tell=arms_tell)
    taken = left_out if foreign is None else left_out | {Interference.NAME}
    of_maps_m = config.noise.foreign_light.field_share * _named_m(solved)
    patchy = unmerged or any(isinstance(f.effect, Ambient) and f.structure for f in light)
    found = noise.noise_effects(beside, config.noise, taken, stated.law, patchy=patchy, piled_up=_piled_up(solved), of_maps_m=of_maps_m)
    uneven = [*([] if foreign is None else [foreign]), *found]
    loss = next((f for f in gone if f.name == Dropout.NAME), None)
    by_filter = loss and (lost_by_lines(left, lines, config.missing) or lost_by_pixels(left, config.missing, loss.share))
    kept = (f for f in not_outliers(gone, [*light, *uneven], config.missing.filter) if not (by_filter and f.name == Dropout.NAME))
    uneven = [replace(f, expected=True) if stated.includes(f.effect) else f for f in uneven]
    return (*(f for f in light if not of_own_light(f, solved, uneven)), *uneven, *kept)


def _without_wraps(views: Sequence[ViewEvidence], config: GapConfig) -> frozenset[str]:
    """`phase_wrap` where no phase can wrap at the modulation frequency that calibration.yaml states; else nothing."""
    stated = config.stated_mhz
    wraps = not stated or not PhaseWrap.lacks(session_of(views, config.noise, stated_mhz=stated))
    return frozenset() if wraps else frozenset({PhaseWrap.NAME})


def _foreign(solved: Solved, lines: Sequence[LineNoise], config: GapConfig, *, arms_tell: bool) -> Finding | None:
    """Another camera's light: by smooth fields and, if arm errors tell (`arms_tell`), steps along the view, or by fringes of its lamp.

    It must exceed errors of the named effects' maps, and the captures of a dwell must not share it.
    """
    left, limits, found = solved.bare, config.noise.foreign_light, None
    if arms_tell:
        of_lines = noise.smooth_by_lines(left, lines, config.noise)
        found = foreign_light(left, solved.arms, solved.arms_sd, solved.camera_covs, limits, _named_m(solved), of_lines)
    if found is not None and found.posed_m < rough_m(solved):
        found = None
    lamp = foreign_lamp(left, solved.caster, config.noise.foreign_lamp)
    if lamp is not None:
        found = lamp.finding(left, limits, 0.0 if found is None else found.posed_m)
    if found is None or repeated(left, found.common, config.noise.repeated, steps2(solved) * (found.posed_m > 0)):
        return None
    # Noise of whole lines makes captures of a dwell step, too.
    return found if lines else as_captures_step(found, left, config.noise)


def _piled_up(solved: Solved) -> bool:
    """Whether an error in proportion to the light is named: photons that hide later ones."""
    return any(isinstance(e, AmplitudeBias) and e.form == "direct" and e.direct_m != 0.0 for n in solved.named for e in n.effects)


def _arms_silent(solved: Solved, left_out: AbstractSet[str]) -> bool:
    """Whether arm errors are no evidence: while motion shifts edges, or without an arm (then hand-eye is not considered either)."""
    return solved.names(Motion.NAME) or HandEye.NAME in left_out


def _arm_signs(solved: Solved, limits: ForeignLightLimits) -> tuple[bool, bool]:
    """Whether arm errors along the optical axis follow distance and amplitude of the views, and turns by arm errors the camera's weight."""
    station = solved.chain.station
    steps = following(1e3 * solved.arms[:, ALONG], contents(solved.evidence), station)
    sag = sagging((solved.arms / solved.arms_sd)[:, 3:], solved.cameras, station)
    return (
        steps.size > limits.follows_mm and steps.chance < limits.chance_follows,
        sag.size > limits.sag and sag.chance < limits.chance_follows,
    )


def steps_along(solved: Solved) -> Float:
    """(V,) arm errors along the optical axis over their standard deviations by the robot's prior."""
    return np.asarray((solved.arms / solved.arms_sd)[:, ALONG])


def steps2(solved: Solved) -> Float:
    """(V,) square metres: squared arm errors along the optical axis beyond the variance by the robot's prior."""
    return np.maximum(solved.arms[:, ALONG] ** 2 - solved.arms_sd[:, ALONG] ** 2, 0.0)


def astray2(solved: Solved) -> Float:
    """(V,) square metres of z: mean over each view of the squared depth error that its arm error makes; 0 without smooth pixels."""
    made = ((pose_columns(v.frame)[v.smooth] @ arm, v) for v, arm in zip(solved.evidence, solved.arms, strict=True))
    return np.array([float((z**2).mean()) if v.smooth.any() else 0.0 for z, v in made])


def _named_m(solved: Solved) -> float:
    """Metres: sizes of the named effects together (root of the sum of squares)."""
    return float(np.sqrt(sum(size**2 for size in solved.sizes.values())))


def rough_m(solved: Solved) -> float:
    """Metres: error of the named effects' maps (`Effect.ROUGH`), which differs from view to view."""
    return float(np.sqrt(sum(n.effects[0].ROUGH * solved.sizes[n.name] ** 2 for n in solved.named if n.effects)))
