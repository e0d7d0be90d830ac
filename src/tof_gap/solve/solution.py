# SPDX-License-Identifier: Apache-2.0
"""A joint solution of poses and effects: its chain, its lateness, its lens."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from tof_align.chain import Chain
    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.solve.choose.select import Selection
    from tof_gap.solve.hypotheses.candidate import Candidate
    from tof_gap.solve.hypotheses.columns import Design
    from tof_gap.solved import Bound
    from tof_sensor.effect import Effect
    from tof_sensor.effects.intrinsics import Intrinsics


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """Evidence at the joint solution's poses, and the selection made there."""

    chain: Chain
    views: tuple[ViewEvidence, ...]
    design: Design
    selection: Selection
    late_s: float = 0.0
    """Lateness of the stamps in seconds that the chain's robot poses correct; the residuals still contain it."""
    asked: frozenset[str] = frozenset()
    """Names of the effects that the selection could choose: neither left out nor untestable. The design may hold the chosen ones alone."""
    bounds: Mapping[str, Bound] = field(default_factory=dict)
    """For effects that were tried and not chosen, what they stay below (`solve.absent`)."""

    @property
    def hand_eye(self) -> Float:
        """(4, 4) X of the solution."""
        return np.asarray(self.chain.hand_eye @ se3.exp(self.selection.fit.hand_eye))

    def members(self) -> Iterator[tuple[Candidate, Float]]:
        """For each member of the solution, its candidate, and its coefficients in their own units."""
        for candidate, group, at in self.design.placed(self.selection.chosen.members):
            yield candidate, self.selection.fit.theta[at] / self.design.scale[group]


def solution(joint: Joint) -> tuple[Chain, float]:
    """The chain after the solution's steps, with robot poses at the estimated times, and the lateness in seconds."""
    after = joint.selection.fit.moved(joint.chain)
    late_s = sum(c.effect.with_coefficients(values).late_s for c, values in joint.members() if c.effect is not None)
    return delayed(after, joint.views, late_s - joint.late_s), late_s


def delayed(chain: Chain, views: Sequence[ViewEvidence], seconds: float) -> Chain:
    """The chain with the robot's poses `seconds` later, by each camera's velocity."""
    if seconds == 0.0:
        return chain
    steps = [se3.exp(seconds * v.frame.context.twist) for v in views]
    return replace(chain, robot=np.array([T @ step for T, step in zip(chain.robot, steps, strict=True)]))


def calibrated_lens(joint: Joint) -> Intrinsics | None:
    """The solution's lens within its stated calibration; None where the calibration is exact."""
    members = joint.selection.chosen.members
    columns = joint.design.lens(members)
    if not len(columns):
        return None
    fx, fy, cx, cy = (joint.selection.fit.theta[: len(columns)] / joint.design.scale[columns]).tolist()
    return replace(joint.design.form(members), fx_rel=fx, fy_rel=fy, cx_px=cx, cy_px=cy)


def lens_of(joint: Joint) -> Effect | None:
    """The solution's lens as an effect, the named and the calibrated part together; None where it is that of CameraInfo."""
    camera, calibrated = joint.views[0].view.camera, calibrated_lens(joint)
    there = (c.effect.plausible(values) for c, values in joint.members() if c.effect is not None)
    named = next((effect for effect in there if effect.camera(camera) != camera), None)
    if named is None or calibrated is None:
        return named or calibrated
    return named.plausible(named.coefficients + calibrated.coefficients)


def through(lens: Effect | None, views: Sequence[View]) -> Sequence[View]:
    """The views as of a camera with that lens."""
    if lens is None:
        return views
    ratio = lens.published(views[0].camera)
    return [replace(v, camera=lens.camera(v.camera), depth=(v.depth / ratio).astype(v.depth.dtype)) for v in views]
