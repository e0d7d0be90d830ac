# SPDX-License-Identifier: Apache-2.0
"""The pairs of camera and simulator: what differs is drawn, and an answer is right only if it names this and nothing else."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from benchmarks.against.pairs import MISSING, NO_SIZE, RIGHT, SIMULATORS, SUPERFLUOUS, TWICE, draw_pairs
from benchmarks.against.record import rendered
from benchmarks.against.score import answer, scored
from benchmarks.emerging.healthy import draw

if TYPE_CHECKING:
    from pathlib import Path

PAIRS = draw_pairs(80, 1)


def test_every_four_pairs_have_the_four_kinds_and_more_pairs_leave_the_first_as_they_are() -> None:
    assert [p.kind for p in PAIRS[:4]] == list(SIMULATORS)
    assert draw_pairs(9, 1) == PAIRS[:9]
    assert draw_pairs(9, 2) != PAIRS[:9]


def test_camera_and_simulator_differ_in_the_changed_cause_alone() -> None:
    for p in PAIRS:
        others = [{c: s for c, s in side.items() if c != p.changed} for side in (p.camera, p.simulator)]
        assert others[0] == others[1]
        sides = p.camera.get(p.changed, 0.0), p.simulator.get(p.changed, 0.0)
        strength = max(p.camera.get(p.changed, 0.0), 0.5 * p.simulator.get(p.changed, 0.0))
        expected = {
            RIGHT: (0.0, 0.0),
            MISSING: (sides[0], 0.0),
            SUPERFLUOUS: (0.0, sides[1]),
            TWICE: (strength, 2.0 * strength),
        }[p.kind]
        assert sides == pytest.approx(expected)
        assert bool(p.effect) == (p.kind != RIGHT)


def test_no_simulator_has_twice_of_what_has_no_size() -> None:
    assert not {p.changed for p in PAIRS if p.kind == TWICE} & NO_SIZE


def test_both_sessions_move_if_one_of_them_must() -> None:
    latency = replace(PAIRS[0], camera={}, simulator={"driver_latency": 1.0})
    assert latency.case().moving
    assert not replace(latency, simulator={"hazy_lens": 1.0}).case().moving


def test_the_simulator_has_no_error_that_only_the_real_cell_has() -> None:
    healthy = draw(np.random.default_rng(3), 3)
    simulated = rendered(healthy)
    assert healthy.mount.hand_eye_mm > 0.0 == simulated.mount.hand_eye_mm
    assert healthy.optics.centre_x_px != 0.0 == simulated.optics.centre_x_px
    assert (simulated.world.albedo_off, simulated.world.foreign_m) == (0.0, 0.0)
    assert (simulated.clock, simulated.pixel, simulated.firmware) == (healthy.clock, healthy.pixel, healthy.firmware)


def pair(kind: str, changed: str, camera: dict[str, float], simulator: dict[str, float], reached: Any) -> dict[str, Any]:
    effect = {"slow_driver": "wiggling", "bumped_mount": "hand_eye", "": ""}[changed]
    values = {"name": "pair0000", "kind": kind, "scene": "housing", "changed": changed, "effect": effect}
    return values | {"camera": camera, "simulator": simulator, "reached": reached}


LACKING = pair(MISSING, "slow_driver", {"slow_driver": 1.0}, {}, [{"slow_driver": 0.003}, {}])


@pytest.mark.parametrize(
    ("found", "hit", "seen"),
    [
        ({"wiggling": "lacks"}, True, True),
        ({"wiggling": "understates"}, False, True),
        ({"wiggling": "lacks", "noise": "exaggerates"}, False, True),
        ({"noise": "lacks"}, False, False),
        ({}, False, False),
        (None, False, False),
    ],
)
def test_a_pair_is_right_if_the_effect_is_named_alone_and_in_its_manner(found: dict[str, str] | None, *, hit: bool, seen: bool) -> None:
    row = scored(LACKING, found)
    assert (row.hit, row.seen, row.counts) == (hit, seen, True)


@pytest.mark.parametrize(("alike", "hit"), [({"depth_scale"}, True), (set[str](), False)])
def test_a_tie_is_right_if_no_observer_can_distinguish_what_it_holds(alike: set[str], *, hit: bool) -> None:
    row = scored(LACKING, {"depth_scale|wiggling": "lacks"}, alike.__contains__)
    assert (row.hit, row.seen) == (hit, True)
    assert not scored(LACKING, {"depth_scale|range_offset": "lacks"}, alike.__contains__).seen
    assert not scored(LACKING, {"depth_scale|wiggling": "lacks", "noise": "lacks"}, alike.__contains__).hit


def test_a_right_simulator_must_differ_in_nothing_and_a_refusal_is_no_answer() -> None:
    same = pair(RIGHT, "", {"slow_driver": 1.0}, {"slow_driver": 1.0}, [{"slow_driver": 0.003}] * 2)
    assert scored(same, {}).hit
    assert not scored(same, {"wiggling": "exaggerates"}).hit
    assert not scored(same, None).hit


@pytest.mark.parametrize(("reached_m", "counts"), [(0.0060, True), (0.0031, True), (0.0029, False)])
def test_a_cause_that_physics_keeps_below_half_its_strength_does_not_count(reached_m: float, *, counts: bool) -> None:
    sides = [{"slow_driver": 0.003}, {"slow_driver": reached_m}]
    assert scored(pair(TWICE, "slow_driver", {"slow_driver": 1.0}, {"slow_driver": 2.0}, sides), {}).counts is counts


def test_a_cause_of_stated_size_always_counts() -> None:
    nan = float("nan")
    sides = [{"bumped_mount": nan}, {"bumped_mount": nan}]
    assert scored(pair(TWICE, "bumped_mount", {"bumped_mount": 1.0}, {"bumped_mount": 2.0}, sides), {}).counts


def test_an_unknown_comparison_of_a_right_simulator_is_no_hit(tmp_path: Path) -> None:
    report = tmp_path / "against.json"
    for verdict, hit in ((["unknown"], False), (["none"], True)):
        report.write_text(json.dumps({"verdict": verdict, "differences": []}))
        assert scored(pair(RIGHT, "", {}, {}, [{}, {}]), answer(report)).hit is hit
    assert answer(tmp_path / "refused.json") is None
