# SPDX-License-Identifier: Apache-2.0
"""How much of an assumed error the views show: all of one that is there, nothing of one that poses took up or that is not there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import VIEWS, views
from tof_gap.compare.poses_free import shown
from tof_gap.tell.figures.session import used
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.effects.wiggling import Wiggling
from tof_sensor.geometry import pose_columns

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence

EVIDENCE = views(np.random.default_rng(5))
FRAMES = [v.frame for v in EVIDENCE]
WIGGLE = [Wiggling(sine_m=0.006, modulation_mhz=150.0).bias(f) for f in FRAMES]
POSES = [pose_columns(f) @ np.array([0.002, -0.001, 0.003, 0.001, 0.002, -0.001]) for f in FRAMES]


def found(added: list[Float], *assumed: list[Float]) -> list[float]:
    def noise(v: ViewEvidence) -> Float:
        return used(v, ())

    errors = [noise(v) + a for v, a in zip(EVIDENCE, added, strict=True)]
    return shown(errors, assumed, [v.sigma**2 for v in EVIDENCE], FRAMES)


def test_an_error_that_is_there_is_shown_whatever_the_poses_are() -> None:
    (size,) = found([w + p for w, p in zip(WIGGLE, POSES, strict=True)], WIGGLE)
    assert size == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("poses", [0.0, 1.0, -2.0])
def test_an_error_that_is_not_there_is_not_shown(poses: float) -> None:
    (size,) = found([poses * p for p in POSES], WIGGLE)
    assert size == pytest.approx(0.0, abs=0.1)


def test_two_errors_are_told_apart() -> None:
    other = [np.where(np.arange(f.depth.shape[1]) % 20 < 10, 0.004, -0.004) + np.zeros(f.depth.shape) for f in FRAMES]
    sizes = found([w + 0.5 * o for w, o in zip(WIGGLE, other, strict=True)], WIGGLE, other)
    assert sizes == pytest.approx([1.0, 0.5], abs=0.1)


def test_what_every_pose_can_make_is_not_told() -> None:
    moved = [HandEye(z_m=0.01).bias(f) for f in FRAMES]
    assert np.isnan(found(moved, moved)).all()
    assert len(moved) == VIEWS
