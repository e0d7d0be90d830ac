# SPDX-License-Identifier: Apache-2.0
"""Steps of the camera along its optical axis that follow the views: an arm's errors know neither how far nor how bright the parts are.

A depth error that no effect of the solution describes is absorbed by the poses as far as it is alike over a view. Its share in a step then
follows what the view contains. Errors of the arm do not, nor does another camera's light, whose phase is new in every capture. A mount or
an arm that gives way under the weight of the camera turns it by the torque of gravity.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.special import fdtrc

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints
    from tof_gap.seen.evidence.view import ViewEvidence


class Followed(NamedTuple):
    """Probability that arm errors follow something as closely by chance (F test), and RMS of what follows, in the unit of the errors."""

    chance: float
    size: float


def following(steps: Float, of_view: Float, station: Ints) -> Followed:
    """How well steps follow quantities of the views.

    Args:
        steps: (V,) arm errors along or about one axis.
        of_view: (V, k) quantities of each view; a view with a NaN does not count.
        station: (V,) of each view; the mean of a station is an error of the base, and no evidence.
    """
    seen = np.isfinite(of_view).all(axis=1)
    bases = (station[seen, None] == np.unique(station[seen])).astype(float)
    return _followed(steps[seen], bases, of_view[seen])


def contents(views: Sequence[ViewEvidence]) -> Float:
    """(V, 2) median distance along the ray in metres, and logarithm of the mean amplitude, of each view's smooth pixels; NaN without any."""
    out = np.full((len(views), 2), np.nan)
    for row, v in zip(out, views, strict=True):
        if v.smooth.any():
            row[0] = np.median(v.rendering.depth[v.smooth] * v.frame.length[v.smooth])
            row[1] = np.log(max(float(np.nanmean(v.frame.amplitude[v.smooth])), 1e-12))
    return out


def sagging(turns: Float, cameras: Float, station: Ints) -> Followed:
    """How well turns of the camera are those by its weight: turn = lever x down (docs/gap.md), with a `lever` fixed in the camera.

    The torque of gravity about the mount is the lever of the camera's centre of mass times its weight; a mount of one stiffness turns by
    the torque over it. Errors of a healthy arm repeat and change smoothly with its pose, so that they are no white noise, and a law of
    more coefficients, such as nine, describes them by chance in one session of eighty.

    Args:
        turns: (V, 3) turns of arm errors about the camera's axes, over their standard deviations by the robot's prior.
        cameras: (V, 4, 4) T_cell_camera; the cell's z axis is vertical (REP 103).
        station: (V,) of each view; the mean of a station is an error of the base, and no evidence.
    """
    down = -cameras[:, 2, :3]
    law = np.stack([np.cross(axis, down) for axis in np.eye(3)], axis=-1).reshape(-1, 3)
    bases = np.kron((station[:, None] == np.unique(station)).astype(float), np.eye(3))
    return _followed(turns.ravel(), bases, law)


def over_prior(arms: Float, arms_sd: Float) -> float:
    """RMS of arm errors (V, 6) over their standard deviations by the robot's prior: of positions, or of turns if that is less.

    Encoders, a base that slips and a wrong TF tree err in both; depth errors that poses absorb mostly move the camera along its axis.
    """
    return min(each_over_prior(arms, arms_sd))


def each_over_prior(arms: Float, arms_sd: Float) -> tuple[float, float]:
    """RMS of arm errors (V, 6) over their standard deviations by the robot's prior: of positions, and of turns."""
    positions, turns = np.sqrt(((arms / arms_sd) ** 2).reshape(-1, 2, 3).mean(axis=(0, 2)))
    return float(positions), float(turns)


def means(views: Sequence[ViewEvidence], maps: Sequence[Float]) -> Float:
    """(V, 1) mean over each view's smooth pixels of an effect's map (H, W), metres; NaN without any."""
    return np.array([[np.nanmean(m[v.smooth]) if np.isfinite(m[v.smooth]).any() else np.nan] for v, m in zip(views, maps, strict=True)])


def _followed(steps: Float, bases: Float, columns: Float) -> Followed:
    """How well `columns` (n, k) explain steps (n,) beside `bases` (n, s)."""
    alone, free_alone = _left(bases, steps)
    both, free = _left(np.column_stack([bases, columns]), steps)
    terms = free_alone - free
    if terms < 1 or free < 1 or not both > 0.0:
        return Followed(1.0, 0.0)
    chance = float(fdtrc(terms, free, (alone - both) / terms / (both / free)))
    return Followed(chance, float(np.sqrt(max(alone - both, 0.0) / len(steps))))


def _left(columns: Float, steps: Float) -> tuple[float, int]:
    """Sum of squares that columns (n, k) leave of steps (n,), and its degrees of freedom."""
    fitted, _, rank, _ = np.linalg.lstsq(columns, steps, rcond=None)
    return float(((steps - columns @ fitted) ** 2).sum()), len(steps) - int(rank)
