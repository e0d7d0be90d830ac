# SPDX-License-Identifier: Apache-2.0
"""Cameras that triangulate: their noise follows range and not amplitude."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.noise.photons import binned, code_step

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.limits.noise import NoiseLimits
    from tof_gap.seen.evidence.view import ViewEvidence


def like_stereo(views: Sequence[ViewEvidence], noise: NoiseLimits) -> bool:
    """Whether noise grows with the square of range and not with falling amplitude, as that of a camera that triangulates does.

    Fitted over the bins: ln variance = c + p ln amplitude + q ln range^2. Photon noise gives p from -1 to -2; disparity p = 0 and q = 2.
    A bin whose depth code hardly ever changes has the variance of the code's step: that of its differences, near 0, would outweigh all others.
    """
    limits = noise.stereo
    if all(v.view.amplitude is None for v in views):
        return False
    b = binned(views, limits.bins, noise)
    if len(b.view) < limits.least_bins or min(np.ptp(np.log(b.range2)), np.ptp(np.log(b.amplitude))) < limits.span:
        return False
    X = np.stack([np.ones_like(b.variance), np.log(b.amplitude), np.log(b.range2)], axis=1)
    own = X[:, 1] - X[:, [0, 2]] @ np.linalg.lstsq(X[:, [0, 2]], X[:, 1], rcond=None)[0]
    if own.std() < limits.own_span:
        return False  # Amplitude follows range alone: the two powers cannot be separated.
    least = max(code_step(views) ** 2 / 12, 1e-14)
    _, p, q = np.linalg.lstsq(X, np.log(np.maximum(b.variance, least)), rcond=None)[0]
    return bool(p > limits.amplitude_power and q > limits.range_power)
