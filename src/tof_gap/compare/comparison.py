# SPDX-License-Identifier: Apache-2.0
"""A simulator compared with a camera: their distance, the effects in which they differ or agree, and what could not be compared."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tof_core.shares import in_percent
from tof_gap.tell.report.phrases import listed, spaced
from tof_gap.tell.report.words import untested_words

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from collections.abc import Set as AbstractSet

    from tof_gap.compare.difference import Difference
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_gap.tell.figures.shrink import Shrink

SIDES = "camera", "simulator"


class Unnamed(NamedTuple):
    """Errors without a certain cause in a session whose own verdict is `unknown`: mm RMS above its noise, and the effects that it suspects."""

    rms_mm: float
    suspected: tuple[str, ...]


def unnamed(session: Diagnosis) -> Unnamed | None:
    """What a session whose verdict is `unknown` leaves without a certain cause; None where it is no more than a healthy camera's errors."""
    left_mm = session.gap.shown_mm[1] if "unknown" in session.verdict else 0.0
    if left_mm < session.config.select.least_mm:
        return None
    return Unnamed(left_mm, tuple(c.named.name for c in session.causes if session.suspected(c)))


def undecided(verdicts: Sequence[Sequence[str]], differences: Sequence[Difference], same: AbstractSet[str]) -> dict[str, str]:
    """Effects (or ties, `a|b`) of one verdict alone that are neither a difference nor the same, each with the side that named it."""
    settled = same | {name for d in differences for name in d.verdict.split("|")}
    items = [[v for v in verdict if v not in ("none", "unknown")] for verdict in verdicts]
    names = [{name for item in of for name in item.split("|")} for of in items]
    return {item: SIDES[side] for side, of in enumerate(items) for item in of if not set(item.split("|")) & (names[1 - side] | settled)}


@dataclass(frozen=True, slots=True)
class Against:
    """Real against simulated: the distance before and after every effect is corrected, and the effects in which they differ.

    alike: effects that both have, and that do not differ: both diagnoses named them, or one did and the views of both show them;
    sizes_mm: of those that both have by their diagnoses, RMS in the camera's and the simulator's session, NaN without a map; as_stated: effects that both have, and that
    differ by no more than the stated calibration allows; unnamed: of the camera's and of the simulator's session; not_testable: effects
    that the simulator's session cannot test, each with the reason; missing: shares of the CAD's pixels without depth in both sessions, where
    they differ and no effect says why; within_maps: effects whose difference errors of another effect's coarse map may make, with both sizes;
    undecided: effects of one session's verdict, with its side, of which the other session shows neither that it has them nor that it lacks them.
    """

    distance: Shrink
    differences: tuple[Difference, ...]
    alike: tuple[str, ...] = ()
    as_stated: tuple[str, ...] = ()
    sizes_mm: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    unnamed: tuple[Unnamed | None, Unnamed | None] = (None, None)
    not_testable: Mapping[str, str] = field(default_factory=dict)
    missing: tuple[float, float] | None = None
    within_maps: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    undecided: Mapping[str, str] = field(default_factory=dict)

    @property
    def verdict(self) -> tuple[str, ...]:
        """Names of the effects in which they differ, `a|b` for a tie, and `unknown` beside errors without a certain cause; `none` without any."""
        return tuple(sorted({d.verdict for d in self.differences} | ({"unknown"} if any(self.unnamed) else set()))) or ("none",)

    def lines(self) -> list[str]:
        """The comparison in words: the distance before and after the corrections, each difference, what is alike and what is open."""
        return [*self.head(), *(x.line() for x in self.differences), *self.foot()]

    def head(self) -> list[str]:
        """The distance, and the answer in one sentence."""
        d = self.distance
        before = (
            f"simulator against camera: away from edges their depth differs by {d.above_mm(d.before):.2f} mm RMS, above the noise of "
            f"{d.floor_mm:.2f} mm, on views that took no part in the fit"
        )
        if any(not x.note for x in self.differences):
            return [before, f"once all effects below are put right in the simulator, {d.above_mm(d.after):.2f} mm remain"]
        if self.differences:
            return [before, "no effect in mean depth differs; noise or shares of pixels do"]
        if any(self.unnamed) or self.undecided:
            return [before, "no effect is certain enough to be named as a difference"]
        if not (self.alike or self.as_stated):
            return [before, "simulator and camera differ in no effect: neither shows one"]
        return [before, "the simulator has the camera's effects"]

    def foot(self) -> list[str]:
        """What is alike, what has no certain cause, and what could not be tested."""
        both = [self._alike(name) for name in self.alike]
        both += [f"{name} differs by no more than the stated calibration: no difference" for name in self.as_stated]
        both += [
            f"{name} ({real:.2f} mm real, {simulated:.2f} mm simulated) differs by no more than the map of another effect may err: no difference"
            for name, (real, simulated) in self.within_maps.items()
        ]
        both += [_one_sided(name, side) for name, side in self.undecided.items()]
        if self.missing is not None:
            real, simulated = (in_percent(share) for share in self.missing)
            both.append(
                f"no depth on {real} of the CAD's pixels in the camera's bag, and on {simulated} in the simulator's: no named effect makes this "
                "difference. Filters of a camera, such as one at edges, remove pixels by design, and sensor.yaml does not simulate them"
            )
        untested = untested_words(self.not_testable, " in the simulator's bag")
        return [*both, *(_open(side, u) for side, u in zip(SIDES, self.unnamed, strict=True) if u is not None), *untested]

    def _alike(self, name: str) -> str:
        """That both have an effect, and by which evidence."""
        if name not in self.sizes_mm:
            return f"{name} was found in one bag alone, and the views of both show it alike: no difference"
        real_mm, simulated_mm = self.sizes_mm[name]
        sizes = "" if np.isnan(real_mm) else f" ({real_mm:.2f} mm real, {simulated_mm:.2f} mm simulated)"
        return f"both have {name}{sizes}: no difference"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; NaN becomes null."""
        d = self.distance
        return {
            "verdict": list(self.verdict),
            "distance": {"before_mm": d.above_mm(d.before), "after_mm": d.above_mm(d.after), "floor_mm": d.floor_mm, "shrink": d.shrink},
            "differences": [x.to_dict() for x in self.differences],
            "alike": list(self.alike),
            "alike_mm": {name: list(both) for name, both in self.sizes_mm.items() if np.isfinite(both).all()},
            "as_stated": list(self.as_stated),
            "undecided": dict(self.undecided),
            "within_maps_mm": {name: list(both) for name, both in self.within_maps.items()},
            "unknown": {
                side: {"rms_mm": u.rms_mm, "suspected": list(u.suspected)}
                for side, u in zip(SIDES, self.unnamed, strict=True)
                if u is not None
            },
            "not_testable": dict(self.not_testable),
            "missing": None if self.missing is None else dict(zip(SIDES, self.missing, strict=True)),
        }


def _one_sided(name: str, side: str) -> str:
    """An effect, or a tie, that one session's verdict names and the other session does not settle, in words."""
    (other,) = set(SIDES) - {side}
    return (
        f"{' or '.join(map(spaced, name.split('|')))} was found in the {side}'s bag alone, and the {other}'s does not tell whether it lacks it: "
        "no difference. More views make it certain"
    )


def _open(side: str, left: Unnamed) -> str:
    """What a session's own diagnosis leaves open, in words."""
    perhaps = f"; suspected: {listed([spaced(n) for n in left.suspected])}" if left.suspected else ""
    return (
        f"the {side}'s bag has errors of {left.rms_mm:.2f} mm RMS without a certain cause{perhaps}. "
        "They may be a difference that is not listed: find their cause, then compare again"
    )
