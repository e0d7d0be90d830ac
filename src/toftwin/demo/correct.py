# SPDX-License-Identifier: Apache-2.0
"""Second question of the demonstration: where is the hand really? The robot returns a day later, and its hand is corrected."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_virtual.truth import load_truth
from toftwin.demo.sessions import LATER, TODAY, changed, effects_of, sizes, standing, virtual
from toftwin.inputs import opened

if TYPE_CHECKING:
    from pathlib import Path

    from arm_correction.correction import Correction
    from tof_core.arrays import Float, Image
    from tof_core.capture import View
    from tof_scene.scene import Scene
    from tof_virtual.live import VirtualRobot
    from toftwin.correcting import CorrectionConfig
    from toftwin.demo.config import DemoConfig

MOVES = 3
"""Largest number of moves: the first brings a distant hand near, the next ones see more of the reference."""
NEAR_MM = 0.5
"""Moves below this are within the arm's repeatability."""


@dataclass(frozen=True, slots=True, eq=False)
class Corrected:
    """The corrective moves of the hand at the first view, and the distance that each leaves.

    made: the first proposal, by what it is compared with (`reference`, `cad`); apart: distance of the true camera from that of the
    first day, millimetres and degrees, before and after each move; reference, now, then: depth (H, W) of the first day, of the
    second day, and after the last move.
    """

    made: dict[str, Correction]
    apart: tuple[tuple[float, float], ...]
    reference: Image
    now: Image
    then: Image

    @property
    def before(self) -> tuple[float, float]:
        """Distance before the first move."""
        return self.apart[0]

    @property
    def after(self) -> tuple[float, float]:
        """Distance after the last move."""
        return self.apart[-1]


def correct(folder: Path, scene_path: Path, scene: Scene, config: DemoConfig) -> Corrected:
    """Propose a hand pose as `toftwin correct` does, move the virtual hand there, look again and repeat; leaves `first.json` and its arrays."""
    from arm_correction.frames import frames_of
    from arm_correction.reference import save_reference
    from toftwin.correcting import CorrectionConfig, corrector_of

    settings = CorrectionConfig()
    corrector = corrector_of(scene, None, settings)
    reference = corrector.capture(_first_view(folder / TODAY, scene_path, settings))
    save_reference(reference, folder / "first")
    with opened(folder / LATER, scene_path, settings) as (reader, _):
        view = _first_view(folder / LATER, scene_path, settings)
        frames = frames_of(reader.chain, reader.camera.frame_id, view.stamp_ns)
    made = corrector.propose([view], frames)
    robot = _robot(folder, scene, config)
    wanted = load_truth(folder / "truth")[0]["T_cell_camera"][0]
    apart, now, proposal = [_apart(wanted, robot.T_cell_camera_true)], _look(robot, config, settings), made["reference"]
    then = now
    while proposal.accepted and len(apart) <= MOVES:
        robot.goto(proposal.T_frame_hand)
        apart.append(_apart(wanted, robot.T_cell_camera_true))
        then = _look(robot, config, settings)
        proposal = corrector.propose([then], frames)["reference"]
        if proposal.step[0] < NEAR_MM:
            break
    return Corrected(made, tuple(apart), reference.depth, now.depth, then.depth)


def _first_view(bag: Path, scene_path: Path, settings: CorrectionConfig) -> View:
    from toftwin.pipeline import ViewStream

    with opened(bag, scene_path, settings) as (reader, _):
        return next(iter(ViewStream(reader, settings)))


def _robot(folder: Path, scene: Scene, config: DemoConfig) -> VirtualRobot:
    """The virtual robot on the second day, at the first view of the recorded bag and with the same errors."""
    from tof_virtual.live import VirtualRobot
    from toftwin.commands.simulate import bodies_of

    built = standing(scene, changed(scene, config))
    return VirtualRobot(bodies_of(scene), virtual(config, day=1), effects_of(config), standing=built, sizes=sizes(folder))


def _look(robot: VirtualRobot, config: DemoConfig, settings: CorrectionConfig) -> View:
    """One dwell of the virtual robot."""
    from tof_preproc.preprocessor import accumulate_views

    return list(accumulate_views([robot.capture() for _ in range(config.later_captures)], settings.preproc))[-1]


def _apart(a: Float, b: Float) -> tuple[float, float]:
    metres, degrees = se3.distance(np.asarray(a), np.asarray(b))
    return 1e3 * metres, degrees
