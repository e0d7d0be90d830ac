# SPDX-License-Identifier: Apache-2.0
"""Which sessions of the emerging camera are drawn: healthy ones, causes alone and together, causes outside the vocabulary, withheld ones."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.emerging.causes import CAUSES, OUTSIDE

if TYPE_CHECKING:
    from tof_core.arrays import Ints

SCENES = ("body_section", "housing", "cabinet", "press_tool", "gearbox")
LEAST, MOST = 0.5, 2.0
"""Strengths: 1 is 3 mm RMS over affected pixels."""
PATTERN = (
    *("null", "single", "pair", "single", "null", "single", "outside", "single"),
    *("pair", "single", "triple", "left-out", "null", "single", "pair", "single"),
)
"""Kinds of sixteen sessions."""
NAMED = tuple(name for name, cause in CAUSES.items() if not cause.effect.startswith(OUTSIDE))
FOREIGN = tuple(name for name, cause in CAUSES.items() if cause.effect.startswith(OUTSIDE))
ALONE = frozenset({"radial_output", "coarse_output"})
"""Causes that hide others or are hidden: never one of several."""
LEFT_OUT = tuple(n for n in NAMED if CAUSES[n].metric == "bias" and CAUSES[n].effect not in ("range_offset", "depth_scale"))
"""Causes that are withheld: those that leave a bias which no pose makes by itself."""
ROBOTS: dict[str, dict[str, Any]] = {
    "walker": {"plan.stations": 2},
    "cart": {
        "robot.base_min_mm": 5.0,
        "robot.base_max_mm": 15.0,
        "robot.base_deg": 0.5,
        "robot.base_tilt_deg": 0.1,
        "robot.base_height_mm": 1.0,
        "robot.arm_mm": 0.3,
        "robot.arm_deg": 0.03,
        "robot.repeat_mm": 0.1,
        "robot.repeat_deg": 0.01,
        "plan.stations": 3,
        "plan.azimuth_deg": 60.0,
    },
    "rail": {
        "robot.base_min_mm": 0.0,
        "robot.base_max_mm": 1.0,
        "robot.base_deg": 0.05,
        "robot.base_tilt_deg": 0.02,
        "robot.base_height_mm": 0.3,
        "robot.arm_mm": 0.5,
        "robot.arm_deg": 0.05,
        "robot.repeat_mm": 0.1,
        "robot.repeat_deg": 0.01,
        "plan.stations": 1,
        "plan.range_max_m": 1.6,
    },
    "heavy": {
        "robot.base_min_mm": 25.0,
        "robot.base_max_mm": 60.0,
        "robot.base_deg": 2.5,
        "robot.arm_mm": 1.5,
        "robot.arm_deg": 0.12,
        "robot.repeat_mm": 0.4,
        "robot.repeat_deg": 0.04,
        "plan.stations": 2,
        "plan.range_min_m": 0.6,
        "plan.range_max_m": 1.5,
        "plan.elevation_max_deg": 60.0,
    },
}
"""Errors of base and arm, and how each robot stands and looks; the rest as of `VirtualConfig`."""
VIEWS = 20


@dataclass(frozen=True, slots=True)
class ForeignCase:
    """One session: its kind, scene and robot, the strength of each cause, the effect withheld from the diagnosis, its seed."""

    name: str
    kind: str
    scene: str
    robot: str
    causes: dict[str, float]
    left_out: str
    seed: int
    settings: dict[str, Any] = field(default_factory=dict)

    @property
    def effects(self) -> tuple[str, ...]:
        """What the vocabulary calls the causes; nothing for those outside of it."""
        names = {CAUSES[c].effect for c in self.causes}
        return tuple(sorted(n for n in names if not n.startswith(OUTSIDE)))

    @property
    def moving(self) -> bool:
        """Whether the hand moves during captures."""
        return any(CAUSES[c].moving for c in self.causes)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for the sealed answer."""
        return asdict(self) | {"effects": list(self.effects)}


def draw_foreign(count: int, seed: int, views: int = VIEWS) -> list[ForeignCase]:
    """`count` cases of so many views, each by its own number: more of them leave the first as they are."""
    turn = np.random.default_rng([seed, 0]).permutation(len(NAMED))
    return [_case(number, seed, turn, views) for number in range(count)]


def _case(number: int, seed: int, turn: Ints, views: int) -> ForeignCase:
    rng = np.random.default_rng([seed, 1 + number])
    kind = PATTERN[number % len(PATTERN)]
    causes: tuple[str, ...] = ()
    if kind == "single":
        before = PATTERN[: number % len(PATTERN)].count("single") + number // len(PATTERN) * PATTERN.count("single")
        causes = (NAMED[turn[before % len(NAMED)]],)
    elif kind in ("pair", "triple"):
        causes = _together({"pair": 2, "triple": 3}[kind], rng)
    elif kind == "outside":
        causes = (FOREIGN[int(rng.integers(len(FOREIGN)))],)
    elif kind == "left-out":
        causes = (LEFT_OUT[int(rng.integers(len(LEFT_OUT)))],)
    strengths = {c: float(np.exp(rng.uniform(np.log(LEAST), np.log(MOST)))) for c in causes}
    return ForeignCase(
        name=f"case{number:04d}",
        kind=kind,
        scene=SCENES[number % len(SCENES)],
        robot=list(ROBOTS)[number // len(SCENES) % len(ROBOTS)],
        causes=strengths,
        left_out=CAUSES[causes[0]].effect if kind == "left-out" else "",
        seed=int(rng.integers(1, 2**31)),
        settings={"plan.views": views, "plan.pause_s": float(rng.choice([5.0, 20.0, 40.0]))},
    )


def _together(n: int, rng: np.random.Generator) -> tuple[str, ...]:
    """Causes of different effects."""
    while True:
        chosen = [NAMED[k] for k in rng.choice(len(NAMED), n, replace=False)]
        if len({CAUSES[c].effect for c in chosen}) == n and not ALONE & set(chosen):
            return tuple(chosen)
