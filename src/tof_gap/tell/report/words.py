# SPDX-License-Identifier: Apache-2.0
"""Sentences of the report: the verdict, what to do now, sizes of effects, the calibration."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.errors import ToftwinError
from tof_core.se3 import distance
from tof_core.shares import in_percent
from tof_gap.tell.report.phrases import listed, percent, quantities, spaced
from tof_gap.tell.report.unexplained import clues, where_to_look

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from tof_core.arrays import Float
    from tof_core.calibration import Calibration
    from tof_gap.seen.finding import Finding
    from tof_sensor.session import Course

HELD_MM, HELD_DEG = 0.05, 0.005
"""Distance from the stated hand-eye that would be stated as 0.0 mm and 0.00 degrees: the prior of a mount that counts as exact leaves as much."""
FEW_PIXELS = {"flying_pixels": "away from edges", "phase_wrap": "without wrapped pixels"}
"""Words for what is left once the pixels of these effects are taken out, which are few and off by centimetres."""
SHOWN_MM = 0.05
"""Size in millimetres below which 0.0 would be stated."""
MOST_STATED = 3
"""Instances of one effect whose sizes are stated."""


def sentence(content: dict[str, Any]) -> str:
    """The verdict in words."""
    names = [spaced(v).replace("|", " or ") for v in content["verdict"] if v not in ("none", "unknown")]
    gap = content["gap"]
    if content["verdict"] == ["none"]:
        if suspects := _suspects(content):
            return f"Camera and simulation differ perhaps by {listed(suspects)}: the views are too few to be sure."
        return "Camera and simulation agree to within the noise: nothing needs to be added."
    if not names:
        suspects = _suspects(content)
        also = f" Part of it looks like {listed(suspects)}, but too much is left to be sure." if suspects else ""
        return f"Camera and simulation differ, and no effect known here explains the difference.{clues(content['unexplained'])}{also}"
    verb = "explain" if len(names) > 1 else "explains"
    away = _off_edges(content)
    how = "" if gap["shrink"] is None or away else f" and {verb} {percent(gap['shrink'])} of the gap"
    more = ""
    if "unknown" in content["verdict"]:
        more = f" Something else is left that no effect known here explains.{clues(content['unexplained'])}"
    which = f"{', which together' if len(names) > 1 else ', which'}{how[4:]}" if how else ""
    return f"Camera and simulation differ by {listed(names)}{which}.{away}{more}"


def _suspects(content: dict[str, Any]) -> list[str]:
    """Effects of the solution that are not asserted, as words."""
    return [spaced(c["effect"]) for c in content["causes"] if not c["asserted"]]


def todo(content: dict[str, Any]) -> list[str]:
    """What to do now, the most useful first; empty where nothing needs to be done."""
    lines = [note["todo"] for note in content["notes"]]
    if any(v not in ("none", "unknown") for v in content["verdict"]):
        lines.append(
            "Use the fitted effects: pass sensor.yaml, which lies beside this page, as --sensor to toftwin label, correct, inspect or gap, "
            "or to toftwin sensor, which adds them to a simulator's ideal depth."
        )
    moves = [f["moves"] for f in content["world"]["foreign"]]
    if content["world"]["missing"] or not all(moves):
        lines.append("Correct the cell or scene.yaml where they disagree (see “Where the world differs from the CAD”).")
    if any(moves):
        lines.append(
            "Look at the views with an object that other views do not see. Keep people out of sight, and cover lamps and mirrors, whose light spreads in the lens. "
            "The pixels of such objects are left out already."
        )
    lines += [f"Capture: {line}." for line in content["advice"]]
    if "unknown" in content["verdict"]:
        lines.append(where_to_look(content["unexplained"], _suspects(content)))
    return lines


def size_in_words(cause: dict[str, Any], course: Course) -> str:
    """The size of an effect in its own units, as far as a session of this course determines it; "" where millimetres say it best.

    `params` of the cause are those of the effect, or of each instance by part or frequency.
    """
    params = cause["params"]
    several = params and all(isinstance(p, dict) for p in params.values())
    each = [_stated(cause["effect"], p, course) for p in (list(params.values())[:MOST_STATED] if several else [params])]
    return ", and ".join(filter(None, dict.fromkeys(each)))


def _stated(name: str, params: dict[str, Any], course: Course) -> str:
    """The size in the effect's own units, "" where it has none or the parameters are not its own."""
    from tof_core.config import from_mapping
    from tof_sensor.registry import EFFECTS

    try:
        effect = from_mapping(EFFECTS[name], params)
    except (KeyError, TypeError, ToftwinError):
        return ""
    return effect.stated_in(course)


def _off_edges(content: dict[str, Any]) -> str:
    """The gap of most pixels, where edges or wrapped pixels count: these are few and off by centimetres, and dominate an RMS."""
    away = content["gap"].get("off_edges_mm")
    if away is None:
        return ""
    where = most_pixels(content["verdict"]).capitalize()
    before, after = (f"{away[when]:.1f} mm" for when in ("before", "after"))
    if before == after:
        return f" {where} a gap of {before} stays{'' if content['unexplained']['structured'] else ', in which no structure shows'}."
    return f" {where} the gap is {before}, and {after} once the named effects are simulated."


def most_pixels(verdict: Iterable[str]) -> str:
    """Which pixels the gap of most pixels is of, where this verdict explains the others, which are few and off by centimetres."""
    names = {name for v in verdict for name in v.split("|")}
    few = [words for name, words in FEW_PIXELS.items() if name in names]
    return listed(few) if few else FEW_PIXELS["flying_pixels"]


def expected_words(findings: Iterable[Finding]) -> list[str]:
    """Effects that the camera is known to have or has by design, each with its size."""
    sized = ((f, f" ({f.size or f.note})" if f.size or f.note else "") for f in findings if f.expected)
    return [f"not in the verdict: {f.name}{size}, as {f.by_design or 'the camera is known for it (--sensor)'}" for f, size in sized]


def calibration_words(stated: Calibration) -> str:
    """What the stated calibration allows, or that none is stated."""
    mount, lens = stated.hand_eye, stated.lens
    parts = [
        *([f"hand-eye to {mount.translation_mm:g} mm and {mount.rotation_deg:g} degrees"] if any(stated.hand_eye_most) else []),
        *([f"lens to {lens.principal_point_px:g} px and {lens.focal_pct:g} %"] if stated.lens_sd.any() else []),
        *([f"albedos to {percent(stated.albedo.relative)}"] if stated.albedo.relative else []),
    ]
    light = f"; modulation {', '.join(f'{mhz:g}' for mhz in stated.modulation.stated)} MHz, as stated" if stated.modulation.stated else ""
    if not parts:
        where = "(calibration.yaml beside scene.yaml, docs/calibration.md)"
        return f"calibration: none is stated, so hand-eye and lens count as exact {where}{light}"
    return f"calibration, as stated: {', '.join(parts)}{light}"


def hand_eye_words(hand_eye: Float) -> str:
    """How far hand-eye of the solution, (4, 4), is from the stated one; the identity is an unestimated one."""
    metres, degrees = distance(np.eye(4), hand_eye)
    if 1e3 * metres < HELD_MM and degrees < HELD_DEG:
        return "hand-eye is held at the stated one: without a calibration.yaml it counts as exact, unless it is named"
    return f"hand-eye as estimated with the poses: {1e3 * metres:.1f} mm and {degrees:.2f} degrees from the stated one"


def small_words(names: Sequence[str], sizes_mm: Mapping[str, float]) -> str:
    """Effects and observables that a healthy camera or the stated calibration may have, with known sizes; none that rounds to 0.0 mm."""
    from tof_sensor.registry import EFFECTS

    def words(name: str) -> str:
        what = name if name in EFFECTS else f"an error that varies with {quantities([name])[0]}"
        return what + (f" ({sizes_mm[name]:.1f} mm)" if name in sizes_mm else "")

    return ", ".join(words(name) for name in names if sizes_mm.get(name, SHOWN_MM) >= SHOWN_MM)


def doubt_words(unexplained: float, doubt: float) -> str:
    """Why no effect is asserted."""
    return f"no effect is asserted: {in_percent(unexplained, 1)} of the gap is unexplained, and from {percent(doubt)} on effects are only suspected"


def untested_words(reasons: Mapping[str, str], where: str = "") -> list[str]:
    """One line for each reason why effects are not testable, with the names of these effects."""
    names: dict[str, list[str]] = {}
    for name, why in reasons.items():
        names.setdefault(why, []).append(name)
    return [f"not testable{where}: {', '.join(alike)} ({why})" for why, alike in names.items()]
