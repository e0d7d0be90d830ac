# SPDX-License-Identifier: Apache-2.0
"""Kernels of a diagnosis compiled before the first one: by a small session whose views show what each kernel is for."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from tof_align.config import AlignConfig
from tof_core import se3
from tof_core.camera import Camera
from tof_core.capture import Capture, RobotPose, View
from tof_core.errors import ToftwinError
from tof_gap.config import GapConfig
from tof_gap.limits.foreign import ForeignLampLimits
from tof_gap.seen.evidence.residual import gather
from tof_gap.seen.foreign.lamp import foreign_lamp
from tof_gap.session import diagnose_session
from tof_scene.builtin.shapes import box
from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_scene.scene import Part, Scene
from tof_sensor.effects.flying_pixels import neighbour_amplitude

CAMERA = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)
STILL, MOVING = 5, 1
"""Views at rest, and some of a hand that moves."""
NOISE_M = 0.002
AMPLITUDE = 500.0


def warm_up() -> None:
    """Diagnose a small session; what only fringes of another lamp and mixed pixels begin is called by itself."""
    caster = Raycaster(_corner())
    views = [_view(caster, k) for k in range(STILL + MOVING)]
    with suppress(ToftwinError):
        diagnose_session(views, caster, GapConfig(), AlignConfig())
    renderings = [render(caster, CAMERA, v.robot.T_cell_camera) for v in views if v.robot is not None]
    evidence = gather(views, renderings, caster, GapConfig().evidence)
    neighbour_amplitude(evidence[0].frame, evidence[0].frame.depth)
    any_lamp = ForeignLampLimits(cells=1, chi2=0.0, share=0.0, common_share=0.0, stands_out=0.0, view_chi2=0.0, view_share=0.0, views=1)
    foreign_lamp(evidence, caster, any_lamp)


def _corner() -> Scene:
    """A box before a wall: with edges, and a corner whose surfaces light each other."""
    wall, block = box((0.1, 2.0, 2.0)), box((0.4, 0.5, 0.4))
    return Scene("cell", (Part("wall", wall[0] - [0.25, 0.0, 0.0], wall[1]), Part("block", *block)))


def _view(caster: Raycaster, k: int) -> View:
    """View k of a session that looks along -x of the cell, with noise."""
    rng, T = np.random.default_rng(k), np.eye(4)
    T[:3, :3] = [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    T[:3, 3] = [0.8 + 0.05 * (k % 3), 0.04 * (k % 4) - 0.06, 0.03 * k - 0.1]
    T = T @ se3.exp(np.array([0.0, 0.0, 0.0, *rng.uniform(-0.1, 0.1, 3)]))
    seen = render(caster, CAMERA, T)
    depth = (seen.depth + rng.normal(0.0, NOISE_M, CAMERA.shape)).astype(np.float32)
    light = (AMPLITUDE * np.nan_to_num(np.cos(seen.incidence)) / np.nan_to_num(seen.depth, nan=1.0) ** 2).astype(np.float32)
    robot = RobotPose(np.eye(4), T, twist=np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0]) if k >= STILL else None)
    return View.of_capture(Capture(k * 10**9, CAMERA, depth, np.zeros(CAMERA.shape, np.uint8), robot, light))
