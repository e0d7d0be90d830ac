# SPDX-License-Identifier: Apache-2.0
"""What the nodes find, as messages of toftwin_msgs. Import it only where that package is installed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from toftwin_msgs.action import Diagnose
from toftwin_msgs.msg import CorrectionProposal, Dwell, GapReport, InspectionVerdict, NamedEffect, PartVerdict

from tof_ros import messages

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from std_msgs.msg import Header

    from tof_core.capture import View


def dwell(view: View, head: Header, *, ended: bool = False) -> Dwell:
    """Which dwell a view belongs to, and whether that has `ended`."""
    return Dwell(
        header=head,
        first=messages.to_stamp(view.dwell_ns),
        station=view.station,
        captures=view.captures,
        amplitude=view.amplitude is not None,
        temperature=float(view.temperature),
        ended=ended,
    )


PART_STATES = {
    "not_observable": PartVerdict.NOT_OBSERVABLE,
    "present": PartVerdict.PRESENT,
    "displaced": PartVerdict.DISPLACED,
    "absent": PartVerdict.ABSENT,
}


def inspection(verdicts: Iterable[Any], views: Sequence[View], evidence: str, frame: str) -> InspectionVerdict:
    """Verdicts of the parts (`tof_inspect.judge.PartVerdict`) of the cell with that frame."""
    return InspectionVerdict(
        header=messages.header(views[-1].stamp_ns, frame),
        views=[messages.to_stamp(view.stamp_ns) for view in views],
        parts=[_part(v) for v in verdicts],
        evidence=evidence,
    )


def _part(v: Any) -> PartVerdict:
    return PartVerdict(
        name=v.name,
        state=PART_STATES[v.state],
        probability=float(v.probability),
        pixels=int(v.pixels),
        views=int(v.views),
        displacement=1e-3 * v.displaced_mm,
        displacement_std=1e-3 * v.std_mm,
        tolerance=1e-3 * v.tolerance_mm,
        why=v.why,
    )


PROPOSALS = {"refused": CorrectionProposal.REFUSED, "partial": CorrectionProposal.PARTIAL, "accepted": CorrectionProposal.ACCEPTED}


def proposal(made: Any, head: Header) -> CorrectionProposal:
    """A proposal (`arm_correction.correction.Correction`); a refused one has no target."""
    mm, deg = made.step
    out = CorrectionProposal(header=head, verdict=PROPOSALS[made.verdict], reason=made.reason, registered_to=made.by)
    out.delta.orientation.w = 1.0
    if made.accepted:
        out.distance, out.angle = 1e-3 * mm, math.radians(deg)
        messages.set_pose(out.target.pose, made.T_frame_hand)
        out.target.covariance = made.cov.reshape(-1)
        messages.set_pose(out.delta, made.delta)
    return out


GAP_STATES = {"learning": GapReport.LEARNING, "steady": GapReport.STEADY, "grown": GapReport.GROWN}


def gap_report(watched: Any, head: Header) -> GapReport:
    """The gap of a view (`tof_gap.watch.Watched`)."""
    return GapReport(
        header=head,
        state=GAP_STATES[watched.state],
        gap=1e-3 * watched.gap_mm,
        floor=1e-3 * watched.floor_mm,
        usual=1e-3 * watched.usual_mm,
        alarm=float(watched.alarm),
        views=watched.views,
    )


def diagnosis(content: Mapping[str, Any], views: int) -> Diagnose.Result:
    """A diagnosis (the content of gap.json)."""
    gap = content["gap"]
    floor = gap["floor_mm"]
    low, high = gap["shrink_ci95"] or (None, None)
    return Diagnose.Result(
        success=True,
        message=f"verdict: {', '.join(content['verdict'])}",
        verdict=list(content["verdict"]),
        effects=[
            NamedEffect(name=c["effect"], confidence=_number(c["confidence"]), explains=_number(c["alone"]["shrink"]))
            for c in content["causes"]
        ],
        gap_before=_above(gap["before_mm"]["rmse"], floor),
        gap_after=_above(gap["after_mm"]["rmse"], floor),
        floor=1e-3 * _number(floor),
        shrink=_number(gap["shrink"]),
        shrink_low=_number(low),
        shrink_high=_number(high),
        views=views,
        report=str(content.get("page", "")),
    )


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _above(rmse_mm: float | None, floor_mm: float | None) -> float:
    """Metres of gap in an RMS error, without the noise in it."""
    square = _number(rmse_mm) ** 2 - _number(floor_mm) ** 2
    return square if math.isnan(square) else 1e-3 * math.sqrt(max(square, 0.0))
