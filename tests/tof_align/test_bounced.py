# SPDX-License-Identifier: Apache-2.0
"""Light of other parts in a session: its columns, and poses that it does not move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_align.made import CONFIG, Seen, Truth, at, box, look, measured, pose_error, scene_of
from tof_align.bounced import ALBEDO_OFF, bounced_columns, emitters_of, light_in
from tof_align.config import DiscrepancyConfig
from tof_align.linearise import linearise
from tof_align.pixels import take_pixels
from tof_align.session import solve_session
from tof_core import se3
from tof_core.capture import RobotPose, View
from tof_scene.raycast import Raycaster
from tof_scene.scene import Material

GAIN = 0.3
"""Share of the light of other parts that the camera counts: some 6 mm in the mean, 40 mm in the corner."""


@pytest.fixture(scope="module")
def corner() -> Raycaster:
    """Floor, two walls, and two boxes: much of it lies in the light of the rest."""
    parts = (
        box("floor", (1.2, 1.2, 0.02), at(0, 0, -0.01)),
        box("back", (0.02, 1.2, 0.8), at(-0.4, 0, 0.4)),
        box("side", (1.2, 0.02, 0.8), at(0, -0.4, 0.4)),
        box("crate", (0.2, 0.25, 0.3), at(-0.1, 0.15, 0.15, (0, 0, 0.4))),
        box("block", (0.15, 0.12, 0.12), at(0.15, -0.15, 0.06, (0, 0, -0.5))),
    )
    return Raycaster(scene_of(*(replace(p, material=Material(0.5)) for p in parts)))


def recorded(caster: Raycaster, gain: float) -> tuple[list[View], list[Truth]]:
    """Eight views of two stations; the error is `gain` times one bounce."""
    rng = np.random.default_rng(3)
    out = []
    for k in range(8):
        nominal = look(np.array([rng.uniform(0.6, 0.9), rng.uniform(-0.2, 0.6), rng.uniform(0.4, 0.8)]), np.array([-0.1, 0.0, 0.15]))
        body = at(1.5, 0.2 * (k // 4), 0.0)
        error = se3.exp(np.concatenate([rng.normal(size=3) * 5e-4, np.radians(rng.normal(size=3) * 0.05)]))
        base = se3.exp(np.array([0.02, -0.01, 0.003, 0.0, 0.0, 0.01]) * (1 if k < 4 else -1))
        robot = RobotPose(body, se3.inverse(body) @ nominal)
        T = body @ base @ robot.T_body_camera @ error

        def effect(seen: Seen, T: np.ndarray = T) -> np.ndarray:
            clean, _ = measured(caster, T, RobotPose(np.eye(4), T), noise_mm=1e-3)
            pixels = take_pixels(clean, replace(CONFIG.weights, pixels=10**6))
            lin = linearise(pixels, T, caster, CONFIG.weights)
            bias = np.zeros(seen.depth.size)
            bias[lin.index] = gain * light_in(lin, pixels, caster).over(lin, pixels).sum(axis=1)
            return bias.reshape(seen.depth.shape)

        out.append(measured(caster, T, robot, number=k, station=k // 4, effect=effect))
    return [v for v, _ in out], [t for _, t in out]


def test_columns_add_up_to_the_light_of_all_parts(corner: Raycaster) -> None:
    views, truth = recorded(corner, 0.0)
    pixels = take_pixels(views[0], CONFIG.weights)
    lin = linearise(pixels, truth[0].T_cell_camera, corner, CONFIG.weights)
    assert bounced_columns(emitters_of([lin]), lin).shape == (len(lin.residual), 0), "not computed: no columns"
    lit = replace(lin, bounced=light_in(lin, pixels, corner).over(lin, pixels))
    emitters = emitters_of([lit])
    columns = bounced_columns(emitters, lit)
    assert float(np.sqrt((columns[:, 0] ** 2).mean())) == pytest.approx(1.0)
    assert columns[:, 1:].sum(axis=1) / ALBEDO_OFF == pytest.approx(columns[:, 0], rel=0.05, abs=0.05)
    assert lit.bounced is not None
    assert (lit.bounced >= 0).all()
    assert 1e-3 < emitters.scale < 0.1


def test_light_of_other_parts_does_not_move_the_cameras(corner: Raycaster) -> None:
    views, truth = recorded(corner, GAIN)
    found = solve_session(views, corner, CONFIG)
    without = solve_session(views, corner, replace(CONFIG, discrepancy=DiscrepancyConfig(bounces=False, parts=False)))
    errors, before = ([pose_error(p.T_cell_camera, t)[0] for p, t in zip(s.posed, truth, strict=True)] for s in (found, without))
    assert np.median(errors) < 0.5 * np.median(before)
    assert found.sizes["bounce"] > 2e-3
    healthy = solve_session(recorded(corner, 0.0)[0], corner, CONFIG)
    assert healthy.sizes["bounce"] < 0.3e-3
