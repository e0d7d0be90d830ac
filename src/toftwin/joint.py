# SPDX-License-Identifier: Apache-2.0
"""Poses of a session solved together with the effects that its diagnosis names, and the parts that it finds elsewhere."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_align.session import solve_session
from tof_core.config import flatten, from_mapping
from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.effects.intrinsics import Intrinsics
from toftwin.cameras import Cameras
from toftwin.diagnosis import GapPipelineConfig, diagnose_bag
from toftwin.displaced import displaced_parts, unsure_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_core.bag import BagReader
    from tof_core.capture import View
    from tof_gap.solved import Solved
    from tof_scene.raycast import Raycaster
    from tof_sensor.model import SensorModel
    from toftwin.boarded import BoardSource
    from toftwin.pipeline import PipelineConfig


def joint_poses(
    reader: BagReader | BoardSource, views: Sequence[View], caster: Raycaster, config: PipelineConfig, known: SensorModel | None = None
) -> Cameras:
    """Cameras of a bag's views with the camera's errors removed: first those that are `known`, then those that a diagnosis finds.

    The bias that the joint solution ascribes to the camera is removed, and the poses are solved again: from the pixels that the filters
    kept, against the parts where the diagnosis finds them, with a verdict for each view, through the diagnosed lens, and with the
    covariance of the unexplained error.

    Raises:
        RefusedError: the session cannot be diagnosed, or fits the scene nowhere.
    """
    diagnosis, _ = diagnose_bag(reader, caster.scene, from_mapping(GapPipelineConfig, flatten(config)), known=known)
    solved = diagnosis.solved
    stamps = np.array([e.view.stamp_ns for e in solved.evidence])
    at = [int(np.argmin(np.abs(stamps - v.stamp_ns))) for v in views]
    bias = [_bias(solved, k) for k in at]
    # A lens within its calibration is estimated again with the poses: beside it, the diagnosis weighs pixels for names and not for rays.
    wrong_lens = any(c.name == Intrinsics.NAME for c in solved.named)
    clean = [
        replace(v, camera=solved.bare[k].view.camera if wrong_lens else v.camera, depth=(v.depth - np.nan_to_num(b)).astype(np.float32))
        for v, k, b in zip(views, at, bias, strict=True)
    ]
    displaced = displaced_parts(diagnosis.verdict, solved.named)
    found = Cameras([], displaced).caster(caster)
    posed = unsure_of(solve_session(clean, found, config.align).posed, caster.scene, displaced)
    cameras = [p.seen_by(c.camera) for p, c in zip(posed, clean, strict=True)]
    return Cameras([replace(p, camera=None if c == v.camera else c) for p, c, v in zip(posed, cameras, views, strict=True)], displaced)


def _bias(solved: Solved, k: int) -> Float:
    """(H, W) metres of z: the camera's bias in view k by the diagnosis, through the diagnosed lens and without the parts' deviations."""
    bare, off = solved.bare[k], solved.maps.get(CadDeviation.NAME)
    whole = bare.view.depth - (bare.frame.depth + bare.residual)
    return np.asarray(whole if off is None else whole - np.nan_to_num(off[k]))
