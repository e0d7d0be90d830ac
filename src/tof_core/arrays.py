# SPDX-License-Identifier: Apache-2.0
"""Array types used between rooms; the docstrings of their users give the shapes."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Float: TypeAlias = NDArray[np.float64]
"""float64 of any shape: poses, covariances, points on which accuracy rests."""
Image: TypeAlias = NDArray[np.float32]
"""(H, W) float32: depth along the optical axis in metres, sigma, amplitude; NaN is invalid."""
Mask: TypeAlias = NDArray[np.bool_]
Bytes: TypeAlias = NDArray[np.uint8]
Ints: TypeAlias = NDArray[np.integer]
