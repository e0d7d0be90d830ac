# SPDX-License-Identifier: Apache-2.0
"""The raster that stages work on, and what they say they did."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Image, Mask
    from tof_core.camera import Camera
    from tof_core.reasons import Reason


@dataclass(slots=True, eq=False)
class Frame:
    """One depth raster in work: arrays (H, W) of its own, changed in place, pixels only ever taken away.

    `sigma` is the standard deviation of `depth` in metres, as far as known; `amplitude` may be None.
    """

    camera: Camera
    depth: Image
    reason: Bytes
    sigma: Image
    amplitude: Image | None = None

    def remove(self, mask: Mask, reason: Reason) -> int:
        """Take away the valid pixels of `mask`, note why, and say how many they were."""
        gone = mask & np.isfinite(self.depth)
        self.depth[gone] = np.nan
        self.sigma[gone] = np.nan
        self.reason[gone] = reason
        return int(np.count_nonzero(gone))


@dataclass(slots=True)
class Report:
    """What became of one view.

    `removed`: stage to pixels it removed (for `iqr` and `sigma3`: captures of pixels it rejected);
    `passed`: stage to why it did nothing.
    """

    removed: dict[str, int] = field(default_factory=dict)
    passed: dict[str, str] = field(default_factory=dict)
