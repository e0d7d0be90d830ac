# SPDX-License-Identifier: Apache-2.0
"""`report.html`: one page that a plant engineer understands; no network, everything escaped."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.page import render_page
from tof_gap.tell import pictures
from tof_gap.tell.where import by_quantity
from tof_scene.world.words import lines
from tof_sensor.registry import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tof_gap.tell.diagnosis import Diagnosis


def write_page(d: Diagnosis, content: dict[str, Any], folder: Path, title: str) -> Path:
    """Write `report.html` beside `gap.json`, whose `content` it shows."""
    left = [r - np.sum([np.zeros_like(r), *(np.nan_to_num(m[v]) for m in d.shares.values())], axis=0) for v, r in enumerate(d.residual)]
    gap = content["gap"]
    text = render_page(
        "tof_gap.tell",
        "report.html.j2",
        f"Simulation against camera: {title}",
        sentence=sentence(content),
        gap=gap,
        before_mm=d.gap.above_mm(d.gap.before),
        after_mm=d.gap.above_mm(d.gap.after),
        shrink=_percent(gap["shrink"]),
        interval=_interval(gap["shrink_ci95"]),
        picture={
            "cad": pictures.on_the_cad(d, left),
            "how_far": pictures.how_far(d),
            "views": pictures.views(d, left),
            "by": pictures.by_quantity(by_quantity(d.evidence, d.residual, d.floor2, d.config.report.where.bins)),
        },
        regions=content["where"]["regions"],
        causes=[c | {"fitted": _fitted(c)} for c in content["causes"]],
        meaning={name: effect.MEANING for name, effect in EFFECTS.items()},
        words=[w["sentence"] for w in content["words"]],
        promise=content.get("promise"),
        unexplained=content["unexplained"],
        against=content.get("against"),
        small=content["small"],
        world=lines(content["world"]),
        advice=content["advice"],
        not_testable=content["not_testable"],
        split=content["split"],
        pose=content["pose"],
    )
    path = folder / "report.html"
    path.write_text(text, encoding="utf-8")
    return path


def sentence(content: dict[str, Any]) -> str:
    """The verdict in words."""
    names = [v.replace("_", " ").replace("|", " or ") for v in content["verdict"] if v not in ("none", "unknown")]
    gap = content["gap"]
    if content["verdict"] == ["none"]:
        return "Camera and simulation agree to within the noise: nothing needs to be added."
    if not names:
        suspects = [c["effect"].replace("_", " ") for c in content["causes"] if not c["asserted"]]
        also = f" Part of it looks like {_listed(suspects)}, but too much is left to be sure." if suspects else ""
        return f"Camera and simulation differ, and no effect known here explains how.{_clue(content['unexplained'])}{also}"
    listed = _listed(names)
    verb = "explain" if len(names) > 1 else "explains"
    how = "" if gap["shrink"] is None else f" and {verb} {_percent(gap['shrink'])} of the gap"
    more = ""
    if "unknown" in content["verdict"]:
        more = f" Something else is left that no effect known here explains.{_clue(content['unexplained'])}"
    return f"Camera and simulation differ by {listed}{', which together' if len(names) > 1 and how else ', which' if how else ''}{how[4:] if how else ''}.{more}"


PLACE = "place in the cell"
GOES_WITH = {"x_m": PLACE, "y_m": PLACE, "z_m": PLACE, "temperature_c": "temperature", "hand": "the camera's place on the hand"}
"""Observables whose names say less than these words."""


def _clue(unexplained: dict[str, Any]) -> str:
    """What the unexplained part goes with and where it is, as a sentence."""
    names = [GOES_WITH.get(q, q.split("_")[0]) for q in unexplained["depends_on"]]
    goes = f"goes with {_listed(list(dict.fromkeys(names)))}" if names else ""
    where = f"shows most on {_listed(unexplained['where'][:3])}" if unexplained["where"] else ""
    clues = "; it ".join(x for x in (goes, where) if x)
    return f" It {clues}." if clues else ""


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{round(share, 2) + 0.0:.0%}"


def _interval(ci: list[float] | None) -> str:
    return "" if ci is None else f" (95 %: {_percent(ci[0])} to {_percent(ci[1])})"


def _fitted(cause: dict[str, Any]) -> str:
    """Parameters in a line, with errors where they are known."""
    params, std = cause["params"], cause["params_std"]
    if params and all(isinstance(p, dict) for p in params.values()):
        return f"{len(params)} parts"
    shown = []
    for name, value in params.items():
        if isinstance(value, float | int):
            error = f" ± {std[name]:.2g}" if isinstance(std.get(name), float) else ""
            shown.append(f"{name} {value:.4g}{error}")
    return ", ".join(shown[:6])
