# SPDX-License-Identifier: Apache-2.0
"""The diagnosis of a session as the report reads it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from tof_gap.seen.foreign.light import beside_light

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_align.chain import Chain
    from tof_core.arrays import Float
    from tof_core.camera import Camera
    from tof_gap.config import GapConfig
    from tof_gap.limits.report import ReportLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.seen.finding import Finding
    from tof_gap.solved import Bound, Solved, Split
    from tof_gap.tell.account import Account, Cause
    from tof_gap.tell.figures.shrink import Shrink
    from tof_gap.tell.unexplained import Unexplained
    from tof_sensor.effects.photon_law import PhotonLaw


class Note(NamedTuple):
    """What matters to the verdict about the depth of a recording, in a sentence, and what to do about it, in another."""

    what: str
    todo: str


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """All that the report states; lists are per view in bag order.

    verdict: effects, `none`, `unknown`, sorted; account: what was read off the solution, with its poses, maps and figures;
    explainable: share of the gap that any model could explain, None without a gap; unexplained: what no named effect explains;
    not_testable: effects that the session cannot test, each with the reason; law: photon law of the noise that is not named,
    None where too few pixels show it; world: missing parts and foreign objects (`tof_scene.world.words.described`); stray: views
    that contradict the robot and were left out; absent: for each effect that was tested and not found, what it stays below (`tell.report.absent`),
    None without a bound; notes: on the depth of the recording.
    """

    verdict: tuple[str, ...]
    account: Account
    explainable: float | None
    unexplained: Unexplained
    not_testable: dict[str, str]
    law: PhotonLaw | None
    config: GapConfig
    world: Mapping[str, Sequence[Mapping[str, Any]]] = field(default_factory=lambda: {"missing": (), "foreign": ()})
    stray: tuple[int, ...] = ()
    absent: Mapping[str, Bound | None] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()

    @property
    def solved(self) -> Solved:
        """Poses and effects."""
        return self.account.solved

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Effects of the solution."""
        return self.account.causes

    @property
    def doubted(self) -> bool:
        """Whether so much of the gap is unexplained that the effects of the solution are only suspected."""
        return doubted(self.unexplained, self.config.report)

    @property
    def asserts(self) -> bool:
        """Whether the verdict names an effect."""
        return self.verdict not in (("none",), ("unknown",))

    @property
    def simulated(self) -> str:
        """Which effects are subtracted before the rest is called unexplained: "named" ones, "suspected" ones, or none ("")."""
        if self.doubted and self.causes:
            return "suspected"
        return "named" if self.asserts else ""

    def suspected(self, cause: Cause) -> bool:
        """Whether a cause is not asserted: much is unexplained beside it, or too few views show it."""
        return self.doubted or cause.named.suspected

    def confidence(self, cause: Cause) -> float:
        """Of a cause, 0 to 1: share of the resampled sets of views that choose it, times the share of such names that proved right."""
        right = self.config.report.confidence
        return cause.named.confidence * (right.suspected if self.suspected(cause) else right.asserted * (1.0 - self.unexplained.share))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Effects that noise, loss or edges show."""
        return self.account.findings

    @property
    def gap(self) -> Shrink:
        """The gap on held-out views before and after all named effects."""
        return self.account.gap

    @property
    def evidence(self) -> tuple[ViewEvidence, ...]:
        """The views at the final poses."""
        return self.account.solved.evidence

    @property
    def residual(self) -> Sequence[Float]:
        """(H, W) metres of z, measured minus rendered, before any effect."""
        return self.account.figures.residual

    @property
    def floor2(self) -> Sequence[Float]:
        """(H, W) m^2 of noise and pose posterior."""
        return self.account.figures.floors

    @property
    def shares(self) -> Mapping[str, Sequence[Float]]:
        """(H, W) metres of z per named effect."""
        return self.account.figures.maps

    @property
    def chain(self) -> Chain:
        """The final poses without hand-eye and lateness."""
        return self.account.solved.chain

    @property
    def camera(self) -> Camera:
        """The camera as CameraInfo states it."""
        return self.account.solved.camera

    @property
    def cameras(self) -> Float:
        """(V, 4, 4) T_cell_camera, hand-eye and lateness in, and no steps along the view that another camera's light makes."""
        solved = self.account.solved
        return beside_light(solved.cameras, solved.arms, solved.arms_sd, self.account.figures.posed_m)

    @property
    def hand_eye(self) -> Float:
        """(4, 4) X."""
        return self.account.solved.hand_eye

    @property
    def split(self) -> Split:
        """Views fitted to and held out."""
        return self.account.solved.split


def doubted(unexplained: Unexplained, limits: ReportLimits) -> bool:
    """Whether more of the gap is unexplained than `limits.unexplained.doubt` allows."""
    return unexplained.structured and unexplained.share > limits.unexplained.doubt
