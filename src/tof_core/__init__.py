# SPDX-License-Identifier: Apache-2.0
"""Captures, views, cameras, poses, units, errors, configuration, and bags in and out."""

import os
import sys

_LOCATORS = ("InGivenFolder", "BesideSource", "InUserFolder")
_OF_OTHERS = ("UserProvidedCacheLocator", "InTreeCacheLocator", "UserWideCacheLocator", "IPythonCacheLocator", "ZipCacheLocator")
"""Numba's own locators, for kernels that are not this project's."""
_ALL = ",".join([*(f"tof_core.kernel_cache.{name}" for name in _LOCATORS), *_OF_OTHERS])

os.environ.setdefault("NUMBA_CACHE_LOCATOR_CLASSES", _ALL)  # Numba reads the variable at import; kernel_cache.py says why
if "numba" in sys.modules:
    sys.modules["numba"].config.CACHE_LOCATOR_CLASSES = os.environ["NUMBA_CACHE_LOCATOR_CLASSES"]
