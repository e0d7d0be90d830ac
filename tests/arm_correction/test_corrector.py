# SPDX-License-Identifier: Apache-2.0
"""State of the node: reference and CAD, proposals from the last dwells, one command at a time."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from arm_correction.corrector import Corrector, twin_of
from arm_correction.frames import Frames
from arm_correction.match import register_view
from tests.arm_correction.made import CAMERA, CONFIG, FIRST, reference, seen, twist
from tests.tof_align.made import at, section
from tof_core import se3
from tof_core.capture import RobotPose
from tof_core.errors import RefusedError

if TYPE_CHECKING:
    import numpy as np

    from tof_core.capture import View

MOTION = twist((12, -8, 10), (0.5, 0.8, -0.3))
HAND = at(0.06, 0.0, 0.04, (0.3, -1.1, 0.2))


def moved(seed: int = 0, believed: np.ndarray = FIRST) -> View:
    return seen(section(), FIRST @ MOTION, believed=believed, seed=seed)


def test_a_captured_view_is_what_the_next_one_is_brought_back_to() -> None:
    made = Corrector(CONFIG, caster=section())
    kept = made.capture(seen(section(), FIRST, seed=99))
    assert kept is made.reference
    assert kept.scene == section().scene.digest
    assert kept.T_cell_camera is not None
    metres, _ = se3.distance(kept.T_cell_camera, FIRST)
    assert metres < 2e-3
    out = made.propose([moved()], Frames(HAND))
    assert list(out) == ["reference", "cad"]
    for by, mm in (("reference", 0.6), ("cad", 2.0)):
        after = FIRST @ MOTION @ se3.inverse(HAND) @ out[by].delta @ HAND
        metres, degrees = se3.distance(after, FIRST)
        assert out[by].accepted, out[by].reason
        assert 1e3 * metres < mm, by
        assert degrees < 0.15, by


def test_without_reference_and_scene_nothing_is_proposed() -> None:
    with pytest.raises(RefusedError, match="capture a reference"):
        Corrector(CONFIG).propose([moved()])


def test_a_view_without_a_robot_pose_is_refused() -> None:
    with pytest.raises(RefusedError, match="no robot pose"):
        Corrector(CONFIG, reference=reference(section())).propose([replace(moved(), robot=None)])


def test_a_reference_of_another_scene_is_refused_when_it_is_captured() -> None:
    with pytest.raises(RefusedError, match="another scene"):
        Corrector(CONFIG, caster=section(), reference=replace(reference(section()), scene="another"))


def test_a_view_of_another_camera_is_refused() -> None:
    made = Corrector(CONFIG, reference=reference(section()))
    with pytest.raises(RefusedError, match="another camera"):
        made.propose([replace(moved(), camera=replace(CAMERA, fx=160.0))])


def test_the_dwell_before_must_agree_where_the_robot_did_not_move() -> None:
    made = Corrector(CONFIG, reference=reference(section()))
    assert made.propose([moved(0), moved(1)])["reference"].accepted
    elsewhere = seen(section(), FIRST @ MOTION @ twist((0, 6, 0)), believed=FIRST)
    refused = made.propose([elsewhere, moved(1)])["reference"]
    assert "two dwells disagree" in refused.reason
    assert refused.step == (0.0, 0.0)
    gone = moved(1, believed=FIRST @ twist((0, 5, 0)))
    assert twin_of([elsewhere, gone], CONFIG.limits) is None


@pytest.mark.parametrize("jump_m", [0.2, 3.0])
def test_a_jump_of_tf_costs_nothing_while_the_base_stands(jump_m: float) -> None:
    made = Corrector(CONFIG, reference=reference(section()))
    view, jump = moved(), at(0.0, jump_m, 0.0, (0, 0, 0.1))
    assert view.robot is not None
    out = made.propose([replace(view, robot=RobotPose(jump, view.robot.T_body_camera))])["reference"]
    assert out.accepted, out.reason
    metres, _ = se3.distance(FIRST @ MOTION @ out.delta, FIRST)
    assert 1e3 * metres < 1.0


def test_a_jump_of_the_whole_chain_is_refused() -> None:
    """Without a body frame only the camera's pose is known; if it is metres off, no start is near."""
    out = Corrector(CONFIG, reference=reference(section())).propose([moved(believed=at(0.0, 3.0, 0.0) @ FIRST)])["reference"]
    assert not out.accepted
    assert out.step == (0.0, 0.0)


def test_a_second_command_is_refused_and_not_queued(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Corrector(CONFIG, reference=reference(section()))
    messages: list[str] = []

    def meanwhile(*arguments: object) -> object:
        for command in (lambda: made.propose([moved()]), lambda: made.capture(moved())):
            with pytest.raises(RefusedError, match="busy") as caught:
                command()
            messages.append(str(caught.value))
        return register_view(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr("arm_correction.first.register_view", meanwhile)
    assert made.propose([moved()])["reference"].accepted
    assert len(messages) == 2
    assert "\n" not in messages[0]
    monkeypatch.undo()
    assert made.propose([moved()])["reference"].accepted
