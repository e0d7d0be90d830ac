# SPDX-License-Identifier: Apache-2.0
"""A diagnosis in lines for a terminal."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from tof_gap.seen.finding import not_expected
from tof_gap.tell.report.absent import absent_words
from tof_gap.tell.report.files import arm_errors, arm_prior
from tof_gap.tell.report.phrases import interval, percent, spaced
from tof_gap.tell.report.unexplained import SHOWN_RMS_MM, unexplained_words, where_to_look
from tof_gap.tell.report.words import (
    calibration_words,
    doubt_words,
    expected_words,
    hand_eye_words,
    most_pixels,
    small_words,
    untested_words,
)
from tof_scene.world.words import lines as world_lines
from tof_scene.world.words import of_views

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.tell.account import Cause
    from tof_gap.tell.diagnosis import Diagnosis


UNKNOWN = "unknown"
"""Verdict for what no effect explains: it stands behind the names."""


def summary(d: Diagnosis) -> list[str]:
    """Lines of the verdict, notes on the recording, the gap, its causes, the calibration, and what was not found, left out or not testable."""
    stray = [f"left out: {of_views(d.stray)}, whose depth fits the CAD only at poses where the arm cannot have been"] if d.stray else []
    return [
        f"verdict: {', '.join(d.verdict)}{meaning_of(d.verdict)}",
        *(f"note: {what} To do: {todo}" for what, todo in d.notes),
        *gap_lines(d),
        *_cause_lines(d),
        *_pose_lines(d),
        *_unexplained_lines(d),
        *world_lines(d.world),
        *stray,
        *absent_words(d.absent, d.solved.caster.scene.names, d.config.select.least_mm),
        *untested_words(d.not_testable),
    ]


def meaning_of(verdict: Sequence[str]) -> str:
    """Meaning of the verdicts `none` and `unknown`."""
    if UNKNOWN in verdict:
        return f" ({'unknown: ' * (len(verdict) > 1)}a difference that no effect known here explains)"
    return " (camera and simulation agree to within the noise)" if "none" in verdict else ""


def gap_lines(d: Diagnosis) -> list[str]:
    """The gap, and what remains of it."""
    g, few = d.gap, d.gap.off_edges_mm is not None
    (before, after), which = g.shown_mm, f" {most_pixels(d.verdict)}" if few else ""
    of_all = f"; {g.above_mm(g.before):.2f} mm with all pixels, of which few are off by centimetres or more" if few else ""
    lines = [
        f"gap{which}, measured minus simulated depth: {before:.2f} mm RMS above the noise of {g.floor_mm:.2f} mm, on views that took no part in the fit{of_all}"
    ]
    if d.asserts:
        if g.shrink is None and before - after < SHOWN_RMS_MM:
            stays = ", and this gap stays" if before >= SHOWN_RMS_MM else ""
            return [*lines, f"the named effects are noise or lost pixels, which change no mean depth{stays}"]
        rest = "" if d.unexplained.structured else ", without structure"
        of_all = f"; {g.above_mm(g.after):.2f} mm with all pixels" if few else ""
        lines.append(f"with the named effects simulated: {after:.2f} mm remain{rest}{of_all}")
        if g.shrink is not None and g.ci95 is not None:
            lines.append(f"the squared gap shrinks by {percent(g.shrink)}; the true effects would shrink it by {interval(g.ci95)}")
    elif d.doubted and d.causes:
        lines.append(doubt_words(d.unexplained.share, d.config.report.unexplained.doubt))
    elif d.verdict != ("none",) and g.above_mm(g.before) >= SHOWN_RMS_MM:
        lines.append("no effect is certain enough to be simulated: the gap remains")
    return lines


def _cause_lines(d: Diagnosis) -> list[str]:
    """Effects of the solution, findings, and effects that a healthy camera has."""
    found = not_expected(d.findings)
    lines = [_cause_line(c, d) for c in d.causes]
    lines += [f"  {f.name}: confidence {f.confidence:.2f}" + (f", {f.note}" if f.note and not f.size else "") for f in found]
    lines += expected_words(d.findings)
    if small := small_words(d.solved.small, {name: 1e3 * size for name, size in d.solved.small_m.items()}):
        lines.append(f"found, but within what a healthy camera or the stated calibration allows: {small}")
    return lines


def _cause_line(c: Cause, d: Diagnosis) -> str:
    """One effect of the solution: its confidence, and the share of the gap that it explains alone."""
    away = c.alone.off_edges
    shrink, of_what = (c.alone.shrink, "the gap") if away is None else (away, f"the gap {most_pixels(d.verdict)}")
    if shrink is None:
        alone = ""
    elif shrink > 0:
        alone = f"; alone it explains {percent(shrink)} of {of_what}"
    else:
        alone = f"; {of_what} shrinks by it only once the other effects are simulated too"
    of = " that it is one of these" if "|" in c.named.verdict else ""
    return f"  {c.named.verdict}{' (suspected)' if d.suspected(c) else ''}: confidence {d.confidence(c):.2f}{of}{alone}"


def _pose_lines(d: Diagnosis) -> list[str]:
    """Errors of the arm against its prior, and the calibration; none where poses have a covariance of their own, as before a board."""
    if d.chain.root is not None:
        return []
    seen, expected = ("{:.1f} mm and {:.2f} degrees".format(*of(d)) for of in (arm_errors, arm_prior))
    of_axis = f"{d.chain.priors.arm_mm:g} mm and {d.chain.priors.arm_deg:g} degrees an axis"
    by_settings = f"{of_axis} by align.priors.arm_mm and arm_deg, which --set changes to those of your arm"
    return [
        f"errors of the arm from view to view: {seen} RMS (lengths, of all three axes together), where the robot's prior expects {expected} ({by_settings})",
        calibration_words(d.config.calibration),
        hand_eye_words(d.hand_eye),
    ]


def _unexplained_lines(d: Diagnosis) -> list[str]:
    if not d.unexplained.structured:
        return []
    left = unexplained_words(d.unexplained, d.simulated)
    suspects = [spaced(c.named.name) for c in d.causes if d.suspected(c)]
    return [f"unexplained: {left} To do: {where_to_look(asdict(d.unexplained), suspects)}"]
