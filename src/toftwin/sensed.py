# SPDX-License-Identifier: Apache-2.0
"""A fitted sensor model in the virtual camera: its effects are added to each frame."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_sensor.frame import Context
from tof_sensor.model import simulate
from tof_virtual.record import AMPLITUDE_STEP_E

if TYPE_CHECKING:
    from tof_scene.scene import Scene
    from tof_sensor.model import SensorModel
    from tof_virtual.effect import Frame, Moment
    from tof_virtual.record import Sensor


def modelled(model: SensorModel, scene: Scene) -> Sensor:
    """The function that `record` calls for each frame: adds bias, noise and losses of the model at the true pose."""
    caster = Raycaster(scene)

    def sensor(moment: Moment, taken: Frame) -> Frame:
        view = render(caster, moment.camera, moment.sight.T_cell_camera)
        context = Context(temperature=moment.temperature, time_s=moment.time_s, caster=caster)
        amplitude = (taken.amplitude / AMPLITUDE_STEP_E).reshape(moment.camera.shape)
        rng = np.random.default_rng([moment.config.seed, 55, moment.index])
        made = simulate(view, model, rng, context=context, amplitude=amplitude)
        change = np.where(np.isfinite(view.depth), made.depth - view.depth, 0.0)
        return replace(taken, depth=taken.depth + change.ravel())

    return sensor
