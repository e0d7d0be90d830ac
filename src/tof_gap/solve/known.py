# SPDX-License-Identifier: Apache-2.0
"""What is known of the sensor already, taken off before the rest is diagnosed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_align.chain import chain_of
from tof_align.pixels import sample
from tof_align.session import near, solve_session
from tof_core.cores import in_threads
from tof_gap.seen.residual import ideal_frames
from tof_scene.render import render

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.config import AlignConfig
    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_scene.raycast import Raycaster
    from tof_sensor.frame import Frame
    from tof_sensor.model import SensorModel

ROUNDS = 2
"""Solutions of the poses: of their error each leaves what the bias changes per metre, some hundredths."""


def known_removed(views: Sequence[View], caster: Raycaster, model: SensorModel, align: AlignConfig) -> list[View]:
    """The views less the model's bias, at the poses that they have without it.

    The bias is taken off, not fitted: poses that could absorb a share of it would.
    """
    samples = [sample(v, align.weights) for v in views]
    chain = near(samples, chain_of(samples, align.priors), caster, align)
    less = _less(views, [chain.pose(v) for v in range(len(views))], caster, model)
    for _ in range(ROUNDS):
        less = _less(views, [p.T_cell_camera for p in solve_session(less, caster, align).posed], caster, model)
    return less


def _less(views: Sequence[View], cameras: Sequence[Float], caster: Raycaster, model: SensorModel) -> list[View]:
    """The views less the model's bias as cameras there have it."""
    renderings = in_threads(lambda v, T: render(caster, v.camera, T), views, cameras)

    def one(view: View, frame: Frame) -> View:
        return replace(view, depth=(view.depth - np.nan_to_num(model.bias(frame))).astype(np.float32))

    return in_threads(one, views, ideal_frames(views, renderings, caster))
