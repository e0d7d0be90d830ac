# SPDX-License-Identifier: Apache-2.0
"""One view, a station or a session aligned to the CAD, with verdict and covariance."""

import tof_core  # noqa: F401  (names the cache of the kernels, before any of them imports numba)
