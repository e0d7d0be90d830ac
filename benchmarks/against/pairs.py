# SPDX-License-Identifier: Apache-2.0
"""Which pairs are drawn: the causes of the camera, and what its simulator makes of one of them."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from benchmarks.emerging.causes import CAUSES
from benchmarks.gap_check.foreign.cases import ALONE, LEAST, MOST, NAMED, ROBOTS, SCENES, ForeignCase

RIGHT, MISSING, TWICE, SUPERFLUOUS = "right", "missing", "twice", "superfluous"
SIMULATORS = (RIGHT, MISSING, TWICE, SUPERFLUOUS)
"""What a simulator makes of the changed cause; `right`: it has all causes of the camera at their sizes."""
BESIDE = 0.5
"""Share of pairs whose camera and simulator have a second cause in common."""
NO_SIZE = frozenset({"radial_output"})
"""Causes that are there or not: no simulator has them at twice the size."""
VIEWS = 12


@dataclass(frozen=True, slots=True)
class SimulatorPair:
    """A camera's session and its simulator's.

    camera, simulator: strength of each cause on either side; changed: the cause in which they differ, empty for a right simulator.
    """

    name: str
    kind: str
    scene: str
    robot: str
    camera: dict[str, float]
    simulator: dict[str, float]
    changed: str
    seed: int
    settings: dict[str, Any]

    @property
    def effect(self) -> str:
        """The vocabulary's name of the difference; empty for a right simulator."""
        return CAUSES[self.changed].effect if self.changed else ""

    def case(self) -> ForeignCase:
        """The case by which both sessions are planned: with the causes of both, so that the hand moves in both or in none."""
        causes = self.simulator | self.camera
        return ForeignCase(self.name, self.kind, self.scene, self.robot, causes, "", self.seed, self.settings)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for the sealed answer."""
        return asdict(self) | {"effect": self.effect}


def draw_pairs(count: int, seed: int, views: int = VIEWS) -> list[SimulatorPair]:
    """`count` pairs, each by its own number: more of them leave the first as they are. Every four have the four kinds of simulator."""
    turns = {kind: np.random.default_rng([seed, 0, k]).permutation(len(NAMED)) for k, kind in enumerate(SIMULATORS)}
    return [_pair(n, seed, [NAMED[i] for i in turns[SIMULATORS[n % len(SIMULATORS)]]], views) for n in range(count)]


def _pair(number: int, seed: int, turn: list[str], views: int) -> SimulatorPair:
    rng = np.random.default_rng([seed, 1 + number])
    kind, round_ = SIMULATORS[number % len(SIMULATORS)], number // len(SIMULATORS)
    turn = [c for c in turn if kind != TWICE or c not in NO_SIZE]
    first = turn[round_ % len(turn)]
    causes = {first: _strength(rng)}
    beside = [c for c in NAMED if c not in ALONE and CAUSES[c].effect != CAUSES[first].effect]
    if rng.random() < BESIDE and first not in ALONE:
        causes[beside[int(rng.integers(len(beside)))]] = _strength(rng)
    less = {c: s for c, s in causes.items() if c != first}
    twice = causes | {first: 2.0 * causes[first]}
    camera, simulator = {RIGHT: (causes, causes), MISSING: (causes, less), TWICE: (causes, twice), SUPERFLUOUS: (less, causes)}[kind]
    return SimulatorPair(
        name=f"pair{number:04d}",
        kind=kind,
        scene=SCENES[int(rng.integers(len(SCENES)))],
        robot=list(ROBOTS)[int(rng.integers(len(ROBOTS)))],
        camera=camera,
        simulator=simulator,
        changed="" if kind == RIGHT else first,
        seed=int(rng.integers(1, 2**31)),
        settings={"plan.views": views, "plan.pause_s": float(rng.choice([5.0, 20.0, 40.0]))},
    )


def _strength(rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(np.log(LEAST), np.log(MOST))))
