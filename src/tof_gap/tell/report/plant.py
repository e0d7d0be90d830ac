# SPDX-License-Identifier: Apache-2.0
"""The verdict for a plant engineer: for each effect what it is, where, how large, what to do, and what happens otherwise."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.ndimage import uniform_filter

from tof_core.shares import in_percent
from tof_core.stats import joined, least_touched
from tof_gap.seen.finding import not_expected
from tof_gap.tell.report.phrases import listed, spaced
from tof_gap.tell.unexplained import by_part
from tof_sensor.effect import Evidence
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.time_sync import TimeSync
from tof_sensor.session import Course

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_core.arrays import Float
    from tof_gap.seen.finding import Finding
    from tof_gap.tell.account import Cause
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_scene.scene import Scene
    from tof_sensor.effect import Effect

USUAL_MOUNT_MM, USUAL_MOUNT_DEG = 3.0, 0.3
"""Errors of usual hand-eye calibrations, as published: 1 to 3 mm, 0.1 to 0.3 degrees."""
MOST_PARTS = 3
"""Parts that are named one by one; with more, "many parts" is stated."""
MOST_WAVES = 3
"""Waves whose periods are stated one by one."""
CARRIED = 0.8
"""Share of an effect's squared error that the named parts carry together."""
WORST = 0.95
"""Quantile of the error at which the cost is stated: one pixel in twenty is worse."""
MATTERS_M = 1e-3
"""Metres: error of healthy cameras. The cost of an effect on few pixels is the share of pixels with a larger error."""
EVERYWHERE = 0.95
"""Share of the pixels from which "all pixels" is understood."""
NEAR_PX = 5
"""Side of the window whose majority decides whether an effect acts: white offsets touch three of four pixels, and so every window."""


MANY = 3
"""Rivals of an effect from which on its own remedy is not stated: one of four would be right."""
NO_DEPTH = "these pixels have no depth, and the others are not affected"
"""Cost of lost pixels."""


@dataclass(frozen=True, slots=True)
class Words:
    """One effect: its name; what it is; where; how large; what to do; what happens otherwise. Empty where nothing is known.

    rivals: effects that the session cannot separate from it; suspected: whether it is not asserted; unsure: the reason.
    """

    effect: str
    what: str
    where: str
    size: str
    remedy: str
    cost: str
    rivals: tuple[str, ...] = ()
    suspected: bool = False
    unsure: str = ""

    def sentence(self) -> str:
        """All fields in a few sentences."""
        head = f"{'perhaps ' * self.suspected}{spaced(self.effect)}: {self.what}"
        details = "; ".join(x for x in (self.size, self.where) if x)
        if len(self.rivals) >= MANY:
            return self._one_of_many(details)
        tied = f" Or {listed([spaced(r) for r in self.rivals], 'or')}, which this session cannot separate from it." if self.rivals else ""
        sure = f"{self.unsure} to be sure of it. If it is confirmed" if self.suspected else "To do"
        todo = f" {sure}: {self.remedy}." if self.remedy else ""
        cost = f" If nothing is done, {self.cost}." if self.cost and not self.suspected else ""
        return f"{head[0].upper()}{head[1:]}{f' ({details})' if details else ''}.{tied}{todo}{cost}"

    def _one_of_many(self, details: str) -> str:
        """What a session shows that fits many effects: the remedy of one of them would most likely be that of another one's error."""
        names = listed([f"{spaced(self.effect)}{f' ({details})' if details else ''}", *map(spaced, self.rivals)], "or")
        todo = "To do: calibrate nothing for it yet; the report's advice says what separates them"
        return f"{'Perhaps one' if self.suspected else 'One'} of {1 + len(self.rivals)} effects that this session cannot separate: {names}. {todo}."


def plant_words(d: Diagnosis, scene: Scene) -> list[Words]:
    """The effects of the verdict, causes first."""
    maps = dict(d.shares)
    causes = [
        replace(
            _words(c.named.name, c.named.effects, acts(c.size_m, maps[c.named.name]), maps[c.named.name], d, scene, c.named.std),
            rivals=tuple(c.named.ties),
            suspected=d.suspected(c),
            unsure=_unsure(c, d),
        )
        for c in d.causes
    ]
    findings = [
        replace(_of_finding(f, _words(f.name, (f.effect,), "", maps.get(f.name), d, scene), scene), rivals=f.effect.rivals)
        for f in not_expected(d.findings)
    ]
    return [*causes, *findings]


def _unsure(cause: Cause, d: Diagnosis) -> str:
    """Why a cause is not asserted; empty where it is."""
    few = f"{len(d.evidence)} views before a board are too few" if cause.named.suspected else ""
    return "Too much stays unexplained" if d.doubted else few


def to_dicts(words: Sequence[Words]) -> list[dict[str, Any]]:
    """Plain values for `gap.json`, each with its `sentence`."""
    return [asdict(w) | {"sentence": w.sentence()} for w in words]


def _words(
    name: str,
    effects: Sequence[Effect],
    size: str,
    maps: Sequence[Float] | None,
    d: Diagnosis,
    scene: Scene,
    std: Sequence[Mapping[str, float]] = (),
) -> Words:
    kind, course, alone = effects[0], course_of(d), len(effects) == 1
    stated = (_stated(e, s, course, scene, alone=alone) for e, s in zip_longest(effects[:MOST_PARTS], std[:MOST_PARTS]))
    each = ", and ".join(filter(None, dict.fromkeys(stated)))
    periods = sorted({f"{p:.2f}" for e in effects if not e.free_form and (p := getattr(e, "period_m", None)) is not None})
    if len(effects) > 1 and periods and maps is not None:
        # Waves of nearly one period take each other off: their amplitudes by themselves say nothing.
        waves = f"waves of {listed(periods)}" if len(periods) <= MOST_WAVES else f"{len(periods)} waves of {periods[0]} to {periods[-1]}"
        each = f"{size}, {extremes_mm(maps):.1f} mm between the extremes, in {waves} m of range"
    return Words(
        name,
        kind.MEANING,
        "" if maps is None else f"{_in_motion(name, d)}{where(d, maps, scene)}",
        each or size,
        _remedy(kind, d),
        "" if maps is None else cost(d, maps),
    )


def _in_motion(name: str, d: Diagnosis) -> str:
    """Which views an error of a moving hand is in, where the session has others; else empty."""
    moving = sum(v.frame.context.moving for v in d.evidence)
    if name not in (Motion.NAME, TimeSync.NAME) or moving in (0, len(d.evidence)):
        return ""
    return f"in the {moving} of {len(d.evidence)} views that were taken in motion; "


def _remedy(effect: Effect, d: Diagnosis) -> str:
    """What to do; first, where no calibration is stated, to state one that is as good as calibrations are."""
    if effect.mount is None or d.config.calibration.hand_eye_sd.any():
        return effect.remedy
    shift_mm, turn_deg = 1e3 * float(np.linalg.norm(effect.coefficients[:3])), float(np.degrees(np.linalg.norm(effect.coefficients[3:])))
    if shift_mm > USUAL_MOUNT_MM or turn_deg > USUAL_MOUNT_DEG:
        return effect.remedy
    return f"many calibrations are no better: if this one is not, state its accuracy in calibration.yaml beside scene.yaml; otherwise {effect.remedy}"


def _stated(effect: Effect, std: Mapping[str, float] | None, course: Course, scene: Scene, *, alone: bool) -> str:
    """The effect's size in its own units, with its part where several are meant; empty where millimetres of depth are enough."""
    to, part = getattr(effect, "stated_to", None), getattr(effect, "part", None)
    text = effect.stated_in(course) if to is None or std is None else to(std)
    return text if alone or not text or part is None else f"{scene.parts[part].name} {text}"


def _of_finding(found: Finding, words: Words, scene: Scene) -> Words:
    """The words of a finding, where its evidence says more than the effect's parameters."""
    return replace(
        words,
        size=found.size or words.size or found.note,
        where=words.where or on_parts([scene.parts[i].name for i in found.parts]),
        remedy=found.remedy or words.remedy,
        cost=words.cost or (NO_DEPTH if found.effect.EVIDENCE is Evidence.MISSING else ""),
    )


def on_parts(names: Sequence[str]) -> str:
    """Where an effect is: the parts by name, where they are few; "" where there is none."""
    if len(names) > MOST_PARTS:
        return "on many parts"
    return f"on {listed(names)}" if names else ""


def course_of(d: Diagnosis) -> Course:
    """The session's duration, and the temperature of its first and last view."""
    views = sorted((v.frame.context for v in d.evidence), key=lambda context: context.time_s)
    return Course(views[-1].time_s - views[0].time_s, views[0].temperature, views[-1].temperature)


def where(d: Diagnosis, maps: Sequence[Float], scene: Scene) -> str:
    """The parts that carry most of maps (H, W) of metres, one per view."""
    energy = by_part(d.evidence, (np.nan_to_num(m) ** 2 for m in maps), len(scene.parts))
    order = np.argsort(-energy, kind="stable")
    carried = np.cumsum(energy[order]) / max(float(energy.sum()), 1e-18)
    count = int(np.searchsorted(carried, CARRIED)) + 1
    return on_parts([scene.parts[i].name for i in order[:count]])


def acts(size_m: float, maps: Sequence[Float]) -> str:
    """RMS of maps (H, W) of metres over the pixels that they touch, which pixels these are, and the RMS over all pixels of the CAD."""
    touched, share, least_m = _covered(maps)
    some = f" over the {in_percent(touched)} of the pixels that change by {1e3 * least_m:.2g} mm and more, {1e3 * size_m * np.sqrt(touched):.1f} mm over all"
    return f"{1e3 * size_m:.1f} mm RMS" + ("" if share > EVERYWHERE else some)


def extremes_mm(maps: Sequence[Float]) -> float:
    """Difference of the 1 and 99 % quantiles of maps (H, W) of metres, in millimetres: between the ends of the range, where few pixels are."""
    low, high = np.quantile(joined((m[np.isfinite(m)] for m in maps), sum(m.size for m in maps)), [0.01, 0.99])
    return 1e3 * float(high - low)


def _covered(maps: Sequence[Float]) -> tuple[float, float, float]:
    """Shares of the pixels of maps (H, W) that are touched, and that are or most of whose neighbours are; metres from which a pixel is touched.

    A pattern also acts where its sign changes.
    """
    known = [np.isfinite(m) for m in maps]
    least = least_touched(joined((np.abs(m[k & (m != 0)]) for m, k in zip(maps, known, strict=True)), sum(m.size for m in maps)))
    touched = covered = 0
    for m, k in zip(maps, known, strict=True):
        on = (k & (np.abs(m) >= least)).astype(float)
        among = uniform_filter(on, NEAR_PX) > 0.5 * uniform_filter(k.astype(float), NEAR_PX)
        touched += int(on.sum())
        covered += int((k & (among | (on > 0))).sum())
    every = max(sum(int(k.sum()) for k in known), 1)
    return touched / every, covered / every, least


def cost(d: Diagnosis, maps: Sequence[Float]) -> str:
    """Error by maps (H, W) of metres that one pixel in twenty exceeds; where fewer are affected, the share of pixels off by `MATTERS_M`, and how far."""
    seen = (np.abs(m)[np.isfinite(r) & np.isfinite(m)] for m, r in zip(maps, d.residual, strict=True))
    error = joined(seen, sum(m.size for m in maps))
    if not error.size:
        return ""
    worst = float(np.quantile(error, WORST, overwrite_input=True))
    if worst >= MATTERS_M:
        return f"this effect puts one pixel in twenty off by {1e3 * worst:.1f} mm or more"
    off = error[error >= MATTERS_M]
    half = f", half of them by {1e3 * float(np.median(off)):.0f} mm or more" if off.size else ""
    return f"this effect puts {in_percent(off.size / error.size)} of the pixels off by {1e3 * MATTERS_M:.0f} mm or more{half}"
