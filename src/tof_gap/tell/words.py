# SPDX-License-Identifier: Apache-2.0
"""Words of the report: the verdict as a sentence, what to do now, sizes of effects."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tof_core.errors import ToftwinError
from tof_core.shares import in_percent

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.tell.unexplained import Unexplained

PLACE = "place in the cell"
GOES_WITH = {
    "edge_px": "distance to an edge",
    "x_m": PLACE,
    "y_m": PLACE,
    "z_m": PLACE,
    "temperature_c": "temperature",
    "hand": "the camera's place on the hand",
    "stray_light": "stray light over the returned light",
}
"""Observables whose names say less than these words."""
MOST_STATED = 3
"""Sizes that are stated of an effect that is there several times."""


def sentence(content: dict[str, Any]) -> str:
    """The verdict in words."""
    names = [spaced(v).replace("|", " or ") for v in content["verdict"] if v not in ("none", "unknown")]
    gap = content["gap"]
    if content["verdict"] == ["none"]:
        return "Camera and simulation agree to within the noise: nothing needs to be added."
    if not names:
        suspects = [spaced(c["effect"]) for c in content["causes"] if not c["asserted"]]
        also = f" Part of it looks like {listed(suspects)}, but too much is left to be sure." if suspects else ""
        return f"Camera and simulation differ, and no effect known here explains the difference.{_clue(content['unexplained'])}{also}"
    verb = "explain" if len(names) > 1 else "explains"
    away = _off_edges(content)
    how = "" if gap["shrink"] is None or away else f" and {verb} {percent(gap['shrink'])} of the gap"
    more = ""
    if "unknown" in content["verdict"]:
        more = f" Something else is left that no effect known here explains.{_clue(content['unexplained'])}"
    which = f"{', which together' if len(names) > 1 else ', which'}{how[4:]}" if how else ""
    return f"Camera and simulation differ by {listed(names)}{which}.{away}{more}"


def todo(content: dict[str, Any]) -> list[str]:
    """What to do now, the most useful first; empty where nothing needs to be done."""
    lines = []
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
    if "unknown" in content["verdict"]:
        lines.append(where_to_look(content["unexplained"]["where"]))
    return lines + [f"Capture: {line}." for line in content["advice"]]


def where_to_look(where: Sequence[str]) -> str:
    """What to do about what is left, on these parts."""
    if where:
        return f"Look at {listed(where[:3])}: no effect known here explains the error there. Check whether it is as drawn and in its place, and whether it is glossy, wet or transparent."
    return "Look at the maps of the report: no effect known here explains the error that is left, and it lies on no part in particular."


def size_in_words(cause: dict[str, Any], session_s: float) -> str:
    """The size of an effect in its own units, as a session of so many seconds can tell it; "" where millimetres say it best.

    `params` of the cause are those of the effect, or by part or frequency where the effect is there several times.
    """
    params = cause["params"]
    several = params and all(isinstance(p, dict) for p in params.values())
    each = [_stated(cause["effect"], p, session_s) for p in (list(params.values())[:MOST_STATED] if several else [params])]
    return ", and ".join(filter(None, dict.fromkeys(each)))


def _stated(name: str, params: dict[str, Any], session_s: float) -> str:
    """The size in the effect's own units, "" where it has none or the parameters are not its own."""
    from tof_core.config import from_mapping
    from tof_sensor.registry import EFFECTS

    try:
        effect = from_mapping(EFFECTS[name], params)
    except (KeyError, TypeError, ToftwinError):
        return ""
    return effect.stated_in(session_s)


def _off_edges(content: dict[str, Any]) -> str:
    """The gap away from edges, stated where edges count: their few pixels are off by centimetres and make most of an RMS."""
    away = content["gap"].get("off_edges_mm")
    if away is None:
        return ""
    before, after = (f"{away[when]:.1f} mm" for when in ("before", "after"))
    if before == after:
        return f" Away from edges a gap of {before} stays{'' if content['unexplained']['structured'] else ', in which no structure shows'}."
    return f" Away from edges the gap is {before}, and {after} once the named effects are simulated."


def _clue(unexplained: dict[str, Any]) -> str:
    """What the unexplained part varies with and where it is, as a sentence."""
    names = quantities(unexplained["depends_on"])
    goes = f"varies with {listed(names)}" if names else ""
    where = f"shows most on {listed(unexplained['where'][:3])}" if unexplained["where"] else ""
    clues = "; it ".join(x for x in (goes, where) if x)
    return (
        (f" It {clues}." if clues else "")
        + (f" {_gross(unexplained['gross'])}" if unexplained.get("gross") else "")
        + (f" {_resembles(unexplained['resembles'])}" if unexplained.get("resembles") else "")
    )


def _gross(share: float) -> str:
    """Pixels that no bias explains, as a sentence."""
    return f"{in_percent(share, 1)} of the pixels away from edges are off by centimetres: that is no bias, but another surface, a mirror or a wrapped phase."


def _resembles(names: Sequence[str]) -> str:
    """Effects that fit and are contradicted, as a sentence."""
    return f"Something acts where {listed([spaced(n) for n in names])} would, but not as {'it does' if len(names) == 1 else 'they do'}: simulated, {'it leaves' if len(names) == 1 else 'they leave'} most of the error there."


def quantities(observables: Sequence[str]) -> list[str]:
    """What a reader calls these observables, once each."""
    return list(dict.fromkeys(GOES_WITH.get(q, q.split("_")[0]) for q in observables))


def unexplained_words(u: Unexplained, *, suspected: bool = False) -> str:
    """What is left away from edges, how it is measured, where, and what it varies with; suspected: beside effects that are not asserted."""
    where = f"most on {listed(u.where)}" if u.where else "on no part in particular"
    goes = f"; it varies with {listed(quantities(u.depends_on))}" if u.depends_on else ""
    after = f"With the {'suspected' if suspected else 'named'} effects simulated"
    gross = f" {_gross(u.gross)}" if u.gross else ""
    like = f" {_resembles(u.resembles)}" if u.resembles else ""
    return f"{after}, neighbouring pixels still share an error of {u.rmse_mm:.2f} mm RMS (means of blocks of pixels away from edges, all views), {where}{goes}.{gross}{like}"


def spaced(name: str) -> str:
    """The name of an effect in a sentence."""
    return name.replace("_", " ").replace("cad ", "CAD ")


def listed(names: Sequence[str], last: str = "and") -> str:
    """Names in a sentence."""
    return f" {last} ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def percent(share: float | None) -> str:
    """A share in per cent; a dash where it is not known."""
    return "–" if share is None else in_percent(share)


def interval(ci: Sequence[float] | None) -> str:
    """The 95 % interval of a share, "" where it is not known; no less than none and no more than all of it is shown."""
    return "" if ci is None else f"{percent(min(max(ci[0], 0.0), 1.0))} to {percent(min(ci[1], 1.0))} (95 % interval)"
