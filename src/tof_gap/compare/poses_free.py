# SPDX-License-Identifier: Apache-2.0
"""How much of an assumed error the views of a session show, whatever their poses are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_sensor.geometry import beside_poses, pose_columns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_sensor.frame import Frame

HIDDEN = 0.02
"""Share of an error's energy that poses leave, below which the views do not tell: poses are not linear to better than a hundredth."""


def shown(errors: Sequence[Float], assumed: Sequence[Sequence[Float]], sigma2: Sequence[Float], frames: Sequence[Frame]) -> list[float]:
    """Size of each assumed error in the errors of a session, over its assumed size; NaN where free poses hide it.

    A diagnosis that missed an effect has put a part of it into the poses. So every view's pose is free here, to first order: errors
    and assumed errors are compared in what no pose can make.

    Args:
        errors: (H, W) metres of z per view, NaN where a pixel does not count.
        assumed: the same for each of k assumed errors: they are fitted together.
        sigma2: (H, W) m^2, variance of the errors' noise.
        frames: the CAD of each view.
    """
    k = len(assumed)
    gram, right, before = np.zeros((k, k)), np.zeros(k), np.zeros(k)
    for v, (error, frame) in enumerate(zip(errors, frames, strict=True)):
        seen = np.isfinite(error) & np.isfinite(sigma2[v]) & (sigma2[v] > 0)
        weight = 1.0 / np.sqrt(sigma2[v][seen])
        D = np.stack([np.nan_to_num(a[v][seen]) for a in assumed], axis=1) * weight[:, None]
        left = beside_poses(np.column_stack([D, error[seen] * weight]), pose_columns(frame)[seen] * weight[:, None])
        gram, right, before = gram + left[:, :k].T @ left[:, :k], right + left[:, :k].T @ left[:, k], before + (D * D).sum(axis=0)
    known = np.diag(gram) > HIDDEN * before
    out = np.full(k, np.nan)
    if known.any():
        out[known] = np.linalg.lstsq(gram[np.ix_(known, known)], right[known], rcond=1e-6)[0]
    return [float(a) for a in out]
