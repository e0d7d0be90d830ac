# SPDX-License-Identifier: Apache-2.0
"""Of effects that one session cannot tell apart, the capture that would: found by trying, so each tie here is one whose remedy is plain."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_align.made import CAMERA, CONFIG, look, panel
from tof_align.chain import Chain
from tof_core.capture import Capture, View
from tof_gap.advice import _by_reference, _ForTie, advise, visible_share
from tof_gap.config import GapConfig
from tof_gap.limits.evidence import EvidenceLimits
from tof_gap.seen.evidence.residual import gather
from tof_gap.solve.hypotheses.candidate import Candidate
from tof_scene.render import render
from tof_sensor.action import ASIDE, BRIGHTER, FARTHER, LATER, NEARER
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.temperature_drift import TemperatureDrift
from tof_sensor.effects.wiggling import Wiggling

if TYPE_CHECKING:
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_sensor.action import Action

VIEWS = 5


class Twin(RangeOffset):
    """An effect of the same map under another name."""

    NAME = "twin"


CANDIDATES = (
    Candidate("range_offset", RangeOffset()),
    Candidate("temperature_drift", TemperatureDrift(reference_c=20.0)),
    Candidate("wiggling", Wiggling(modulation_mhz=20.0)),
    Candidate("amplitude_bias", AmplitudeBias()),
    Candidate("twin", Twin()),
)
OFFSET, DRIFT, WIGGLE, AMPLITUDE, TWIN = range(len(CANDIDATES))
ACTIONS = (BRIGHTER, NEARER, FARTHER, ASIDE, LATER)


@lru_cache(maxsize=1)
def seen() -> tuple[ViewEvidence, ...]:
    """A panel from its front at one distance and one temperature, 5 K above the drift's reference."""
    poses = [look(np.array([0.9, y, 0.8]), np.array([0.0, y, 0.8])) for y in (0.0, 0.1, 0.2, 0.3, 0.4)]
    pictures = [render(panel(), CAMERA, T, footprints=False) for T in poses]
    rng = np.random.default_rng(2)
    captures = [
        Capture(k, CAMERA, (p.depth + rng.normal(0, 1e-3, p.depth.shape)).astype(np.float32), np.isnan(p.depth).astype(np.uint8))
        for k, p in enumerate(pictures)
    ]
    return gather([replace(View.of_capture(c), temperature=25.0) for c in captures], pictures, panel(), EvidenceLimits())


def diagnosis(*ties: tuple[int, int]) -> Any:
    """What `advise` reads of a diagnosis: the first of each pair is named, the second could stand in for it."""
    one, many = np.eye(4), np.broadcast_to(np.eye(4), (VIEWS, 4, 4)).copy()
    robot = np.array([v.rendering.T_cell_camera for v in seen()])
    chain = Chain(np.zeros(VIEWS, int), (0,), one[None].copy(), robot, one[None].copy(), many, one, CONFIG.priors)
    tied = tuple((CANDIDATES[a].effect, CANDIDATES[b].effect) for a, b in ties)
    return SimpleNamespace(
        evidence=seen(),
        chain=chain,
        verdict=("unknown",),
        solved=SimpleNamespace(evidence=seen(), chain=chain, tied=tied),
        config=GapConfig(),
    )


@pytest.mark.parametrize(
    ("member", "other", "action"),
    [
        (DRIFT, OFFSET, LATER),  # at one temperature a drift is a constant
        (WIGGLE, OFFSET, FARTHER),  # at one distance a wiggle of a long period is one too
        (AMPLITUDE, WIGGLE, BRIGHTER),  # on one surface amplitude goes with range
    ],
)
def test_a_tie_is_reported_with_the_capture_that_would_separate_it(member: int, other: int, action: Action) -> None:
    (line,) = advise(diagnosis((member, other)), panel())
    pair = "|".join(sorted((CANDIDATES[member].name, CANDIDATES[other].name)))
    assert line.startswith(f"{action.text}: separates {pair} (")
    now, then = map(int, re.findall(r"(\d+) %", line))
    assert now <= 1
    assert then >= 25


def test_a_tie_that_no_capture_separates_asks_for_a_reference() -> None:
    assert advise(diagnosis((OFFSET, TWIN)), panel()) == [
        "no capture of 4 more views separates range_offset|twin; a reference of known distance would"
    ]


def test_no_tie_needs_no_advice() -> None:
    assert advise(diagnosis(), panel()) == []


@pytest.mark.parametrize(("verdict", "root", "lines"), [("unknown", np.eye(6), 1), ("none", np.eye(6), 0), ("unknown", None, 0)])
def test_few_views_of_a_board_ask_for_more_where_an_error_has_no_name(verdict: str, root: Any, lines: int) -> None:
    found = diagnosis()
    found.verdict, found.chain = (verdict,), SimpleNamespace(root=root)
    assert [line.startswith("the board in 10 poses and more") for line in advise(found, panel())] == [True] * lines


def test_every_tie_has_its_line() -> None:
    one, two = (DRIFT, OFFSET), (OFFSET, TWIN)
    assert advise(diagnosis(one, two), panel()) == sorted(line for tie in (one, two) for line in advise(diagnosis(tie), panel()))


def test_a_share_tells_what_the_actions_change() -> None:
    drift = [visible_share(diagnosis(), panel(), CANDIDATES[DRIFT], CANDIDATES[OFFSET], action) for action in (None, *ACTIONS)]
    assert drift[:-1] == pytest.approx([0.0] * 5, abs=1e-3)  # nothing but warmth tells
    assert drift[-1] == pytest.approx(0.32, abs=0.02)
    light = [visible_share(diagnosis(), panel(), CANDIDATES[AMPLITUDE], CANDIDATES[WIGGLE], action) for action in (None, LATER, BRIGHTER)]
    assert light == pytest.approx([0.0, 0.0, 0.72], abs=0.02)


def test_three_ties_of_one_effect_that_no_capture_separates_stand_in_one_line() -> None:
    def tie(other: str, reference: str) -> _ForTie:
        return _ForTie("hand_eye", other, (reference, "a hand-eye calibration"))

    ties = [tie("range_offset", "a wall"), tie("specular", "matt spray"), tie("intrinsics", "a lens calibration")]
    assert _by_reference(ties) == [
        "no capture of 4 more views separates hand_eye from intrinsics, range_offset or specular; a hand-eye calibration would"
    ]
    assert _by_reference(ties[:2]) == [
        "no capture of 4 more views separates hand_eye|range_offset; a wall or a hand-eye calibration would",
        "no capture of 4 more views separates hand_eye|specular; matt spray or a hand-eye calibration would",
    ]
