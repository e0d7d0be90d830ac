# SPDX-License-Identifier: Apache-2.0
"""Proposals from the last dwells, against a prepared reference and CAD; one command at a time."""

from __future__ import annotations

from contextlib import contextmanager
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

from arm_correction.cad import register_to_cad
from arm_correction.config import CorrectConfig
from arm_correction.correction import Correction, Moment, propose
from arm_correction.first import First
from arm_correction.frames import Frames
from arm_correction.reference import Reference, capture_reference
from tof_align.config import AlignConfig
from tof_align.known import known_removed_alone
from tof_align.single import align_view
from tof_core import se3
from tof_core.errors import RefusedError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from arm_correction.config import LimitConfig
    from arm_correction.register import Registration
    from tof_align.known import Bias
    from tof_core.arrays import Float, Mask
    from tof_core.capture import RobotPose, View
    from tof_scene.raycast import Raycaster


class Corrector:
    """State of the node: `capture` or `use` a reference, then `propose`. A command that arrives while another runs is refused."""

    def __init__(
        self,
        config: CorrectConfig | None = None,
        align: AlignConfig | None = None,
        *,
        caster: Raycaster | None = None,
        reference: Reference | None = None,
        bias: Bias | None = None,
    ) -> None:
        """Without reference and CAD, nothing can be proposed.

        Args:
            config: registration, acceptance, limits.
            align: registration to the CAD.
            caster: the CAD, for corrections to it.
            reference: a stored view, for corrections to it; may be given later.
            bias: known bias of the camera, removed before a view is compared with the CAD; between view and reference it cancels.
        """
        self.config, self._align, self._caster = config or CorrectConfig(), align or AlignConfig(), caster
        self._bias = bias
        self._busy = Lock()
        self._first: First | None = None
        if reference is not None:
            self.use(reference)

    @property
    def reference(self) -> Reference | None:
        """The reference, if there is one."""
        return self._first.reference if self._first else None

    @property
    def caster(self) -> Raycaster | None:
        """The CAD, if there is one."""
        return self._caster

    @property
    def scene(self) -> str:
        """Digest of the CAD, "" without one."""
        return self._caster.scene.digest if self._caster else ""

    def capture(self, view: View, region: Mask | None = None) -> Reference:
        """Store a view as the reference; with CAD also its pose by the CAD."""
        with self._alone():
            return self._keep(
                capture_reference(view, self.config.weights, region=region, scene=self.scene, T_cell_camera=self._by_cad(view))
            )

    def use(self, reference: Reference) -> None:
        """Use an existing reference; one of another scene is refused."""
        reference.check_scene(self.scene)
        with self._alone():
            self._keep(reference)

    def propose(
        self,
        views: Sequence[View],
        frames: Frames | None = None,
        pose_now: Callable[[], RobotPose] | None = None,
        *,
        age_s: float = 0.0,
    ) -> dict[str, Correction]:
        """Target of the hand for each registration of the last view: `reference` first where there is one, then `cad`.

        Args:
            views: the last dwells in order of time; the one before the last must agree where the robot had not moved between.
            frames: hand-eye and the frame of the target.
            pose_now: returns the robot's pose; called after each registration, during which the robot may have moved.
            age_s: of the last view when the proposal was asked for, seconds; the time that the registration takes is not its age.

        Raises:
            RefusedError: busy; neither a reference nor CAD; a view of another camera, or an empty one; no robot pose.
        """
        with self._alone():
            view, frames = views[-1], frames or Frames()
            if view.robot is None:
                raise RefusedError("the view has no robot pose", where="correction", todo="publish TF from the cell to the camera")
            if self._first is None and self._caster is None:
                raise RefusedError("there is no reference and no scene", where="correction", todo="capture a reference first")
            out: dict[str, Correction] = {}

            def moment() -> Moment:
                return Moment(age_s, pose_now() if pose_now else None)

            if self._first is not None:
                out["reference"] = self._to_reference(self._first, views, view.robot, frames, moment)
            if self._caster is not None:
                out["cad"] = self._to_cad(self._caster, view, view.robot, frames, moment)
            return out

    def _keep(self, reference: Reference) -> Reference:
        self._first = First.of(reference, self.config, self._caster)
        return reference

    def _to_reference(
        self, first: First, views: Sequence[View], robot: RobotPose, frames: Frames, moment: Callable[[], Moment]
    ) -> Correction:
        found, twin = first.register(views[-1], self.config), twin_of(views, self.config.limits)
        earlier = first.register(twin, self.config) if twin is not None else None
        return self._proposed(found, robot, frames, moment, earlier)

    def _to_cad(self, caster: Raycaster, view: View, robot: RobotPose, frames: Frames, moment: Callable[[], Moment]) -> Correction:
        wanted, priors = robot.T_cell_camera, self._align.priors
        if (first := self.reference) is not None:
            wanted = first.T_cell_body @ first.T_body_camera if first.T_cell_camera is None else first.T_cell_camera
        found = register_to_cad(
            self._clean(view, caster), caster, wanted, robot.T_cell_camera, base_mm=priors.base_mm, base_deg=priors.base_deg
        )
        return self._proposed(found, robot, frames, moment, None)

    def _proposed(
        self, found: Registration, robot: RobotPose, frames: Frames, moment: Callable[[], Moment], earlier: Registration | None
    ) -> Correction:
        return propose(
            found, robot, self.config, T_hand_camera=frames.T_hand_camera, T_frame_body=frames.T_frame_body, frame=frames.frame,
            earlier=earlier, moment=moment(),
        )  # fmt: skip

    def _by_cad(self, view: View) -> Float | None:
        if self._caster is None or view.robot is None:
            return None
        clean = self._clean(view, self._caster)
        posed = align_view(clean, self._caster, view.robot.T_cell_camera, np.diag(self._align.priors.base**2), self._align).posed
        return posed.T_cell_camera if posed.accepted else None

    def _clean(self, view: View, caster: Raycaster) -> View:
        """The view less the known bias of the camera."""
        if self._bias is None or view.robot is None:
            return view
        prior = np.diag(self._align.priors.base**2)
        return known_removed_alone(view, caster, self._bias, view.robot.T_cell_camera, prior, self._align)

    @contextmanager
    def _alone(self) -> Iterator[None]:
        if not self._busy.acquire(blocking=False):
            raise RefusedError("busy with another command", where="correction", todo="repeat the command once the other one is done")
        try:
            yield
        finally:
            self._busy.release()


def twin_of(views: Sequence[View], limits: LimitConfig) -> View | None:
    """The dwell before the last one, if the robot had not moved between them (a base that drove away and came back has moved)."""
    if len(views) < 2 or views[-2].station != views[-1].station or views[-2].robot is None or views[-1].robot is None:
        return None
    metres, degrees = se3.distance(views[-2].robot.T_cell_camera, views[-1].robot.T_cell_camera)
    return views[-2] if 1e3 * metres < limits.moved_mm and degrees < limits.moved_deg else None
