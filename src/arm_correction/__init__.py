# SPDX-License-Identifier: Apache-2.0
"""The corrective hand pose that makes the next view equal to the reference view, or a refusal."""

import tof_core  # noqa: F401  (names the cache of the kernels, before any of them imports numba)
