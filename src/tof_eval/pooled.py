# SPDX-License-Identifier: Apache-2.0
"""Depth errors pooled over many images; the images are not kept."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tof_core.metrics import DepthError, depth_error

if TYPE_CHECKING:
    from tof_core.arrays import Image, Mask


@dataclass(slots=True)
class PooledError:
    """The fields of `tof_core.metrics.DepthError` over all pixels of all images added."""

    pixels: int = 0
    reference: int = 0
    _absolute: float = 0.0
    _signed: float = 0.0
    _squared: float = 0.0
    _alignment: float = 0.0

    def add(self, measured: Image, true: Image, where: Mask | None = None) -> None:
        """Add one pair of z-depth images (H, W) in metres, compared over `where`."""
        e = depth_error(measured, true, where)
        self.pixels += e.pixels
        self.reference += e.reference
        if e.pixels:
            self._absolute += e.mae * e.pixels
            self._signed += e.bias * e.pixels
            self._squared += e.rmse**2 * e.pixels
            self._alignment += e.alignment * e.pixels

    @property
    def error(self) -> DepthError:
        """The pooled error; NaN where nothing was compared."""
        n = self.pixels or math.nan
        return DepthError(
            mae=self._absolute / n,
            bias=self._signed / n,
            rmse=math.sqrt(self._squared / n) if self.pixels else math.nan,
            completeness=self.pixels / self.reference if self.reference else math.nan,
            alignment=self._alignment / n,
            pixels=self.pixels,
            reference=self.reference,
        )
