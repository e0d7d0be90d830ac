# SPDX-License-Identifier: Apache-2.0
"""What the light of a lamp explains, against least squares with every wave written out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_gap.seen.foreign.lamp_light import RIDGE, _explained, gains_at, lag_of

if TYPE_CHECKING:
    from tof_core.arrays import Float

CELLS, K = 60, 0.8


def test_the_gain_is_what_least_squares_of_four_waves_explain_beside_the_smooth_fields() -> None:
    rng = np.random.default_rng(4)
    points, range_m = rng.uniform(-0.5, 0.5, (CELLS, 3)), rng.uniform(0.6, 1.4, CELLS)
    normals = np.tile([0.0, 0.0, 1.0], (CELLS, 1))
    cosine, sigma = rng.uniform(0.4, 1.0, CELLS), rng.uniform(1e-3, 2e-3, CELLS)
    smooth, _ = np.linalg.qr(np.stack([np.ones(CELLS), points[:, 0]], axis=1) / sigma[:, None])
    error = rng.normal(size=CELLS)
    error -= smooth @ (smooth.T @ error)
    places = np.array([[0.1, -0.2, 1.3], [0.0, 0.0, -2.0]])
    lit = np.ones((3, CELLS), bool)
    lit[2, ::3] = False
    gains = gains_at(
        np.concatenate([places, places[:1]]), K, 2, points, normals, range_m, cosine, lag_of(K, range_m), sigma, smooth, error, lit
    )

    for n, k in enumerate((K, 2 * K)):
        way = np.linalg.norm(places[0] - points, axis=1)
        ratio = (places[0] - points)[:, 2] / way * range_m**2 / (way**2 * cosine)
        phases = (k * (way - range_m), k * (way + 3 * range_m))
        for place in (0, 2):
            B = np.stack([lit[place] * ratio * f(p) for p in phases for f in (np.cos, np.sin)], axis=1) / sigma[:, None]
            B -= smooth @ (smooth.T @ B)
            normal = B.T @ B
            normal += RIDGE * np.trace(normal) / 4 * np.eye(4)
            assert gains[n, place] == pytest.approx((B.T @ error) @ np.linalg.solve(normal, B.T @ error), rel=1e-9)
    assert (gains[:, 1] == 0).all(), "a lamp behind all surfaces"


@pytest.mark.parametrize("left", [np.array([[1.0, 0.0], [1.002, 1.0]]), np.array([[1e-9, 0.0], [0.0, -3e-9]]), np.zeros((2, 2))])
def test_waves_that_smooth_fields_make_wholly_explain_nothing_of_their_own(left: Float) -> None:
    """What rounding leaves of their products need not be those of any waves: a pivot below 0, or 0."""
    gain = _explained(left, np.array([1e-9, -1e-9]))
    assert 0.0 <= gain < 1e-5
