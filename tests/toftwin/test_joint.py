# SPDX-License-Identifier: Apache-2.0
"""The lens and the parts with which `label --joint` solves poses again: the diagnosed ones only where the diagnosis names them wrong."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tof_core.camera import Camera
from tof_core.capture import Posed, View
from toftwin import joint
from toftwin.joint import joint_poses
from toftwin.pipeline import PipelineConfig

if TYPE_CHECKING:
    from collections.abc import Sequence

STATED = Camera(8, 6, 10.0, 10.0, 4.0, 3.0)
DIAGNOSED = replace(STATED, cx=4.13)
DEPTH = np.full((6, 8), 1.0, np.float32)
BIAS_M = 0.002


def solved(named: Sequence[str]) -> Any:
    """A diagnosis of one view, 2 mm of whose depth are the camera's."""
    view = SimpleNamespace(camera=DIAGNOSED, depth=DEPTH, stamp_ns=5)
    bare = SimpleNamespace(view=view, frame=SimpleNamespace(depth=DEPTH - BIAS_M), residual=np.zeros((6, 8)))
    names = [SimpleNamespace(name=name, effects=(), ties=(), suspected=False) for name in named]
    return SimpleNamespace(verdict=tuple(named), solved=SimpleNamespace(evidence=[bare], bare=[bare], maps={}, named=names))


@pytest.mark.parametrize(
    ("named", "camera"),
    [([], STATED), (["wiggling"], STATED), (["intrinsics"], DIAGNOSED)],
    ids=["healthy", "an effect of depth", "a wrong lens"],
)
def test_poses_are_solved_through_the_diagnosed_lens_only_if_it_is_named(
    monkeypatch: pytest.MonkeyPatch, named: list[str], camera: Camera
) -> None:
    given: list[View] = []

    def solve(views: Sequence[View], *_: object) -> Any:
        given.extend(views)
        return SimpleNamespace(posed=[Posed(np.eye(4), np.eye(6))] * len(views))

    monkeypatch.setattr(joint, "diagnose_bag", lambda *_, **__: (solved(named), None))
    monkeypatch.setattr(joint, "solve_session", solve)
    unknown = np.full(DEPTH.shape, np.nan, np.float32)
    view = View(5, 5, STATED, DEPTH, unknown, np.ones(DEPTH.shape, np.uint16), np.zeros(DEPTH.shape, np.uint8), None)
    inputs: Any = SimpleNamespace(scene=None)
    cameras = joint_poses(inputs, [view], inputs, PipelineConfig())
    (posed,) = cameras.posed
    assert cameras.displaced == ()
    assert given[0].camera == posed.seen_by(STATED) == camera
    np.testing.assert_allclose(given[0].depth, DEPTH - BIAS_M, atol=1e-6)
