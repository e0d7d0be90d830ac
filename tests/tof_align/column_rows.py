# SPDX-License-Identifier: Apache-2.0
"""Two stations of three views with random pixels: what the tests of columns and folds share."""

from __future__ import annotations

import numpy as np

from tof_align.chain import Chain
from tof_align.columns import ColumnSystem, Priors
from tof_align.config import Priors as RobotPriors
from tof_core import se3

VIEWS, STATIONS, COLUMNS, PIXELS = 6, 2, 3, 200
BASE_SD, HAND_SD = np.full(6, 0.05), np.full(6, 1e-5)
THETA_SD = np.full(COLUMNS, 0.05)
STATION = np.array([0, 0, 0, 1, 1, 1])


def rows() -> list[np.ndarray]:
    """Per view (n, 6 + K + 1): camera columns, effect columns, residual, all in units of sigma; the same at every call."""
    rng = np.random.default_rng(3)
    return [rng.normal(size=(PIXELS, 6 + COLUMNS + 1)) for _ in range(VIEWS)]


def chain() -> Chain:
    """Cameras about a body, all links slightly off the robot's word; the same at every call."""
    rng = np.random.default_rng(4)
    robot = np.array([se3.exp(rng.normal(0, 0.3, 6)) for _ in range(VIEWS)])
    base = np.array([se3.exp(rng.normal(0, 0.01, 6)) for _ in range(STATIONS)])
    arm = np.array([se3.exp(rng.normal(0, 1e-3, 6)) for _ in range(VIEWS)])
    pivot = np.array([se3.exp(rng.normal(0, 0.3, 6)) for _ in range(STATIONS)])
    return Chain(STATION, tuple(range(STATIONS)), pivot, robot, base, arm, np.eye(4), RobotPriors())


def system_of(X: list[np.ndarray], *, at_chain: bool = False) -> ColumnSystem:
    """The system of such rows."""
    each = np.full(VIEWS, float(PIXELS))
    return ColumnSystem.of([x.T @ x for x in X], chain(), THETA_SD, Priors(BASE_SD, HAND_SD, at_chain=at_chain), each, each, each)
