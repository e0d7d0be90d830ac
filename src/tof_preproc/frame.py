# SPDX-License-Identifier: Apache-2.0
"""The raster that the stages work on, and the report of what each removed."""

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
    """One depth raster in work: arrays (H, W) of its own, changed in place. Stages remove pixels and never add any.

    `sigma` is the standard deviation of `depth` in metres, as far as known; `amplitude` may be None.
    """

    camera: Camera
    depth: Image
    reason: Bytes
    sigma: Image
    amplitude: Image | None = None

    def remove(self, mask: Mask, reason: Reason) -> int:
        """Invalidate the valid pixels of `mask`, store the reason, and return their number."""
        gone = np.flatnonzero(mask & np.isfinite(self.depth))
        self.depth.reshape(-1)[gone] = np.nan
        self.sigma.reshape(-1)[gone] = np.nan
        self.reason.reshape(-1)[gone] = reason
        return int(gone.size)


@dataclass(slots=True)
class Report:
    """What the stages did to one view.

    `removed`: stage to pixels it removed (for `iqr` and `sigma3`: captures of pixels it rejected);
    `passed`: stage to the reason why it was skipped.
    """

    removed: dict[str, int] = field(default_factory=dict)
    passed: dict[str, str] = field(default_factory=dict)
