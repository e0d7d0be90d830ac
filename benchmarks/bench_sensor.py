# SPDX-License-Identifier: Apache-2.0
"""The simulated camera: processor time of a frame at 224x171."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.figure import Figure, at_least
from tof_core.camera import Camera
from tof_core.capture import Capture
from tof_scene.builtin import make_builtin
from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_sensor.model import SensorModel
from tof_sensor.registry import EFFECTS
from tof_sensor.simulator import Simulator, SimulatorConfig
from tof_virtual.plan import look_at

if TYPE_CHECKING:
    from collections.abc import Iterator

CAMERA = Camera(224, 171, 210.0, 210.0, 111.5, 85.0)
FRAMES = 30
HZ = 30.0


def run() -> list[Figure]:
    """Frames a second of one core, with nine effects."""
    caster = Raycaster(make_builtin("body_section"))
    view = render(caster, CAMERA, look_at(np.array([1.0, 0.1, 1.1]), np.array([0.0, 0.0, 0.8])))
    ideal = Capture(0, CAMERA, view.depth, np.zeros(CAMERA.shape, np.uint8), amplitude=view.albedo)
    camera = Simulator(SimulatorConfig(), model())
    seconds = list(_timed(camera, ideal))
    what = "simulated camera at 224x171, nine effects, from ideal depth and albedo: frames a second of one core"
    return [
        at_least(what, 1.0 / float(np.median(seconds)), HZ, "1/s", remark=f"{', '.join(camera.model.names)}; median of {FRAMES} frames")
    ]


def model() -> SensorModel:
    """What a diagnosis may well find at once."""
    rng = np.random.default_rng(0)
    values: dict[str, dict[str, Any]] = {
        "wiggling": {"sine_m": 0.003},
        "amplitude_bias": {"per_ln_m": 0.003, "reference": 100.0},
        "flying_pixels": {"share": 1.0},
        "lens_scatter": {"halo": 0.02, "veil": 0.02},
        "dropout": {"threshold": 20.0},
        "photon_law": {"shot_m": 0.003, "reference": 100.0},
        "fixed_pattern": {"values": tuple(1e-3 * rng.standard_normal(CAMERA.width + CAMERA.height + 15))},
        "temperature_drift": {"drift_m": 0.005},
        "intrinsics": {"fx_rel": 0.001},
    }
    return SensorModel(tuple(EFFECTS[name](**given) for name, given in values.items()), gain=300.0)


def _timed(camera: Simulator, ideal: Capture) -> Iterator[float]:
    """Processor seconds of each frame after the first."""
    for k in range(FRAMES + 1):
        start = time.process_time()
        camera.measured(replace(ideal, stamp_ns=k))
        if k:
            yield time.process_time() - start
