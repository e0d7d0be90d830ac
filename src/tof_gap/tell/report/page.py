# SPDX-License-Identifier: Apache-2.0
"""`report.html`: one page that a plant engineer understands; no network, everything escaped."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.memory import give_back
from tof_core.page import render_page
from tof_gap.tell.figures.where import Bin
from tof_gap.tell.report import pictures
from tof_gap.tell.report.absent import absent_words
from tof_gap.tell.report.kept import GROWS
from tof_gap.tell.report.phrases import interval, percent
from tof_gap.tell.report.plant import course_of
from tof_gap.tell.report.unexplained import unexplained_words
from tof_gap.tell.report.words import expected_words, most_pixels, sentence, size_in_words, small_words, todo
from tof_scene.world.words import lines, of_views
from tof_sensor.registry import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tof_gap.tell.diagnosis import Diagnosis
    from tof_sensor.session import Course


def write_page(d: Diagnosis, content: dict[str, Any], folder: Path, title: str, names: Sequence[str] = ()) -> Path:
    """Write `report.html` beside `gap.json`, whose `content` it shows; `names` of the scene's parts stand on the map."""
    give_back()  # What the report's figures have freed.
    remaining = _left(d)
    gap, world, course = content["gap"], lines(content["world"]), course_of(d)
    by = {name: [Bin(**b) for b in bins] for name, bins in content["where"]["by"].items()}
    main, others = pictures.by_quantity(by)
    text = render_page(
        "tof_gap.tell.report",
        "report.html.j2",
        f"Simulation against camera: {title}",
        sentence=sentence(content),
        notes=[note.what for note in d.notes],
        named=any(v not in ("none", "unknown") for v in content["verdict"]),
        todo=todo(content),
        gap=gap,
        before_mm=d.gap.shown_mm[0],
        after_mm=d.gap.shown_mm[1],
        all_mm=(d.gap.above_mm(d.gap.before), d.gap.above_mm(d.gap.after)),
        most_pixels=most_pixels(d.verdict),
        percent=percent,
        shrink=percent(gap["shrink"]),
        interval=interval(gap["shrink_ci95"]),
        picture={
            "cad": pictures.on_the_cad(d, remaining, names),
            "how_far": pictures.how_far(d),
            "views": pictures.views(d, remaining),
            "by": main,
            "others": others,
        },
        regions=content["where"]["regions"],
        causes=[c | {"fitted": _fitted(c, content, course)} for c in content["causes"]],
        meaning={name: effect.MEANING for name, effect in EFFECTS.items()},
        words=[w["sentence"] for w in content["words"]],
        promise=content.get("promise"),
        grows=GROWS,
        expected=expected_words(d.findings),
        left=unexplained_words(d.unexplained, d.simulated) if d.unexplained.structured else "",
        against=content.get("against"),
        doubted=d.doubted,
        small=small_words(content["small"], content.get("small_mm", {})),
        world=world,
        advice=content["advice"],
        least_mm=d.config.select.least_mm,
        absent=absent_words(d.absent, d.solved.caster.scene.names, d.config.select.least_mm),
        not_testable=content["not_testable"],
        split=content["split"],
        of_views=of_views,
        pose=content["pose"],
    )
    path = folder / "report.html"
    path.write_text(text, encoding="utf-8")
    return path


def _fitted(cause: dict[str, Any], content: dict[str, Any], course: Course) -> str:
    """The size of a cause in its own units; of several waves, what they make together."""
    text = size_in_words(cause, course)
    several = all(isinstance(p, dict) for p in cause["params"].values()) and len(cause["params"]) > 1
    together: dict[str, str] = {w["effect"]: w["size"] for w in content.get("words", ())} if text and several else {}
    return together.get(cause["effect"], text)


def map_picture(d: Diagnosis, names: Sequence[str]) -> str:
    """The parts coloured by the gap, before and after the named effects are added."""
    return pictures.on_the_cad(d, _left(d), names)


def _left(d: Diagnosis) -> list[Any]:
    """(H, W) residual of each view without what the named effects explain."""
    return [r - np.sum([np.zeros_like(r), *(np.nan_to_num(m[v]) for m in d.shares.values())], axis=0) for v, r in enumerate(d.residual)]
