# SPDX-License-Identifier: Apache-2.0
"""Sine and cosine of many phases."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float


def sine_cosine(turns: Float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Sine and cosine of phases in whole turns, to 3e-7.

    The fraction of a turn is taken in double precision, its sine in single precision, which NumPy computes ten times as fast.
    """
    phase = (2.0 * np.pi * (turns - np.rint(turns))).astype(np.float32)
    return np.sin(phase), np.cos(phase)
