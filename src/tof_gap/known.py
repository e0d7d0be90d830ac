# SPDX-License-Identifier: Apache-2.0
"""What is known of the sensor already, taken off before the rest is diagnosed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_align.session import solve_session
from tof_scene.render import render
from tof_sensor.frame import Context, ideal_frame

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.config import AlignConfig
    from tof_align.session import PosedView
    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_scene.raycast import Raycaster
    from tof_sensor.model import SensorModel


def known_removed(views: Sequence[View], caster: Raycaster, model: SensorModel, align: AlignConfig) -> list[View]:
    """The views less the model's bias, evaluated at poses that are solved with it."""
    start = min(v.stamp_ns for v in views)

    def bias(view: View, rendering: object) -> Float:
        twist = np.zeros(6) if view.robot is None or view.robot.twist is None else view.robot.twist
        context = Context(view.temperature, (view.stamp_ns - start) * 1e-9, twist, caster)
        amplitude = None if view.amplitude is None else view.amplitude.astype(np.float64)
        return model.bias(ideal_frame(rendering, context, amplitude))  # type: ignore[arg-type]

    def column(posed: PosedView) -> Float:
        return bias(posed.view, posed.rendering).reshape(-1, 1)

    # The known bias is a column whose coefficient is held at 1.
    solved = solve_session(views, caster, align, terms=column, theta_std=np.array([0.3]))
    out = []
    for view, posed in zip(views, solved.posed, strict=True):
        known = bias(view, render(caster, view.camera, posed.T_cell_camera))
        out.append(replace(view, depth=(view.depth - np.nan_to_num(known)).astype(np.float32)))
    return out
