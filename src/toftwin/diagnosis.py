# SPDX-License-Identifier: Apache-2.0
"""The diagnosis of a bag: its views, its scene and the known effects, given to `tof_gap`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core.config import param, section
from tof_core.memory import one_heap
from tof_core.registered import REMEDY, WHAT, registered
from tof_gap.compare.difference import AgainstLimits
from tof_gap.config import GapConfig
from tof_gap.seen.evidence.rectified import rounded_mm
from tof_gap.seen.finding import CONFIDENT, Finding
from tof_gap.session import diagnose_session
from tof_gap.tell.diagnosis import Note
from tof_scene.raycast import Raycaster
from tof_sensor.effects.intrinsics import Intrinsics
from tof_sensor.effects.radial_depth import RadialDepth
from toftwin.boarded import NOT_TESTABLE, BoardSource
from toftwin.pipeline import PipelineConfig, raw_views
from toftwin.retraining import RetrainConfig
from toftwin.z_table import converted, reading

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_core.bag import BagReader
    from tof_core.board.lens import LensFault
    from tof_core.capture import View
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_scene.scene import Scene
    from tof_sensor.model import SensorModel
    from toftwin.boarded import BoardSession


TURN_DEG = 0.9
"""Standard deviation in degrees by which a board appears turned in one view: before a Kinect v2 0.8 and 0.9 about the two axes (RMS of 21 views), where the corners are accurate to 0.2."""


LONG_PIXELS = 8_000_000
"""Pixels of all views from which memory is scarcer than time: 22 views of 640x576. One heap for all threads saves a tenth of the memory
of sixty such views and takes 5 to 9 % more processor time."""


@dataclass(frozen=True, slots=True)
class GapPipelineConfig(PipelineConfig):
    """Settings of the pipeline and of the diagnosis."""

    moving_views: int = param(
        40,
        "views in motion that are used, spread over the bag",
        low=1,
        why="a recorder that runs while the robot drives makes a view of every frame; each costs as much as one at rest, and forty show motion",
    )
    gap: GapConfig = section(GapConfig, "when an effect is believed")
    against: AgainstLimits = section(AgainstLimits, "when a simulator differs from the camera")
    retrain: RetrainConfig = section(RetrainConfig, "training with the fitted sensor")


def diagnose_bag(
    reader: BagReader | BoardSource,
    scene: Scene,
    config: GapPipelineConfig,
    *,
    known: SensorModel | None = None,
    left_out: frozenset[str] = frozenset(),
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[Diagnosis, Raycaster]:
    """Read every view unfiltered, remove the bias of the effects in `known`, and diagnose the rest."""
    progress("reading views")
    views = raw_views(reader, config, config.moving_views)
    if sum(v.depth.size for v in views) > LONG_PIXELS:
        one_heap()
    caster = Raycaster(scene)
    if isinstance(reader, BoardSource):
        return diagnose_before_board(reader.session, views, caster, config, known=known, left_out=left_out, progress=progress), caster
    found = diagnose_session(views, caster, config.gap, config.align, known=known, left_out=left_out, progress=progress)
    return replace(found, notes=(*notes_on(views, reader.topics.depth), *notes_on_rays(found.evidence))), caster


def notes_on(views: Sequence[View], topic: str) -> tuple[Note, ...]:
    """What matters to the verdict about the depth of a recording and its topic."""
    single = [v for v in views if v.captures == 1] or views  # The mean of captures between which the robot sways has hardly a copy.
    why = registered([v.depth for v in single], topic, [v.amplitude for v in single])
    return (Note(f"{why}. {WHAT}.", f"{REMEDY.capitalize()}."),) if why else ()


def notes_on_rays(views: Sequence[ViewEvidence]) -> tuple[Note, ...]:
    """That a driver rectified depth by the nearest pixel, where the views show it."""
    size_mm = rounded_mm(views)
    if size_mm is None:
        return ()
    what = f"The driver rectifies depth by the nearest pixel, so that a pixel holds the depth of a ray up to half a pixel beside it: {size_mm:.1f} mm RMS on slopes. This is taken off before effects are looked for."
    return (
        Note(what, "Have the driver interpolate between pixels of one surface, or publish the sensor's own image with its distortion."),
    )


def diagnose_before_board(
    session: BoardSession,
    views: Sequence[View],
    caster: Raycaster,
    config: GapPipelineConfig,
    *,
    known: SensorModel | None = None,
    left_out: frozenset[str] = frozenset(),
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Diagnose views of a session before a board, all of them or some; arguments as of `diagnose_bag`."""
    gap = replace(config.gap, calibration=session.calibration(config.gap.calibration))
    views = [turning(v, caster.scene) for v in views]
    fault, given = session.lens_fault, list[Finding]()
    if fault is not None and Intrinsics.NAME not in left_out:
        given.append(lens_finding(fault))
    if (found := reading(views, caster.scene, left_out)) is not None:  # The reading decides about distance along the ray.
        views, conversions = converted(views, found, config.gap.evidence.level)
        given, left_out = [*given, *conversions], left_out | {RadialDepth.NAME}
    return diagnose_session(
        views,
        caster,
        gap,
        session.align(config.align),
        known=known,
        left_out=left_out,
        progress=progress,
        untestable=NOT_TESTABLE,
        given=given,
    )


def turning(view: View, scene: Scene) -> View:
    """The view, with the additional uncertainty of a turn of the board: `TURN_DEG` about either axis through its middle.

    Ambient light, which no scene of a board describes, changes depth from one side of the board to the other, in every view
    otherwise. Pixels of one view are then no independent samples of an error over range or image: such errors are compared between views.
    """
    assert view.robot is not None
    assert view.robot.cov is not None
    T = view.robot.T_cell_camera
    corners = np.concatenate([part.vertices for part in scene.parts])
    middle = T[:3, :3].T @ (0.5 * (corners.min(axis=0) + corners.max(axis=0)) - T[:3, 3])
    axes = T[:2, :3]  # of the board, in the camera frame: a turn w about its middle is a step (middle x w, w) of the camera
    turns = np.concatenate([np.cross(middle, axes), axes], axis=1) * np.radians(TURN_DEG)
    return replace(view, robot=replace(view.robot, cov=view.robot.cov + turns.T @ turns))


def lens_finding(fault: LensFault) -> Finding:
    """An `intrinsics` finding for CameraInfo's lens that the corners contradict; the camera's own conversion of distance to z is not affected."""
    stated, fitted = fault.stated, fault.camera
    distortion = np.zeros((2, 4))
    for row, camera in zip(distortion, (stated, fitted), strict=True):
        row[: min(4, len(camera.distortion))] = camera.distortion[:4]
    change = [
        fitted.fx / stated.fx - 1,
        fitted.fy / stated.fy - 1,
        fitted.cx - stated.cx,
        fitted.cy - stated.cy,
        *(distortion[1] - distortion[0]),
    ]
    effect = Intrinsics(z_from="true_lens").plausible(np.array(change))
    std = fault.std[:8] / [stated.fx, stated.fy, *np.ones(6)]
    note = f"the board's corners are off by {fault.stated_px:.2f} px through the stated lens, by {fault.fitted_px:.2f} px through another"
    return Finding(effect, CONFIDENT, dict(zip(Intrinsics.LINEAR, std.tolist(), strict=True)), note=note)
