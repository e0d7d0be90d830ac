# SPDX-License-Identifier: Apache-2.0
"""A linearised view of which tests give residuals, derivative and noise by hand."""

from __future__ import annotations

import numpy as np

from tof_align.linearise import Linearised


def view_of(residual: object, sigma: object = 1e-3, jacobian: object = None, raster: tuple[int, int] = (40, 40)) -> Linearised:
    """Pixels (n,) in the first places of the raster, looking along z; without a derivative each, it is drawn at random."""
    e = np.asarray(residual, float)
    n = len(e)
    J = np.random.default_rng(8).normal(size=(n, 6)) if jacobian is None else np.asarray(jacobian, float)
    at = np.arange(n)
    along = np.tile([0.0, 0.0, 1.0], (n, 1))
    spread = np.broadcast_to(np.asarray(sigma, float), (n,)).copy()
    return Linearised(np.eye(4), at, at, raster, J, e, spread, np.ones(n), along, along, -along, None, np.zeros(n, np.int64))
