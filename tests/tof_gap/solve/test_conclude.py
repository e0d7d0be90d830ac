# SPDX-License-Identifier: Apache-2.0
"""What noise and loss are read from, once the biases of the solution are taken off."""

from __future__ import annotations

import numpy as np

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_gap.seen.residual import less, noise_again


def test_columns_of_a_pattern_are_no_noise_once_they_are_taken_off() -> None:
    """Offsets of columns, 6 mm RMS: to the neighbours in a row they are noise."""
    columns = np.broadcast_to(np.random.default_rng(4).normal(0, 0.006, SHAPE[1]), (VIEWS, *SHAPE))
    quiet, session = views(np.random.default_rng(3)), views(np.random.default_rng(3), columns)
    alone = [c / v.frame.length for c, v in zip(columns, session, strict=True)]
    left = less(session, [alone])
    for before, after, photons in zip(left, noise_again(left), quiet, strict=True):
        assert np.median(before.sigma) > 1.2 * np.median(photons.sigma)
        np.testing.assert_allclose(after.sigma, photons.sigma, rtol=1e-3)
