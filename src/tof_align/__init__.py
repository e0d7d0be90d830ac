# SPDX-License-Identifier: Apache-2.0
"""Registration of one view, a station or a session to the CAD, with verdict and covariance."""

import tof_core  # noqa: F401  (names the cache of the kernels, before any of them imports numba)
