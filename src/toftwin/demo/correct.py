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
    from toftwin.correcting import CorrectionConfig
    from toftwin.demo.config import DemoConfig


@dataclass(frozen=True, slots=True, eq=False)
class Corrected:
    """The correction of the first view, and what it does.

    made: by what it is compared with (`reference`, `cad`); before, after: distance of the true camera from that of the first day,
    millimetres and degrees; reference, now, then: depth (H, W) of the first day, of the day after, and after the move.
    """

    made: dict[str, Correction]
    before: tuple[float, float]
    after: tuple[float, float]
    reference: Image
    now: Image
    then: Image


def correct(folder: Path, scene_path: Path, scene: Scene, config: DemoConfig) -> Corrected:
    """Propose a hand pose as `toftwin correct` does, move the virtual hand there, and look again; leaves `first.json` and its arrays."""
    from arm_correction.frames import frames_of
    from arm_correction.reference import save_reference
    from toftwin.correcting import CorrectionConfig, corrector_of

    settings = CorrectionConfig()
    corrector = corrector_of(scene, None, settings)
    reference = corrector.capture(_first_view(folder / TODAY, scene_path, settings))
    save_reference(reference, folder / "first")
    with opened(folder / LATER, scene_path, settings) as (reader, _):
        view = _first_view(folder / LATER, scene_path, settings)
        made = corrector.propose([view], frames_of(reader.chain, reader.camera.frame_id, view.stamp_ns))
    wanted = load_truth(folder / "truth")[0]["T_cell_camera"][0]
    there, depth, then = _moved(folder, scene, config, next(iter(made.values())).T_frame_hand, settings)
    return Corrected(made, _apart(wanted, there[0]), _apart(wanted, there[1]), reference.depth, depth, then)


def _first_view(bag: Path, scene_path: Path, settings: CorrectionConfig) -> View:
    from toftwin.pipeline import ViewStream

    with opened(bag, scene_path, settings) as (reader, _):
        return next(iter(ViewStream(reader, settings)))


def _moved(
    folder: Path, scene: Scene, config: DemoConfig, T_body_hand: Float, settings: CorrectionConfig
) -> tuple[tuple[Float, Float], Image, Image]:
    """True cameras (4, 4) before and after the hand moves to its proposed pose, and what is measured at both."""
    from tof_preproc.preprocessor import accumulate_views
    from tof_virtual.live import VirtualRobot
    from toftwin.commands.simulate import bodies_of

    built = standing(scene, changed(scene, config))
    robot = VirtualRobot(bodies_of(scene), virtual(config, day=1), effects_of(config), standing=built, sizes=sizes(folder))

    def look() -> Image:
        shots = [robot.capture() for _ in range(config.later_captures)]
        return list(accumulate_views(shots, settings.preproc))[-1].depth

    before, now = robot.T_cell_camera_true, look()
    robot.goto(T_body_hand)
    return (before, robot.T_cell_camera_true), now, look()


def _apart(a: Float, b: Float) -> tuple[float, float]:
    metres, degrees = se3.distance(np.asarray(a), np.asarray(b))
    return 1e3 * metres, degrees
