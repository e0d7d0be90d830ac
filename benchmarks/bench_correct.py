# SPDX-License-Identifier: Apache-2.0
"""Back to the first picture: closed loops of the virtual robot, from near and far, in 3D and in 2D."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from arm_correction.closed_loop import Closed, close_loop, leftover
from arm_correction.config import CorrectConfig
from arm_correction.match import make_matcher, reference_surface
from arm_correction.picture import by_ecc, by_features, difference, warped
from arm_correction.reference import Reference, capture_reference
from arm_correction.register import register
from benchmarks.figure import Figure, at_least, at_most
from tof_core import se3
from tof_core.config import from_mapping
from tof_preproc.config import PreprocConfig
from tof_preproc.preprocessor import accumulate_views
from tof_scene.builtin import builtin_names, make_builtin
from tof_virtual.config import VirtualConfig
from tof_virtual.live import VirtualRobot
from tof_virtual.robot import HAND_OF_CAMERA
from toftwin.commands.simulate import bodies_of

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Float
    from tof_core.capture import View

STILL = {"base_min_mm": 0.0, "base_max_mm": 1e-3, "base_deg": 1e-3, "base_tilt_deg": 1e-3, "base_height_mm": 1e-3}
"""The base where it believes to be: what is off is put into the hand's pose, so that its size is known."""
NEAR, FAR = (50.0, 3.0), (300.0, 15.0)
STARTS_NEAR, STARTS_FAR = 60, 36


@dataclass(frozen=True, slots=True)
class Ended:
    """One loop: how far from the first pose, in how many moves, and whether it says that it got there."""

    mm: float
    deg: float
    moves: int
    done: bool
    partial: bool
    reason: str

    @property
    def wrong(self) -> bool:
        """Said to be there, and is not."""
        return self.done and not self.partial and (self.mm > 2.0 or self.deg > 0.2)


class Stand:
    """A virtual robot before a scene, with a reference taken at one of its views."""

    def __init__(self, scene: str, view: int, effects: dict[str, float] | None = None, **camera: float) -> None:
        """Take the first picture."""
        settings = {"robot": STILL, "plan": {"views": 8, "stations": 1}, "camera": camera, "seed": 5}
        self.robot = VirtualRobot(bodies_of(make_builtin(scene)), from_mapping(VirtualConfig, settings), effects or {})
        self.config = CorrectConfig()
        self.T_body_hand = self.robot.views[view][1]
        self.robot.goto(self.T_body_hand)
        self.T_true = self.robot.T_cell_camera_true
        self.first = self.look()
        self.photo = self.photograph()

    @cached_property
    def reference(self) -> Reference:
        """The first picture."""
        return capture_reference(self.first, self.config.weights)

    def look(self) -> View:
        """Ten captures at rest."""
        shots = [self.robot.capture() for _ in range(self.config.loop.captures)]
        return list(accumulate_views(shots, PreprocConfig()))[-1]

    def photograph(self) -> Bytes:
        """The colour image from here, in the light of now."""
        colour = self.robot.capture(colour=True).colour
        assert colour is not None
        return colour.image

    def displace(self, rng: np.random.Generator, mm: float, deg: float) -> None:
        """Put the hand anywhere within a ball of places and one of turns about the first pose."""
        twist = np.concatenate([_ball(rng, mm * 1e-3), _ball(rng, np.radians(deg))])
        self.robot.goto_camera(self.T_body_hand @ HAND_OF_CAMERA @ se3.exp(twist))

    def loop(self) -> Ended:
        """Close the loop from here."""
        out: Closed = close_loop(self.robot, self.look, self.reference, self.config, HAND_OF_CAMERA)
        mm, deg = leftover(self.T_true, self.robot.T_cell_camera_true)
        return Ended(mm, deg, out.moves, out.done, any(c.verdict == "partial" for c in out.corrections[-1:]), out.reason)


def _ball(rng: np.random.Generator, radius: float) -> Float:
    direction = rng.normal(size=3)
    return np.asarray(direction / np.linalg.norm(direction) * radius * rng.uniform() ** (1 / 3))


def run() -> list[Figure]:
    """Every figure of this room."""
    near, far = returns(*NEAR, STARTS_NEAR), returns(*FAR, STARTS_FAR)
    return [*near_figures(near), *far_figures(far), biased(), *pictures(), *speed()]


def returns(mm: float, deg: float, count: int, effects: dict[str, float] | None = None) -> list[Ended]:
    """Loops from `count` starts, spread over the built-in scenes and four views of each."""
    stands = 12
    out: list[Ended] = []
    for k in range(stands):
        share = count // stands + (k < count % stands)
        if share:
            stand, rng = Stand(builtin_names()[k % 3], k // 3, effects), np.random.default_rng([k, round(mm)])
            for _ in range(share):
                stand.displace(rng, mm, deg)
                out.append(stand.loop())
    return out


def _within(ended: list[Ended], mm: float, deg: float) -> float:
    return 100.0 * float(np.mean([e.done and e.mm <= mm and e.deg <= deg for e in ended]))


def _why(ended: list[Ended]) -> str:
    refused = sorted({e.reason.split(":")[0] for e in ended if not e.done})
    accepted = [e for e in ended if e.done]
    worst = max(accepted, key=lambda e: e.mm, default=None)
    said = f"; worst accepted {worst.mm:.2f} mm {worst.deg:.3f} deg" if worst else ""
    return f"{len(ended)} starts, median {np.median([e.mm for e in ended]):.2f} mm{said}; not done {sum(not e.done for e in ended)} ({', '.join(refused)})"


def near_figures(ended: list[Ended]) -> list[Figure]:
    """From 50 mm and 3 degrees."""
    accepted = [e for e in ended if e.done]
    return [
        at_least(
            "return from 50 mm / 3 deg: within 1 mm and 0.1 deg in at most 3 moves", _within(ended, 1.0, 0.1), 95, "%", remark=_why(ended)
        ),
        at_least("the same: within 2 mm and 0.2 deg", _within(ended, 2.0, 0.2), 100, "%"),
        at_most("the same: wrong ones accepted", float(sum(e.wrong for e in accepted)), 0, ""),
    ]


def far_figures(ended: list[Ended]) -> list[Figure]:
    """From 300 mm and 15 degrees."""
    return [
        at_least("return from 300 mm / 15 deg: within 1 mm and 0.1 deg", _within(ended, 1.0, 0.1), 98, "%", remark=_why(ended)),
        at_most("the same: wrong ones accepted", float(sum(e.wrong for e in ended)), 0, ""),
    ]


def biased() -> Figure:
    """A camera that nobody modelled."""
    ended = returns(*NEAR, 12, {"wiggling": 1.0, "multipath": 1.0})
    worst = max((e.mm for e in ended if e.done), default=float("nan"))
    return at_most("return to a reference with wiggling and multipath on: worst", worst, 1.5, "mm", remark=_why(ended))


def pictures() -> list[Figure]:
    """Figure 11: how far the picture is from the first one, untouched, after 2D and after 3D."""
    rows = [_pictures(name, seed) for name in builtin_names() for seed in range(2)]
    none, flat, solid, floor = (float(np.nanmean([r[i] for r in rows])) for i in range(4))
    table = (
        f"mean grey difference: none {none:.2f}, 2D {flat:.2f}, 3D {solid:.2f}, another shot from the first pose in that light {floor:.2f}"
    )
    return [
        at_most(
            "difference from the first picture, 3D over 2D, above what the light alone makes",
            (solid - floor) / (flat - floor),
            1 / 3,
            "",
            remark=table,
        )
    ]


def _pictures(scene: str, view: int) -> tuple[float, float, float, float]:
    stand = Stand(scene, view)
    stand.robot.drive(stand.robot.T_cell_body)  # the light of another day
    again = difference(stand.photo, stand.photograph())
    stand.displace(np.random.default_rng([7, view]), *NEAR)
    now = stand.photograph()
    H = by_features(stand.photo, now)
    H = by_ecc(stand.photo, now, H) if H is not None else by_ecc(stand.photo, now)
    flat = difference(stand.photo, *warped(now, H)) if H is not None else difference(stand.photo, now)
    stand.loop()
    return difference(stand.photo, now), flat, difference(stand.photo, stand.photograph()), again


def speed() -> list[Figure]:
    """One correction at 400 x 300."""
    stand = Stand("body_section", 0, width=400, height=300)
    surface, seconds = reference_surface(stand.reference, stand.config), {}
    for name, size in (("near", NEAR), ("far", FAR)):
        rng, taken = np.random.default_rng(3), []
        config = stand.config if name == "near" else replace(stand.config, trust=replace(stand.config.trust, min_support=1.0))
        for _ in range(4):
            stand.displace(rng, *size)
            view = stand.look()
            started = time.process_time()
            register(make_matcher(surface, view, config), np.eye(4))
            taken.append(time.process_time() - started)
        seconds[name] = float(np.median(taken))
    return [
        at_most("one correction, 400x300, near, processor time", 1e3 * seconds["near"], 100, "ms"),
        at_most("one correction, 400x300, from far (the whole search), processor time", 1e3 * seconds["far"], 1000, "ms"),
    ]
