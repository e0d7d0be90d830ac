# SPDX-License-Identifier: Apache-2.0
"""The camera's own errors at any pixel of a view, by a session's discrepancy: functions of range, amplitude and image position."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_align.discrepancy import SHARED, cosines, matern, spline_entries

if TYPE_CHECKING:
    from tof_align.config import DiscrepancyConfig
    from tof_align.discrepancy import Basis
    from tof_core.arrays import Float, Ints

LARGEST_FALL = 3.0
"""Largest fall of ln amplitude below the darkest pixels seen to which the law of late charge is extrapolated: 1/20 of their amplitude."""


def camera_columns(basis: Basis, radial: Float, log_amplitude: Float, shape: tuple[int, int], index: Ints) -> tuple[Float, Float]:
    """(n, sum(basis.shared)), (n, sum(basis.local)): the columns of the camera's own errors at any pixels of a view.

    Errors that depend on range, amplitude or image position need no CAD; columns of the surface, of bounced light and of parts are zero.
    radial (n,): distance along the ray, metres; log_amplitude (n,): NaN where unknown; shape: (H, W); index (n,): flat.
    """
    image = cosines(*shape, basis.order)[index] if basis.order >= 0 else np.zeros((len(index), 0))
    blocks = dict.fromkeys(SHARED, None) | {
        "range": _splines(basis.knots_range, radial) @ basis.root_range if basis.root_range.size else None,
        "amplitude": _splines(basis.knots_amplitude, log_amplitude) @ basis.root_amplitude if basis.root_amplitude.size else None,
        "image": image if basis.order > 0 else None,
    }
    shared = [np.zeros((len(index), size)) if block is None else block for block, size in zip(blocks.values(), basis.shared, strict=True)]
    local = np.concatenate([np.ones((len(index), 1)), image], axis=1) if basis.order >= 0 else np.zeros((len(index), 0))
    return np.asarray(np.concatenate(shared, axis=1), float), np.asarray(local, float)


def _splines(knots: Float, x: Float) -> Float:
    """(n, k) cubic B-splines about the knots at x; zero where x is NaN."""
    out = np.zeros((len(x), len(knots)))
    place, value = spline_entries(knots, x)
    np.put_along_axis(out, place.astype(np.int64), np.asarray(value, float), axis=1)
    return out


def beyond_data(
    basis: Basis, radial: Float, log_amplitude: Float, by_amplitude: Float, sizes: dict[str, float], config: DiscrepancyConfig
) -> Float:
    """(n, 2) standard deviation in metres of the camera's error at ranges and amplitudes that the session did not see on the CAD.

    The columns are constant there. A process of variance s^2 has the variance s^2 (1 - rho^2) left where its correlation with the data
    is rho. An error by late charge grows as 1 / amplitude; at darker pixels than any seen, the error `by_amplitude` (n,) of the darkest
    ones may grow so, too.
    """
    out = np.zeros((len(radial), 2))
    if len(basis.knots_range):
        far = _outside(basis.knots_range, radial) / config.range_m
        out[:, 0] = sizes.get("range", 0.0) * np.sqrt(1.0 - matern(far) ** 2)
    if len(basis.knots_amplitude):
        far = _outside(basis.knots_amplitude, log_amplitude)
        darker = np.clip(np.nan_to_num(basis.knots_amplitude[1] - log_amplitude, nan=0.0), 0.0, LARGEST_FALL)
        smooth = sizes.get("amplitude", 0.0) * np.sqrt(1.0 - matern(far / config.amplitude) ** 2)
        out[:, 1] = np.hypot(smooth, np.abs(by_amplitude) * np.expm1(darker))
    return out


def _outside(knots: Float, x: Float) -> Float:
    """(n,) distance of x from the range of the data; infinite where x is unknown."""
    return np.asarray(np.nan_to_num(np.maximum(np.maximum(knots[1] - x, x - knots[-2]), 0.0), nan=np.inf))
