# SPDX-License-Identifier: Apache-2.0
"""Error measures of depth, each with the pixels that it counts."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Image, Mask


@dataclass(frozen=True, slots=True)
class DepthError:
    """Errors of measured against true depth over `pixels` pixels that have both.

    mae, bias, rmse in metres (bias positive when measured too far); completeness is
    pixels / `reference` where `reference` counts the pixels that have a true depth;
    alignment is the paper's figure 9, 100 * mean(1 - |measured - true| / true), in per cent.
    """

    mae: float
    bias: float
    rmse: float
    completeness: float
    alignment: float
    pixels: int
    reference: int

    def to_dict(self) -> dict[str, float]:
        """Plain numbers for JSON."""
        return asdict(self)


def depth_error(measured: Image, true: Image, where: Mask | None = None) -> DepthError:
    """Compare two z-depth images (..., H, W) in metres over the pixels of `where`."""
    has_truth = np.isfinite(true) & (True if where is None else where)
    both = has_truth & np.isfinite(measured)
    reference, pixels = int(has_truth.sum()), int(both.sum())
    if pixels == 0:
        nan = float("nan")
        return DepthError(nan, nan, nan, 0.0 if reference else nan, nan, 0, reference)
    t = true[both].astype(np.float64)
    e = measured[both].astype(np.float64) - t
    return DepthError(
        mae=float(np.abs(e).mean()),
        bias=float(e.mean()),
        rmse=float(np.sqrt((e * e).mean())),
        completeness=pixels / reference,
        alignment=float(100.0 * (1.0 - np.abs(e) / t).mean()),
        pixels=pixels,
        reference=reference,
    )
