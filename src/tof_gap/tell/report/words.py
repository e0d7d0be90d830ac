# SPDX-License-Identifier: Apache-2.0
"""Sentences of the report: the verdict, what to do now, sizes of effects, what is unexplained."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.errors import ToftwinError
from tof_core.se3 import distance
from tof_core.shares import in_percent

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from tof_core.arrays import Float
    from tof_core.calibration import Calibration
    from tof_gap.seen.finding import Finding
    from tof_gap.tell.unexplained import Unexplained
    from tof_sensor.session import Course

PLACE = "place in the cell"
GOES_WITH = {
    "edge_px": "distance to an edge",
    "x_m": PLACE,
    "y_m": PLACE,
    "z_m": PLACE,
    "temperature_c": "temperature",
    "hand": "the camera's place on the hand",
    "viewed": "distance and brightness of the view",
    "attitude": "the hand's attitude, as where its mount or the arm gives way",
    "arm": "the arm's pose, whose errors exceed what the robot's prior allows",
    "stray_light": "stray light over the returned light",
    "region": "the region of the cell that light comes from",
    "ghost": "the light of the opposite side of the image",
}
"""Words for observables whose names are no words of a reader."""
HELD_MM, HELD_DEG = 0.05, 0.005
"""Distance from the stated hand-eye that would be stated as 0.0 mm and 0.00 degrees: the prior of a mount that counts as exact leaves as much."""
FIRST_LOOK = {
    "stray_light": "Check the camera's window and the air before it: light that a cover glass reflects, or that spreads in dirt, dust or fog, errs with stray light over the returned light.",
    "region": "Check for glass, film or liquid before the parts: light into one region of the cell is late by one amount.",
    "ghost": "Check the camera's lens and window: a share of the light returns mirrored through the image's centre, as reflections between lens, window and sensor make it.",
    "viewed": "Check the camera's exposure, supply and driver: it errs by another amount in each view, as distance and brightness change.",
    "column": "Check the camera's read-out, and reflections in its window: the error keeps to columns of the image.",
    "row": "Check the camera's read-out, and reflections in its window: the error keeps to rows of the image.",
}
"""What to check first where the cause shows in what the error varies with."""
SHOWN_MM = 0.05
"""Size in millimetres below which 0.0 would be stated."""
SHOWN_RMS_MM = 0.005
"""RMS error in millimetres below which 0.00 would be stated."""
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
        return f"Camera and simulation differ, and no effect known here explains the difference.{_clues(content['unexplained'])}{also}"
    verb = "explain" if len(names) > 1 else "explains"
    away = _off_edges(content)
    how = "" if gap["shrink"] is None or away else f" and {verb} {percent(gap['shrink'])} of the gap"
    more = ""
    if "unknown" in content["verdict"]:
        more = f" Something else is left that no effect known here explains.{_clues(content['unexplained'])}"
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
        left = content["unexplained"]
        lines.append(where_to_look(left["where"], left.get("depends_on", ()), _suspects(content)))
    return lines


def where_to_look(where: Sequence[str], depends_on: Sequence[str] = (), suspects: Sequence[str] = ()) -> str:
    """What to do about the unexplained gap; `where`: parts that carry it; `depends_on`: quantities that it varies with; `suspects`: in words."""
    if "attitude" in depends_on:
        return "Check the camera's mount and the arm for play: the camera turns under its own weight as the hand turns."
    light = f" (suspected: {listed(suspects)})" if suspects else ""
    sign = next((quantity for quantity in depends_on if quantity in FIRST_LOOK), "")
    first = FIRST_LOOK.get(sign, "")
    nothing = "If there is none" if sign == "region" else "If it is in order"
    look, check = (f"{nothing}, look", f"{nothing}, check") if first else ("Look", "Check")
    if "arm" in depends_on:
        then = (
            f"{check} the arm's encoders, the base and TF: camera poses err from view to view by more than align.priors.arm_mm and arm_deg. "
            "If this arm is no better, state its errors there. If robot and TF are in order, the fitted poses have followed an error of the "
            f"camera or of the light that differs from view to view{light}."
        )
    elif where:
        they = "it is" if len(where) == 1 else "they are"
        then = (
            f"{look} at {listed(where[:3])}, where most of the error lies: check whether {they} as drawn and in place, and whether {they} glossy, "
            f"wet or transparent. If nothing is to be seen there, the cause is the camera's or the light's{light}."
        )
    else:
        then = (
            f"{look} at the maps of the report: no effect known here explains the error that is left, and it lies on no part in particular."
        )
    return f"{first} {then}" if first else then


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
    """The gap away from edges, where edges count: the few pixels there are off by centimetres and dominate an RMS."""
    away = content["gap"].get("off_edges_mm")
    if away is None:
        return ""
    before, after = (f"{away[when]:.1f} mm" for when in ("before", "after"))
    if before == after:
        return f" Away from edges a gap of {before} stays{'' if content['unexplained']['structured'] else ', in which no structure shows'}."
    return f" Away from edges the gap is {before}, and {after} once the named effects are simulated."


def _clues(unexplained: Mapping[str, Any]) -> str:
    """What the unexplained gap varies with, where it is, and what it is like, as sentences that each begin with a space."""
    varies, where, place, gross, like = (unexplained.get(key) for key in ("depends_on", "where", "in_image", "gross", "resembles"))
    clues = [f"varies with {listed(quantities(varies))}"] if varies else []
    clues += [f"shows most on {listed(where[:3])}"] if where else []
    clues += [f"lies in {place}"] if place else []
    found = [f"It {'; it '.join(clues)}."] if clues else []
    if gross:
        found.append(
            f"{in_percent(gross, 1)} of the pixels away from edges are off by centimetres: that is no bias, but another surface, a mirror or a wrapped phase."
        )
    if like:
        was, it, changes, this = ("was", "it", "it changes", "this one") if len(like) == 1 else ("were", "they", "they change", "these")
        found.append(
            f"{listed([spaced(n) for n in like]).capitalize()} {was} fitted and rejected: simulated, {it} would leave much of the error on the pixels "
            f"that {changes}, or {it} would need another size in each view. Another cause acts there, or {this} in a form that no formula here describes."
        )
    return "".join(f" {sentence}" for sentence in found)


def quantities(observables: Sequence[str]) -> list[str]:
    """Words for these observables, each once."""
    return list(dict.fromkeys(GOES_WITH.get(q, q.split("_")[0]) for q in observables))


def unexplained_words(u: Unexplained, simulated: str = "named") -> str:
    """The error left away from edges: its size, what it varies with, where it is.

    simulated: the effects that were subtracted, "named" or only "suspected"; "" where there are none.
    """
    of_blocks = "(means of blocks of pixels away from edges, all views)"
    still = "still share" if simulated else "share"
    share = "share no error above the noise" if u.rmse_mm < SHOWN_RMS_MM else f"{still} an error of {u.rmse_mm:.2f} mm RMS"
    others = "; other signs show one" if u.rmse_mm < SHOWN_RMS_MM else ""
    opening = f"With the {simulated} effects simulated, neighbouring" if simulated else "Neighbouring"
    return f"{opening} pixels {share} {of_blocks}{others}.{_clues(asdict(u))}"


def spaced(name: str) -> str:
    """The name of an effect in a sentence."""
    return name.replace("_", " ").replace("cad ", "CAD ")


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


def listed(names: Sequence[str], last: str = "and") -> str:
    """Names in a sentence."""
    return f" {last} ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def percent(share: float | None) -> str:
    """A share in per cent; a dash where it is not known."""
    return "–" if share is None else in_percent(share)


def interval(ci: Sequence[float] | None) -> str:
    """The 95 % interval of a share, cut at 100 %; "" where it is not known. Below 0 a gap grows."""
    return "" if ci is None else f"{percent(min(ci[0], 1.0))} to {percent(min(ci[1], 1.0))} with 95 % confidence"


def untested_words(reasons: Mapping[str, str], where: str = "") -> list[str]:
    """One line for each reason why effects are not testable, with the names of these effects."""
    names: dict[str, list[str]] = {}
    for name, why in reasons.items():
        names.setdefault(why, []).append(name)
    return [f"not testable{where}: {', '.join(alike)} ({why})" for why, alike in names.items()]
