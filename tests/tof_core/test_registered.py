# SPDX-License-Identifier: Apache-2.0
"""Depth that a driver has registered to another camera is known by its topic's name, or by pixels that are copies."""

from __future__ import annotations

import numpy as np
import pytest

from tof_core.registered import copied, registered

OWN = 1.0 + np.random.default_rng(1).normal(0.0, 0.003, (60, 80)).astype(np.float32)
"""Continuous depth with noise."""
COPIES = np.repeat(np.repeat(OWN, 2, axis=0), 2, axis=1)
"""The same in twice as many rows and columns: every other neighbour is a copy."""


def test_half_of_the_neighbours_are_copies_where_every_point_fills_two_by_two_pixels() -> None:
    assert copied(COPIES) == pytest.approx(0.5, abs=0.01)
    assert (
        registered([COPIES], "/cam/depth") == "Depth is registered to another camera: 50 % of neighbouring pixels are copies of each other"
    )


def test_noise_makes_no_copies() -> None:
    assert copied(OWN) == 0.0
    assert registered([OWN, OWN, COPIES], "/depth/hand/image") == ""


def test_neighbours_of_the_same_code_are_no_copies() -> None:
    assert copied((np.rint(1e3 * COPIES) / 1e3).astype(np.float32)) == 0.0


def test_neighbours_of_the_same_code_are_copies_where_they_have_the_same_amplitude() -> None:
    code = (np.rint(1e3 * COPIES) / 1e3).astype(np.float32)
    light = np.random.default_rng(2).integers(500, 4000, OWN.shape).astype(np.float32)
    assert copied(code, np.repeat(np.repeat(light, 2, axis=0), 2, axis=1)) == pytest.approx(0.5, abs=0.06)
    assert copied((np.rint(1e3 * OWN) / 1e3).astype(np.float32), light) < 0.001
    assert copied(code, np.full(code.shape, 7.0, np.float32)) == 0.0, "of an amplitude in coarse codes neighbours are alike by rounding"
    assert "copies of each other" in registered([code], "/depth/hand/image", [np.repeat(np.repeat(light, 2, axis=0), 2, axis=1)])


def test_a_surface_square_to_a_camera_without_noise_has_no_copies() -> None:
    assert copied(np.broadcast_to(np.float32(1.0003), (60, 80))) == 0.0
    assert copied(np.broadcast_to(np.linspace(1.0003, 2.0, 60, dtype=np.float32)[:, None], (60, 80))) == 0.0


@pytest.mark.parametrize("depth", [np.full((4, 8), np.nan), np.ones((4, 3)) * 1.0003, np.where(np.arange(9) % 2, np.nan, 1.0003)[None]])
def test_an_image_without_neighbours_has_no_copies(depth: np.ndarray) -> None:
    assert copied(depth) == 0.0


@pytest.mark.parametrize("topic", ["/camera/aligned_depth_to_color/image_raw", "/depth_registered/hand/image"])
def test_a_name_says_that_depth_is_registered(topic: str) -> None:
    assert registered([OWN], topic) == f"By the name of its topic, {topic}, depth is registered to another camera"


def test_depth_of_a_cloud_has_no_topic() -> None:
    assert registered([], "") == ""
