# SPDX-License-Identifier: Apache-2.0
"""A virtual robot whose AMCW camera is simulated tap by tap and recorded to bags."""

import tof_core  # noqa: F401  (names the cache of the kernels, before any of them imports numba)
