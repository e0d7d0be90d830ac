# SPDX-License-Identifier: Apache-2.0
"""Steps of the range along the ray, as a camera that counts time has them: in z they differ from pixel to pixel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_gap.limits.evidence import CodeLimits
    from tof_gap.seen.evidence.view import ViewEvidence

CELL_M = 5e-5
"""Metres: width of the cells in which ranges are counted, a thirtieth of the finest step that is looked for."""
FARTHEST_M = 20.0
"""Metres: farther depths are of another kind of camera, or junk; they would take memory for cells between them."""
LONGEST_M = 0.1
"""Metres: longest step, the most that `quantization` states."""


def range_step(view: View, limits: CodeLimits) -> float:
    """Metres between the codes of a capture's range along the ray; 0 where the range is continuous, or finer than `least_mm`.

    The share of ranges on codes is the magnitude of the mean of e^(2 pi i r / step), for all steps at once by Fourier transform. The mean
    of n captures lies on the codes' n-th parts.
    """
    ranges = view.depth.astype(np.float64) * view.camera.ray_length()
    ranges = ranges[np.abs(ranges) < FARTHEST_M]
    if len(ranges) < limits.pixels:
        return 0.0
    counts = np.bincount(((ranges - ranges.min()) / CELL_M).astype(np.int64))
    size = fft.next_fast_len(2 * len(counts), real=True)
    share = np.abs(fft.rfft(counts, size)) / len(ranges)
    step = size * CELL_M / np.maximum(np.arange(len(share)), 1)
    # Ranges of one surface lie near each other, which is no code.
    share[(step > min(LONGEST_M, limits.spread * float(np.std(ranges)))) | (step < limits.least_mm * 1e-3 / view.captures)] = 0.0
    most = float(share.max(initial=0.0))
    if most < limits.share:
        return 0.0
    found = view.captures * float(step[np.flatnonzero(share > limits.harmonic * most)[0]])
    return found if limits.least_mm * 1e-3 < found < LONGEST_M else 0.0


def steps_along_ray(views: Sequence[ViewEvidence], step_m: float) -> bool:
    """Whether the ranges of most views lie on codes `step_m` apart rather than their depths along z."""
    closer = [_on_codes(v, step_m, v.frame.length) > _on_codes(v, step_m, np.ones(())) for v in views]
    return bool(np.mean(closer) > 0.5)


def _on_codes(view: ViewEvidence, step_m: float, length: Float) -> float:
    """Share of a view's distances (z times `length`) on the codes of `step_m`, or on those of a mean of captures."""
    r = view.view.depth * length
    r = r[np.isfinite(r)]
    return float(np.abs(np.exp(2j * np.pi * view.view.captures / step_m * r).mean())) if len(r) else 0.0
