# SPDX-License-Identifier: Apache-2.0
"""The CAD scene: parts, materials, ray casting and pixel footprints."""

import tof_core  # noqa: F401  (names the cache of the kernels, before any of them imports numba)
