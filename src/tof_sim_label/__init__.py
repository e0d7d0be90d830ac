# SPDX-License-Identifier: Apache-2.0
"""Labels rendered at a solved pose, and the dataset that stores them."""

import tof_core  # noqa: F401  (names the cache of the kernels, before any of them imports numba)
