# SPDX-License-Identifier: Apache-2.0
"""Sentences on the gap that no named effect explains: how large it is, where it lies, what to look at."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from tof_core.shares import in_percent
from tof_gap.tell.image_place import SPOTS_WORDS
from tof_gap.tell.report.phrases import listed, quantities, spaced
from tof_gap.tell.unexplained import HAND

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_gap.tell.unexplained import Unexplained

FIRST_LOOK = {
    "stray_light": "Check the camera's window and the air before it for dirt, drops, dust and fog: pixels of weak light amid bright ones err most, as where a cover glass reflects light or haze spreads it.",
    "region": "Check for glass, film or liquid before the parts: light into one region of the cell is late by one amount.",
    "ghost": "Check the camera's lens and window: a share of the light returns mirrored through the image's centre, as reflections between lens, window and sensor make it.",
    "viewed": "Check the camera's exposure, supply and driver: it errs by another amount in each view, as distance and brightness change.",
    "column": "Check the camera's read-out, and reflections in its window: the error keeps to columns of the image.",
    "row": "Check the camera's read-out, and reflections in its window: the error keeps to rows of the image.",
    SPOTS_WORDS: "Check the camera's window and lens for drops, dirt and scratches: these keep their place in the image.",
}
"""What to check first where the cause shows in what the error varies with, or in its place in the image."""
FOLLOWED = (
    "Camera poses differ from the robot's along the view, or alike in all views, by more than its prior allows: they follow an error of depth, or the "
    "camera sits otherwise on the hand than stated."
)
"""What arm errors say that are alike in all views or lie along the optical axis (`tell.unexplained.HAND`)."""
OTHERWISE = {"region": "If there is none", SPOTS_WORDS: "If there are none"}
"""How the next sentence begins, where it is not "If it is in order"."""
SHOWN_RMS_MM = 0.005
"""RMS error in millimetres below which 0.00 would be stated."""


def unexplained_words(u: Unexplained, simulated: str = "named") -> str:
    """The error left away from edges: its size, what it varies with, where it is.

    simulated: the effects that were subtracted, "named" or only "suspected"; "" where there are none.
    """
    of_blocks = "(means of blocks of pixels away from edges, all views)"
    still = "still share" if simulated else "share"
    share = "share no error above the noise" if u.rmse_mm < SHOWN_RMS_MM else f"{still} an error of {u.rmse_mm:.2f} mm RMS"
    others = "; other signs show one" if u.rmse_mm < SHOWN_RMS_MM else ""
    opening = f"With the {simulated} effects simulated, neighbouring" if simulated else "Neighbouring"
    return f"{opening} pixels {share} {of_blocks}{others}.{clues(asdict(u))}"


def clues(unexplained: Mapping[str, Any]) -> str:
    """What the unexplained gap varies with, where it is, and what it is like, as sentences that each begin with a space."""
    varies, where, place, gross, like = (unexplained.get(key) for key in ("depends_on", "where", "in_image", "gross", "resembles"))
    by = quantities([quantity for quantity in varies or () if quantity != HAND])
    at = [f"varies with {listed(by)}"] if by else []
    at += [f"shows most on {listed(where[:3])}"] if where else []
    at += [f"lies at {place}" if place == SPOTS_WORDS else f"lies in {place}"] if place else []
    found = [f"It {'; it '.join(at)}."] if at else []
    found += [FOLLOWED] if varies and HAND in varies else []
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


def where_to_look(left: Mapping[str, Any], suspects: Sequence[str] = ()) -> str:
    """What to do about the unexplained gap, `left` as in gap.json; `suspects`: suspected effects, in words."""
    depends_on, where = left["depends_on"], left["where"]
    if "attitude" in depends_on:
        return "Check the camera's mount and the arm for play: the camera turns under its own weight as the hand turns."
    light = f" (suspected: {listed(suspects)})" if suspects else ""
    sign = next((shown for shown in (*depends_on, left.get("in_image")) if shown in FIRST_LOOK), "")
    first, nothing = FIRST_LOOK.get(sign, ""), OTHERWISE.get(sign, "If it is in order")
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
