# SPDX-License-Identifier: Apache-2.0
"""Which pixels of a corrected frame are corrected, and which keep their raw depth."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_infer.frames import Mark

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Image

REPAIRED, RAW_KEPT, INVALID = np.uint8(Mark.REPAIRED), np.uint8(Mark.RAW_KEPT), np.uint8(Mark.INVALID)


@njit(cache=True, nogil=True)
def keep_raw(
    raw: Image, depth: Image, sigma: Image, own: Image, max_sigma: np.float32, nearest: np.float32, farthest: np.float32
) -> tuple[Image, Image, Bytes]:
    """Depth, its sigma and `Mark`, each (H, W), of raw depth (H, W) and the network's outputs, which may be padded below and to the right.

    A pixel with a raw depth is corrected where `own`, the sigma from its surroundings alone, is at most `max_sigma`, the raw depth lies
    between `nearest` and `farthest`, and the network gives a positive, finite depth. Elsewhere its raw depth stays and its sigma is infinite.
    All in metres.
    """
    h, w = raw.shape
    out, spread, mark = np.empty((h, w), np.float32), np.empty((h, w), np.float32), np.empty((h, w), np.uint8)
    for v in range(h):
        for u in range(w):
            z, new = raw[v, u], depth[v, u]
            there = (z > 0) & (z < np.inf)
            known = there & (own[v, u] <= max_sigma) & (new > 0) & (new < np.inf) & (z > nearest) & (z < farthest)
            out[v, u] = new if known else (z if there else np.float32(np.nan))
            spread[v, u] = sigma[v, u] if known else np.float32(np.inf if there else np.nan)
            mark[v, u] = REPAIRED if known else (RAW_KEPT if there else INVALID)
    return out, spread, mark
