# SPDX-License-Identifier: Apache-2.0
"""The forward sensor model: effects that can be added to a rendered view."""

import tof_core  # noqa: F401  (names the cache of the kernels, before any of them imports numba)
