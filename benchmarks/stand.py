# SPDX-License-Identifier: Apache-2.0
"""A virtual robot before a scene, with a first picture to come back to; what became of each way back."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from arm_correction.config import CorrectConfig, LimitConfig
from arm_correction.corrector import Corrector
from arm_correction.first import First
from benchmarks.closed_loop import close_loop, leftover
from benchmarks.kept import kept
from tof_core import se3
from tof_core.config import from_mapping
from tof_preproc.config import PreprocConfig
from tof_preproc.preprocessor import accumulate_views
from tof_scene.builtin import builtin_names, make_builtin
from tof_scene.raycast import Raycaster
from tof_virtual.config import VirtualConfig
from tof_virtual.live import VirtualRobot
from tof_virtual.robot import HAND_OF_CAMERA
from toftwin.commands.simulate import bodies_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tof_core.arrays import Bytes, Float
    from tof_core.capture import View
    from tof_scene.scene import Scene

STILL = {"base_min_mm": 0.0, "base_max_mm": 1e-3, "base_deg": 1e-3, "base_tilt_deg": 1e-3, "base_height_mm": 1e-3}
"""The base where it believes to be, until it is shoved: so the size of what is off is known, to us alone."""
VIEWS, CAPTURES = 8, 5


@dataclass(frozen=True, slots=True)
class Ended:
    """One loop: how far from the first pose, in how many moves, whether it says that it got there, and with directions unknown."""

    start_mm: float
    start_deg: float
    mm: float
    deg: float
    moves: int
    done: bool
    partial: bool
    by_cad: bool
    reason: str

    @property
    def wrong(self) -> bool:
        """Reported as there, and is not."""
        return self.done and not self.partial and (self.mm > 2.0 or self.deg > 0.2)

    def within(self, mm: float, deg: float) -> bool:
        """Reported as there, and is."""
        return self.done and self.mm <= mm and self.deg <= deg


class ShovedRobot(VirtualRobot):
    """A virtual robot whose base can be displaced without odometry."""

    def shove(self, T_cell: Float) -> None:
        """Displace the base by a motion (4, 4) of the cell that the robot does not measure."""
        self._robot.B = np.asarray(T_cell @ self._robot.B)
        self._moved()


class Stand:
    """A first picture taken at one of the views of a robot's plan."""

    def __init__(
        self, scene: Scene, view: int, *, seed: int, effects: Mapping[str, float] | None = None, cad: bool = True, **camera: float
    ) -> None:
        """Take the first picture; with `cad` a start from far may use the CAD around it. The virtual arm reaches anywhere."""
        settings = {"robot": STILL, "plan": {"views": VIEWS, "stations": 1}, "camera": camera, "seed": seed}
        self.robot = ShovedRobot(bodies_of(scene), from_mapping(VirtualConfig, settings), effects or {})
        self.scene, self._cad = scene, cad
        self.config = replace(CorrectConfig(), limits=replace(LimitConfig(), reach_m=3.0))
        self.T_body_hand = self.robot.views[view][1]
        self.robot.goto(self.T_body_hand)
        self.T_true = self.robot.T_cell_camera_true
        self.view = self.look()

    @cached_property
    def first(self) -> First:
        """The first picture, made ready."""
        caster = Raycaster(self.scene) if self._cad else None
        return First.of(Corrector(self.config, caster=caster).capture(self.view), self.config, caster)

    def look(self, captures: int = CAPTURES) -> View:
        """A few captures at rest: half of what a loop takes by default, to be cheap."""
        shots = [self.robot.capture() for _ in range(captures)]
        return list(accumulate_views(shots, PreprocConfig()))[-1]

    def photograph(self) -> Bytes:
        """The colour image from here, in the light of now."""
        colour = self.robot.capture(colour=True).colour
        assert colour is not None
        return colour.image

    def displace(self, rng: np.random.Generator, mm: float, deg: float) -> None:
        """Shove the base so that the camera is anywhere within a ball of places and one of turns about the first pose; the robot believes to be there."""
        twist = np.concatenate([_ball(rng, mm * 1e-3), _ball(rng, np.radians(deg))])
        self.robot.goto(self.T_body_hand)
        self.robot.shove(self.T_true @ se3.exp(twist) @ se3.inverse(self.robot.T_cell_camera_true))

    def loop(self) -> Ended:
        """Close the loop from here."""
        start = leftover(self.T_true, self.robot.T_cell_camera_true)
        out = close_loop(self.robot, self.look, self.first, self.config, HAND_OF_CAMERA)
        left = leftover(self.T_true, self.robot.T_cell_camera_true)
        partial = any(c.verdict == "partial" for c in out.corrections[-1:])
        return Ended(*start, *left, out.moves, out.done, partial, any(c.by == "cad" for c in out.corrections), out.reason)


def _ball(rng: np.random.Generator, radius: float) -> Float:
    direction = rng.normal(size=3)
    return np.asarray(direction / np.linalg.norm(direction) * radius * rng.uniform() ** (1 / 3))


def returns(
    mm: float, deg: float, count: int, *, seed: int, stands: int, effects: Mapping[str, float] | None = None, cad: bool = True
) -> list[Ended]:
    """Loops from `count` starts, spread over `stands` first pictures of the built-in scenes in turn."""
    out: list[Ended] = []
    for k in range(stands):
        share = count // stands + (k < count % stands)
        key = f"return-{seed}-{mm:g}-{'-'.join(effects or ())}-{cad}-{k}-{share}"
        out += [Ended(**row) for row in kept(key, lambda k=k, share=share: _loops(k, mm, deg, share, seed, effects, cad))]  # type: ignore[misc]
    return out


def _loops(k: int, mm: float, deg: float, count: int, seed: int, effects: Mapping[str, float] | None, cad: bool) -> list[dict[str, Any]]:  # noqa: FBT001
    scene = make_builtin(builtin_names()[k % 3])
    stand = Stand(scene, k // 3 % VIEWS, seed=seed, effects=effects, cad=cad)
    rng, out = np.random.default_rng([seed, k, round(mm)]), []
    for _ in range(count):
        stand.displace(rng, mm, deg)
        out.append(asdict(stand.loop()))
    return out
