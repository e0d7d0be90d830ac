# SPDX-License-Identifier: Apache-2.0
"""A bag to a correction: its last dwell against a reference, against the CAD, or both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from arm_correction.cad import register_to_cad
from arm_correction.config import CorrectConfig
from arm_correction.correction import Correction, propose
from arm_correction.match import reference_surface, register_view
from arm_correction.reference import Reference, capture_reference
from tof_align.single import align_view
from tof_core import se3
from tof_core.config import section
from tof_core.errors import RefusedError, UsageError
from toftwin.pipeline import PipelineConfig, ViewStream

if TYPE_CHECKING:
    from arm_correction.register import Registration
    from tof_core.arrays import Float
    from tof_core.bag import BagReader
    from tof_core.capture import View
    from tof_scene.scene import Scene


@dataclass(frozen=True, slots=True)
class CorrectionConfig(PipelineConfig):
    """Everything between a bag and a correction."""

    correct: CorrectConfig = section(CorrectConfig, "registration, trust and limits")


def views_of(reader: BagReader, config: CorrectionConfig) -> list[View]:
    """The dwells of a bag whose robot pose is known."""
    views = [v for v in ViewStream(reader, config) if v.robot is not None]
    if not views:
        raise RefusedError("no view has a robot pose", where="correction", todo="toftwin doctor tells what the bag lacks")
    return views


def make_reference(view: View, scene: Scene | None, config: CorrectionConfig) -> Reference:
    """The first picture of a view; with a scene also where the CAD says that it was taken."""
    if scene is None:
        return capture_reference(view, config.correct.weights)
    from tof_scene.raycast import Raycaster

    assert view.robot is not None
    priors = config.align.priors
    found = align_view(view, Raycaster(scene), view.robot.T_cell_camera, np.diag(priors.base**2), config.align)
    by_cad = found.posed.T_cell_camera if found.posed.accepted else None
    return capture_reference(view, config.correct.weights, scene=scene.digest, T_cell_camera=by_cad)


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Hand-eye and the frame of the target, from TF at the view's stamp."""

    T_hand_camera: Float
    T_frame_body: Float | None
    frame: str


def frames_of(reader: BagReader, view: View, hand: str, frame: str) -> Frames:
    """Look up the hand (default: `hand` or `*/hand`; the camera itself where TF has none) and the wanted frame (default: the body)."""
    camera, tf = reader.camera.frame_id, reader.transforms
    cell, body = reader.chain.resolve(camera)
    body = body or cell
    known = [f for f in tf.frames() if f.rpartition("/")[2] == "hand"]
    if hand and hand not in tf.frames():
        raise UsageError(f"TF has no frame '{hand}'", where="--hand-frame", todo=f"TF has {', '.join(tf.frames())}")
    name = hand or (known[0] if known else camera)
    T_hand_camera = tf.lookup(name, camera, view.stamp_ns) if name != camera else np.eye(4)
    if frame in {"", "body"}:
        return Frames(T_hand_camera, None, body)
    return Frames(T_hand_camera, tf.lookup(frame, body, view.stamp_ns), frame)


def correct_views(
    views: list[View], reference: Reference | None, scene: Scene | None, frames: Frames, config: CorrectionConfig
) -> dict[str, Correction]:
    """Corrections of the last view by what it was registered to: `reference` first where there is one, then `cad`."""
    view = views[-1]
    assert view.robot is not None
    out: dict[str, Correction] = {}
    if reference is not None:
        reference.check(view, scene.digest if scene else "")
        surface = reference_surface(reference, config.correct)
        found = register_view(reference, surface, view, config.correct)
        twin = _twin(views, config)
        earlier = register_view(reference, surface, twin, config.correct) if twin is not None else None
        out["reference"] = _proposal(found, view, frames, config, "reference", earlier)
    if scene is not None:
        from tof_scene.raycast import Raycaster

        wanted = view.robot.T_cell_camera
        if reference is not None:
            wanted = reference.T_cell_body @ reference.T_body_camera if reference.T_cell_camera is None else reference.T_cell_camera
        found = register_to_cad(view, Raycaster(scene), wanted, view.robot.T_cell_camera,
                                base_mm=config.align.priors.base_mm, base_deg=config.align.priors.base_deg)  # fmt: skip
        out["cad"] = _proposal(found, view, frames, config, "cad", None)
    if not out:
        raise UsageError("neither a reference nor a scene is given", where="correct", todo="pass --reference, --scene, or both")
    return out


def _twin(views: list[View], config: CorrectionConfig) -> View | None:
    """The dwell before the last one, if the robot had not moved between them."""
    if len(views) < 2:
        return None
    a, b, limits = views[-2].robot, views[-1].robot, config.correct.limits
    assert a is not None
    assert b is not None
    metres, degrees = se3.distance(a.T_cell_camera, b.T_cell_camera)
    return views[-2] if 1e3 * metres < limits.moved_mm and degrees < limits.moved_deg else None


def _proposal(
    found: Registration, view: View, frames: Frames, config: CorrectionConfig, by: str, earlier: Registration | None
) -> Correction:
    assert view.robot is not None
    return propose(found, view.robot, config.correct, T_hand_camera=frames.T_hand_camera, T_frame_body=frames.T_frame_body,
                   frame=frames.frame, earlier=earlier, by=by)  # fmt: skip
