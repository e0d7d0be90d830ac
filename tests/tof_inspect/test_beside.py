# SPDX-License-Identifier: Apache-2.0
"""A reference session takes the camera's own error out of displacements, and does no harm where it is mostly noise."""

from __future__ import annotations

import numpy as np
import pytest

from tof_inspect.beside import scale_of
from tof_inspect.config import InspectConfig
from tof_inspect.displaced import Fit

CONFIG = InspectConfig()
NOISE, STATED = 0.15e-3, 1.0e-3
PARTS = 14


def fit(shift: np.ndarray) -> Fit:
    """A part seen at `shift`: the camera may be wrong by 1 mm, noise is 0.15 mm."""
    none = np.zeros((3, 3))
    return Fit(shift, NOISE**2 * np.eye(3), none, STATED**2 * np.eye(3), none, np.eye(3), 0.0)


def sessions(camera: float, rng: np.random.Generator) -> tuple[list[Fit], list[Fit]]:
    """Two sessions of parts in their place before a camera whose own error has this standard deviation."""
    own = rng.normal(0, camera, (PARTS, 3))
    return [fit(own[k] + rng.normal(0, NOISE, 3)) for k in range(PARTS)], [fit(own[k] + rng.normal(0, NOISE, 3)) for k in range(PARTS)]


@pytest.mark.parametrize(("camera", "most"), [(0.0, 1.05), (0.1e-3, 1.0), (1e-3, 0.3), (4e-3, 0.08)])
def test_a_reference_never_harms_and_wins_where_the_camera_errs(camera: float, most: float) -> None:
    rng, without, beside, chi = np.random.default_rng(1), [], [], []
    for _ in range(30):
        first, second = sessions(camera, rng)
        scale = scale_of(first)
        for then, now in zip(first, second, strict=True):
            relative = now.relative_to(then, scale, CONFIG)
            without.append(np.linalg.norm(now.shift))
            beside.append(np.linalg.norm(relative.shift))
            chi.append(relative.shift @ np.linalg.solve(relative.cov, relative.shift))
    assert np.median(beside) < most * np.median(without)
    assert 1.0 < np.mean(chi) < 3.6, "three axes, on the safe side"


@pytest.mark.parametrize("camera", [0.3e-3, 1e-3, 3e-3])
def test_the_scale_is_that_of_the_cameras_error(camera: float) -> None:
    rng = np.random.default_rng(2)
    found = np.array([scale_of(sessions(camera, rng)[0]) for _ in range(100)])
    assert np.median(found[:, 0]) == pytest.approx((camera / STATED) ** 2, rel=0.15)
    assert np.mean(found[:, 1] < (camera / STATED) ** 2) < 0.12, "at most is at most, but for one in twenty"


def test_without_a_part_that_is_known_the_stated_error_stands() -> None:
    blind = Fit(np.zeros(3), np.eye(3), np.zeros((3, 3)), np.eye(3), np.zeros((3, 3)), np.zeros((3, 0)), 0.0)
    assert scale_of([blind]) == (1.0, 1.0)
    assert scale_of([]) == (1.0, 1.0)
