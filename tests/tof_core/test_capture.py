# SPDX-License-Identifier: Apache-2.0
"""A view whose image holds distances along the ray, as z."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tof_core.camera import Camera
from tof_core.capture import Capture, View


def distances() -> View:
    camera = Camera(3, 1, 2.0, 2.0, 1.0, 0.0)
    image = np.ones((1, 3), np.float32)
    view = View.of_capture(Capture(0, camera, image, np.zeros((1, 3), np.uint8)))
    return replace(view, sigma=0.1 * image, noise=0.2 * image)


def test_distances_become_z_with_their_deviations() -> None:
    z = distances().as_z()
    cosine = np.array([[1 / np.hypot(1, 0.5), 1.0, 1 / np.hypot(1, 0.5)]])
    assert z.noise is not None
    for image, along_ray in ((z.depth, 1.0), (z.sigma, 0.1), (z.noise, 0.2)):
        assert image == pytest.approx(along_ray * cosine, rel=1e-6)


def test_a_view_of_unknown_noise_stays_one() -> None:
    assert replace(distances(), noise=None).as_z().noise is None
