# SPDX-License-Identifier: Apache-2.0
"""How many threads linear algebra takes."""

from __future__ import annotations

import os

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""For small matrices more threads gain nothing, and waiting for each other they take the cores of others."""


def one_thread() -> None:
    """One thread, unless the environment says otherwise; read when NumPy is imported, so call it before."""
    os.environ.update({name: "1" for name in ONE_THREAD if name not in os.environ})
