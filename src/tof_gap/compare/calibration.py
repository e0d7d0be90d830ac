# SPDX-License-Identifier: Apache-2.0
"""Hand-eye and lens of two sessions: whether they differ by more than the stated calibration."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_gap.solve.tolerance import calibrated
from tof_gap.solved import Named
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.effects.intrinsics import Intrinsics

if TYPE_CHECKING:
    from tof_gap.tell.account import Cause
    from tof_gap.tell.diagnosis import Diagnosis

OF_CALIBRATION = frozenset({HandEye.NAME, Intrinsics.NAME})
"""Effects whose usual errors a calibration states."""


def as_calibrated(real: Diagnosis, simulated: Diagnosis) -> tuple[str, ...]:
    """Effects that both sessions name, and that differ by no more than the stated calibration allows.

    A camera's mount and lens are known to their calibration, and a simulator has them as stated: so an error beyond the calibration that
    both have differs by up to the calibration's error. It is judged as a diagnosis judges one session, to one standard deviation.
    """
    return tuple(one.named.name for one, other in _of_both(real, simulated) if _alike(one, other, real))


def mounts_differ(real: Diagnosis, simulated: Diagnosis) -> bool:
    """Whether both sessions name hand-eye, and differ by more than the largest error of its calibration, if one is stated.

    The camera's own error of calibration adds to what both have: 5 and 8 mm may be one bump and twice the bump, and the ratio of their
    sizes does not show it.
    """
    stated = real.config.calibration.hand_eye_sd.any()
    mounts = [both for both in _of_both(real, simulated) if both[0].named.name == HandEye.NAME]
    return bool(stated and mounts) and not any(_alike(*both, real) for both in mounts)


def _of_both(real: Diagnosis, simulated: Diagnosis) -> list[tuple[Cause, Cause]]:
    """Mount and lens in the real and the simulated session, where both name them."""
    theirs = {c.named.name: c for c in simulated.causes if c.named.name in OF_CALIBRATION}
    return [(c, theirs[c.named.name]) for c in real.causes if c.named.name in theirs]


def _alike(one: Cause, other: Cause, real: Diagnosis) -> bool:
    """Whether the difference of two named effects of one form is a calibration's error."""
    effect, theirs = one.named.effects[0], other.named.effects[0]
    if type(effect) is not type(theirs) or len(effect.coefficients) != len(theirs.coefficients):
        return False
    stds = [np.array([*c.named.std[0].values()]) for c in (one, other)]
    std = dict(zip(one.named.std[0], np.hypot(*stds).tolist(), strict=True))
    apart = effect.with_coefficients(effect.coefficients - theirs.coefficients)
    return calibrated(Named(one.named.name, (apart,), (std,), (), 1.0), real.config.calibration, real.camera)
