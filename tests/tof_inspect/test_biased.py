# SPDX-License-Identifier: Apache-2.0
"""A camera with errors that nobody modelled: parts in their place are present, displaced ones are found, and a reference session helps."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_align.made import look
from tests.tof_inspect.made import CAMERA, as_built, plate, seen
from tof_align.config import AlignConfig
from tof_inspect.config import InspectConfig
from tof_inspect.judge import Inspector
from tof_inspect.shared import BEYOND, Left, SessionErrors
from tof_scene.raycast import Raycaster

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_scene.scene import Scene

EYES = [
    look(np.array(eye), np.array([0.0, 0.0, 0.8])) for eye in ((0.55, 0.12, 0.9), (0.45, -0.2, 0.95), (0.6, 0.3, 0.7), (0.4, 0.0, 1.05))
]
WAVE_M, PERIOD_M = 0.004, 0.2


def inspector() -> Inspector:
    return Inspector(Raycaster(plate()), InspectConfig(), AlignConfig())


def views(built: Scene, error: Float | None = None, seed: int = 0) -> list[View]:
    """The plate before a camera that wiggles by 4 mm over 20 cm of range; `error` is added to all pixels of the block."""
    out = []
    for k, T in enumerate(EYES):
        view = seen(built, seed=seed + k, T=T, noise_mm=0.7)
        radial = view.depth * CAMERA.ray_length()
        bias = WAVE_M * np.sin(2 * np.pi * radial / PERIOD_M) / CAMERA.ray_length()
        if error is not None:
            rays = CAMERA.rays().reshape(-1, 3) @ T[:3, :3].T
            part = Raycaster(built).cast(T[:3, 3], rays).part.reshape(CAMERA.shape)
            bias = bias + np.where(part == built.index("block"), error, 0.0)
        out.append(replace(view, depth=(view.depth + bias).astype(np.float32), stamp_ns=k + 1, dwell_ns=k + 1))
    return out


def test_a_wave_of_four_millimetres_displaces_nothing() -> None:
    verdicts = {v.name: v for v in inspector().judge(views(plate())).verdicts}
    for name in ("clip", "block"):
        assert verdicts[name].state == "present"
        assert verdicts[name].displaced_mm < 3 * verdicts[name].std_mm
        assert np.sqrt(verdicts[name].cov_mm2[0][0]) < 1.0, "off the wall; along it nothing but the parts holds the cameras"


def test_a_displacement_is_found_through_the_wave() -> None:
    moved = (7.0, 0.0, 0.0)
    built = as_built(plate(), moved={"block": moved, "buried": moved})
    block = {v.name: v for v in inspector().judge(views(built)).verdicts}["block"]
    assert block.state == "displaced"
    error, std = np.array(block.shift_mm) - moved, np.sqrt(block.cov_mm2[0][0])
    assert abs(error[0]) < min(0.5, 3 * std)
    assert std < 1.25, "a sixth of the displacement"


def test_what_the_reference_session_shows_too_is_no_displacement() -> None:
    error = np.asarray(0.006)
    bare, learnt = inspector(), inspector()
    learnt.standing = learnt.learn(views(plate(), error, seed=50))
    without, beside = ({v.name: v for v in i.judge(views(plate(), error)).verdicts}["block"] for i in (bare, learnt))
    assert without.state == "displaced"
    assert beside.state == "present"
    assert beside.displaced_mm < 2 * beside.std_mm < 2.0


def test_amplitudes_that_the_session_did_not_see_are_uncertain() -> None:
    from tof_align.camera_error import beyond_data
    from tof_align.discrepancy import Basis

    config = AlignConfig().discrepancy
    none = np.zeros((0, 0))
    basis = Basis(np.zeros(0), none, np.linspace(4.0, 10.0, 9), np.eye(9), np.zeros((0, 6)), none, 1.0, -1)
    amplitude, sizes = np.array([7.0, 3.75, -40.0]), {"amplitude": 2e-3}
    inside, dark, darkest = beyond_data(basis, np.ones(3), amplitude, np.zeros(3), sizes, config)
    assert inside.tolist() == [0.0, 0.0]
    distance = np.sqrt(3.0) * (4.75 - 3.75) / config.amplitude
    assert dark[1] == pytest.approx(2e-3 * np.sqrt(1 - ((1 + distance) * np.exp(-distance)) ** 2))
    assert darkest[1] == pytest.approx(2e-3)
    late = beyond_data(basis, np.ones(3), amplitude, np.full(3, 0.004), sizes, config)
    assert late[0, 1] == 0.0
    assert late[1, 1] == pytest.approx(np.hypot(dark[1], 0.004 * (np.exp(1.0) - 1.0))), "late charge grows as 1 / amplitude"


def test_a_part_without_a_vote_moves_no_camera() -> None:
    made = inspector()
    session = views(as_built(plate(), moved={"block": (9.0, 0.0, 0.0), "buried": (9.0, 0.0, 0.0)}))
    clean, solution = made._solved(session, lambda _: None)
    index = made.scene.index("block")
    shapes = [v.depth.shape for v in clean]
    with_vote, without = (SessionErrors.of(solution, shapes, part, made.align.discrepancy, Left.of(solution)) for part in (-1, index))
    truth = [np.linalg.norm((np.linalg.inv(e.pose(0)) @ EYES[0])[:3, 3]) for e in (with_vote, without)]
    assert truth[1] <= truth[0] + 1e-4
    A = np.eye(3, 6)
    columns = without.columns(0, np.ones(5), np.full(5, np.nan), np.arange(5))
    assert columns.shape[1] >= BEYOND
    cov = without.cov({0: (A, np.zeros((3, columns.shape[1])))})
    assert (np.linalg.eigvalsh(cov) > 0).all(), "the pose stays uncertain"


def test_the_bias_comes_from_like_pixels_outside_the_part() -> None:
    cell = np.repeat([[20, 5], [20, 9], [26, 5]], 40, axis=0)
    part = np.tile([1, 2], 60)
    left = np.where(cell[:, 0] == 26, 0.0, np.where(part == 1, 0.003, 0.009))
    left[cell[:, 1] == 9] = 0.0
    made = Left(cell, left, part, {})
    found = made.at(np.array([6.1, 6.1, 7.9, 2.0]), np.array([0.8, 1.4, 0.8, 0.8]), 2)
    np.testing.assert_allclose(found, [0.003, 0.0, 0.0, 0.0], err_msg="dark and near, dark and far, bright and near, never seen")
    np.testing.assert_allclose(made.at(np.array([6.1]), np.array([0.8]), 1), [0.009])
