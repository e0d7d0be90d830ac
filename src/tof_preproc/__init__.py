# SPDX-License-Identifier: Apache-2.0
"""Accumulation and filters; every removed pixel keeps its reason."""

import tof_core  # noqa: F401  (names the cache of the kernels, before any of them imports numba)
