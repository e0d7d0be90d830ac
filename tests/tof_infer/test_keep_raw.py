# SPDX-License-Identifier: Apache-2.0
"""A pixel is corrected only where the network is sure, the range was trained and there is a depth."""

from __future__ import annotations

import numpy as np

from tof_infer.frames import Mark
from tof_infer.keep_raw import keep_raw

NAN, INF = float("nan"), float("inf")


def test_uncertain_untrained_and_missing_pixels_keep_their_raw_depth() -> None:
    # sure, unsure, near, far, no output, infinite output, no depth, zero, infinite depth
    raw = np.array([[1.0, 1.0, 0.2, 3.0, 1.0, 1.0, NAN, 0.0, INF]], np.float32)
    depth = np.array([[1.1, 1.1, 1.1, 1.1, NAN, INF, 1.1, 1.1, 1.1, 7.0], [7.0] * 10], np.float32)
    own = np.array([[0.01, 0.03, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01], [0.0] * 10], np.float32)
    sigma = own + np.float32(0.5)
    limits = np.float32(0.02), np.float32(0.25), np.float32(2.0)
    out, spread, mark = keep_raw(raw, depth, sigma, own, *limits)
    K, R, N = Mark.REPAIRED, Mark.RAW_KEPT, Mark.INVALID
    np.testing.assert_array_equal(mark, [[K, R, R, R, R, R, N, N, N]])
    np.testing.assert_array_equal(out, np.array([[1.1, 1.0, 0.2, 3.0, 1.0, 1.0, NAN, NAN, NAN]], np.float32))
    np.testing.assert_array_equal(spread, np.array([[0.51, INF, INF, INF, INF, INF, NAN, NAN, NAN]], np.float32))
